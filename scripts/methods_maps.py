"""The figures and tables of the thesis on radiosity maps (Moreno-Fortuny 2005)."""
import json
import shutil

import methods_draw as draw
from methods_lab import LIGHTKILN, OUT, figure, run, table


MAPS = {"solver__method": "radiosity_map", "solver__direct_samples": 200, "solver__samples": 800,
        "quality__target_error": None}
SKIES = {"spheres_and_cube": [0.5, 0.8, 0.5], "teddy": [0.3, 0.5, 1.2], "jeep": [1.0, 0.8, 0.6]}


def some_of(passes, count):
    """Returns a folder with some of the passes that a bake has kept, more of the early ones."""
    few = passes.with_name("few")
    shutil.rmtree(few, ignore_errors=True)
    few.mkdir()
    told = json.loads((passes / "passes.json").read_text())
    picked = sorted({round((len(told) - 1) * (i / (count - 1)) ** 2) for i in range(count)})
    for number, i in enumerate(picked):  # compare goes from 0 up
        shutil.copytree(passes / f"pass_{told[i]['index']:03}", few / f"pass_{number:03}")
    kept = [{**told[i], "index": number} for number, i in enumerate(picked)]
    (few / "passes.json").write_text(json.dumps(kept))
    return few


def radiosity_map(lab, scene, page, **settings):
    sky = {"sky__radiance": SKIES[scene]} if scene in SKIES else {}
    return lab.bake(scene, page, **{**MAPS, **sky, **settings})


@figure("tables-5", "Times of radiosity maps (tables 5.1 to 5.5)")
def tables_5(lab):
    published = {("cornell_30", 64): (8.276, 0.478), ("cornell_30", 128): (15.865, 1.816),
                 ("cornell_30", 256): (37.971, 3.431), ("cornell_30", 512): (144.815, 9.444),
                 ("spheres_and_cube", 128): (39.2436, 3.623),
                 ("spheres_and_cube", 256): (104.166, 8.799), ("toys", 128): (86.1171, 7.009),
                 ("toys", 256): (229.452, 20.133), ("jeep", 256): (260.632, 23.036),
                 ("teddy", 256): (297.17, 26.1535)}
    rows = []
    for (scene, page), (seconds, rays) in published.items():
        if page == 512 and not lab.full:
            continue
        baked = radiosity_map(lab, scene, page)
        trace = sum(p["seconds"] for p in baked.passes if p["name"] == "trace")
        rows.append((baked.command, {"scene": scene, "page": page, "triangles": baked.triangles,
                                     "texels": baked.texels, "solve_seconds": baked.solve,
                                     "thesis_seconds": seconds, "trace_seconds": trace,
                                     "thesis_75_rays": rays}))
    random = radiosity_map(lab, "cornell_30", 128, solver__without=["low_discrepancy"])
    rows.append((random.command, {"scene": "cornell_30, independent directions", "page": 128,
                                  "triangles": random.triangles, "texels": random.texels,
                                  "solve_seconds": random.solve, "thesis_seconds": 38.115}))
    table("tables-5", rows)


@figure("figs-5", "Radiosity maps beside paths (figs. 5.2 to 5.7)")
def figs_5(lab):
    page = 256 if lab.full else 128
    reference = lab.reference("cornell_30", page, samples=2048)
    rows, pictures = [], []
    for name, settings in (("averaged", {}), ("unbiased", {"solver__series": "unbiased"}),
                           ("averaged, 2000", {"solver__samples": 2000})):
        baked = radiosity_map(lab, "cornell_30", page, **settings)
        lines, error = lab.work / f"figs-5-{name}-lines.png", lab.work / f"figs-5-{name}.png"
        figures = lab.compare(reference, baked, "--contours", lines, "--diff", error,
                              "--diff-scale", 10, "--histogram", OUT / "fig-5.3.csv")
        rows.append((baked.command, {"series": name, "solve_seconds": baked.solve,
                                     "nrmse": figures["nrmse"], "bias": figures["bias"],
                                     **{f"beyond_{k}": v for k, v in figures["beyond"].items()}}))
        pictures.append([baked.png(), lines, error])
    table("figs-5", rows)
    draw.sheet(OUT / "figs-5.2-5.5.png", pictures[:1] + pictures[1:2], 384)
    progress = radiosity_map(lab, "cornell_30", 128, keep_passes=True)
    against, passes = lab.reference("cornell_30", 128).folder, progress.folder / "passes"
    run([LIGHTKILN, "compare", str(against), str(passes), "--passes", str(OUT / "fig-5.6.csv")])
    few = some_of(passes, 6)
    run([LIGHTKILN, "compare", str(against), str(few), "--passes", str(lab.work / "few.csv"),
         "--contact-sheet", str(OUT / "fig-5.6.png")])
    same = radiosity_map(lab, "cornell_30", 128, solver__same_directions=True, solver__samples=64)
    own = radiosity_map(lab, "cornell_30", 128, solver__samples=64,
                        solver__without=["low_discrepancy"])
    draw.sheet(OUT / "fig-5.7.png", [[same.png(), own.png()]], 384)
