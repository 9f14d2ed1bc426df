"""The figures and tables of RTRad (Kahl 2022)."""
import math

import methods_draw as draw
from methods_lab import (LUCY, ONE_BOUNCE, OUT, TWO_BOUNCES, TWO_PASSES, figure, monte_carlo,
                         pairwise, table)


@figure("table-6.1", "Monte-Carlo undersampling at the ratio 1/128")
def table_6_1(lab):
    published = {128: (0, 0.151), 256: (0.0063, 0.163), 512: (0.0069, 0.977), 1024: (0.0196, 4.267),
                 2048: (0.0345, 16.48)}
    rows = []
    for page in lab.sizes([128, 256, 512], [1024, 2048]):
        baked = monte_carlo(lab, LUCY, page, page // 128, **TWO_PASSES)
        pure_page = page <= (512 if lab.full else 256)
        dfpr = ""
        if pure_page:
            pure = pairwise(lab, LUCY, page, solver__window=1, **TWO_PASSES)
            dfpr = lab.compare(pure, baked)["dfpr_all"]
        rows.append((baked.command,
                     {"page": page, "window": page // 128, "dfpr_all": dfpr,
                      "pass_seconds": baked.last()[0], "rays": baked.last()[1],
                      "rtrad_dfpr": published[page][0], "rtrad_seconds": published[page][1]}))
    table("table-6.1", rows)


@figure("fig-4.10", "K pairs of points against finer maps")
def fig_4_10(lab):
    rows, lines = [], {}
    for page in (32, 64, 128):
        reference = lab.reference("cornell", page, **TWO_BOUNCES)
        for samples in (1, 4, 16, 64)[:5 - int(math.log2(page / 16))]:
            baked = pairwise(lab, "cornell", page, solver__pair_samples=samples,
                             solver__near_field=False, **TWO_BOUNCES)
            figures = lab.compare(reference, baked)
            rays = baked.last()[1]
            rows.append((baked.command, {"page": page, "pair_samples": samples, "rays": rays,
                                         "pass_seconds": baked.last()[0],
                                         "nrmse": figures["nrmse"]}))
            lines.setdefault(f"page {page}²", []).append((rays, 100 * figures["nrmse"]))
    table("fig-4.10", rows)
    draw.plot(OUT / "fig-4.10.svg", "K points of a pair are what a finer map is", "rays of a bounce",
              "nRMSE against paths, %", lines)


@figure("fig-5.1", "The texels that send")
def fig_5_1(lab):
    pictures, rows = [], []
    for kind in ("stride", "monte_carlo", "mipmap"):
        baked = pairwise(lab, LUCY, 64, solver__undersampling=kind, solver__window=4,
                         output__layers=["irradiance", "senders"], **ONE_BOUNCE)
        pictures.append(baked.png("senders"))
        rows.append((baked.command, {"undersampling": kind, "rays": baked.last()[1]}))
    tree = pairwise(lab, LUCY, 64, solver__subdivision_threshold=0.05,
                    output__layers=["irradiance", "senders", "tree"], **ONE_BOUNCE)
    rows.append((tree.command, {"undersampling": "quadtree", "rays": tree.last()[1]}))
    table("fig-5.1", rows)
    draw.sheet(OUT / "fig-5.1.png", [pictures, [tree.png("tree"), tree.png("senders"), tree.png()]],
               256)


@figure("fig-6.5", "Pure radiosity over resolution")
def fig_6_5(lab):
    rows, line = [], []
    for page in lab.sizes([64, 96, 128, 192, 256], [512]):
        baked = pairwise(lab, LUCY, page, solver__window=1, **TWO_PASSES)
        seconds, rays = baked.last()
        rows.append((baked.command, {"page": page, "texels": baked.texels, "pass_seconds": seconds,
                                     "rays": rays, "rays_per_second": rays / seconds}))
        line.append((page, seconds))
    table("fig-6.5", rows)
    draw.plot(OUT / "fig-6.5.svg", "pairwise, a statue in a box", "page", "seconds of a pass",
              {"pairwise": line})


@figure("fig-6.6", "Undersampling: windows and resolutions (6.6, 6.7)")
def fig_6_6(lab):
    rows, lines, pictures = [], {}, []
    for page in lab.sizes([64, 128, 256], [512]):
        pure = pairwise(lab, LUCY, page, solver__window=1, **TWO_PASSES)
        row = [pure.png()]
        for window in (2, 4, 8, 16):
            baked = monte_carlo(lab, LUCY, page, window, **TWO_PASSES)
            dfpr = lab.compare(pure, baked)["dfpr_all"]
            rows.append((baked.command, {"page": page, "window": window, "dfpr_all": dfpr,
                                         "pass_seconds": baked.last()[0]}))
            lines.setdefault(f"page {page}²", []).append((window, dfpr))
            row.append(baked.png())
        pictures.append(row)
    table("fig-6.6", rows)
    draw.plot(OUT / "fig-6.7.svg", "monte_carlo against all texels", "window", "DFPR", lines)
    draw.sheet(OUT / "fig-6.6.png", pictures, 192)


@figure("fig-6.8", "Shadows of a narrow lamp (6.8, 6.9)")
def fig_6_8(lab):
    page, shadows, errors, rows = 128, [], [], []
    pure = pairwise(lab, "cornell_geom", page, solver__window=1, **TWO_PASSES)
    for kind in ("none", "stride", "mipmap", "monte_carlo"):
        window = 1 if kind == "none" else 4
        baked = pairwise(lab, "cornell_geom", page, solver__undersampling=kind,
                         solver__window=window, **TWO_PASSES)
        error = lab.work / f"fig-6.8-{kind}.png"
        figures = lab.compare(pure, baked, "--diff", error, "--diff-scale", 50)
        rows.append((baked.command, {"undersampling": kind, "window": window,
                                     "dfpr_all": figures["dfpr_all"], "nrmse": figures["nrmse"]}))
        shadows.append(lab.view(baked, "nearest", "--nearest", "--size", "320x240"))
        errors.append(error)
    table("fig-6.8", rows)
    draw.sheet(OUT / "fig-6.8.png", [shadows], 320)
    draw.sheet(OUT / "fig-6.9.png", [errors], 256)


@figure("fig-6.10", "The threshold of the quadtree")
def fig_6_10(lab):
    page = 256 if lab.full else 128
    pure = pairwise(lab, LUCY, page, solver__window=1, **TWO_PASSES)
    rows, error, effort = [], [], []
    for threshold in (0.001, 0.01, 0.05, 0.15, 0.3, 0.5):
        baked = pairwise(lab, LUCY, page, solver__subdivision_threshold=threshold, **TWO_PASSES)
        dfpr = lab.compare(pure, baked)["dfpr_all"]
        share = baked.last()[0] / pure.last()[0]
        rows.append((baked.command, {"threshold": threshold, "dfpr_all": dfpr,
                                     "pass_seconds": baked.last()[0], "time_share": share}))
        error.append((threshold, dfpr))
        effort.append((threshold, share))
    for window in (2, 4, 8):
        baked = monte_carlo(lab, LUCY, page, window, **TWO_PASSES)
        rows.append((baked.command, {"threshold": f"monte_carlo {window}",
                                     "dfpr_all": lab.compare(pure, baked)["dfpr_all"],
                                     "pass_seconds": baked.last()[0],
                                     "time_share": baked.last()[0] / pure.last()[0]}))
    table("fig-6.10", rows)
    draw.plot(OUT / "fig-6.10.svg", "the quadtree's threshold", "threshold", "DFPR; share of time",
              {"DFPR": error, "time over pairwise": effort})


def all_methods():
    return {"pairwise": {"solver__method": "pairwise"},
            "monte_carlo 2": {"solver__method": "pairwise", "solver__undersampling": "monte_carlo",
                              "solver__window": 2},
            "monte_carlo 4": {"solver__method": "pairwise", "solver__undersampling": "monte_carlo",
                              "solver__window": 4},
            "mipmap 4": {"solver__method": "pairwise", "solver__undersampling": "mipmap",
                         "solver__window": 4},
            "quadtree 0.05": {"solver__method": "pairwise",
                              "solver__subdivision_threshold": 0.05},
            "links": {"solver__method": "links"},
            "directional 1024": {"solver__method": "directional", "solver__samples": 1024},
            "directional 256": {"solver__method": "directional", "solver__samples": 256},
            "radiosity_map, unbiased": {"solver__method": "radiosity_map",
                                        "solver__series": "unbiased"},
            "gather 256": {"solver__samples": 256},
            "gather": {"solver__direct_samples": None}}


@figure("fig-6.11", "All methods beside each other, two bounces")
def fig_6_11(lab):
    page = 256 if lab.full else 128
    rows, pictures = [], []
    reference = lab.reference(LUCY, page, **TWO_BOUNCES)
    other = lab.reference(LUCY, page, solver__seed=2, **TWO_BOUNCES)
    for name, settings in all_methods().items():
        baked = lab.bake(LUCY, page, **{**TWO_BOUNCES, **settings})
        figures = lab.compare(reference, baked, "--second-reference", other.page())
        rows.append((baked.command, {"method": name, "solve_seconds": baked.solve,
                                     "rays": sum(p["rays"] for p in baked.passes),
                                     "nrmse": figures["unbiased"]["nrmse"],
                                     "bias": figures["bias"], "dfpr_all": figures["dfpr_all"]}))
        pictures.append(baked.png())
    table("fig-6.11", rows)
    draw.sheet(OUT / "fig-6.11.png", [pictures[:6], pictures[6:]], 192)


@figure("fig-6.12", "Time over triangles")
def fig_6_12(lab):
    scenes = [("cornell_30", 0), ("cornell_layers", 0), ("small_lights", 0), ("cornell_geom", 0),
              ("octagon_textured", 0), ("bumpy_ball", 30), (LUCY, 0), ("atrium", 0),
              ("bumpy_ball", 289)]
    rows, lines = [], {}
    for name, detail in scenes:
        sky = {"sky__radiance": [3000, 4000, 6000]} if name == "atrium" else {}
        baked = pairwise(lab, name, 128, detail=detail, solver__window=1, solver__samples=16,
                         **ONE_BOUNCE, **sky)
        seconds, rays = baked.last()
        rows.append((baked.command, {"scene": name, "triangles": baked.triangles,
                                     "texels": baked.texels, "pass_seconds": seconds, "rays": rays,
                                     "ns_per_ray": 1e9 * seconds / rays}))
        lines.setdefault("bumpy_ball" if detail else name, []).append(
            (baked.triangles, 1e9 * seconds / rays))
    table("fig-6.12", rows)
    draw.plot(OUT / "fig-6.12.svg", "all pairs of texels, page 128²", "triangles", "ns for a ray",
              lines, log_y=False)


@figure("fig-6.13", "Remembered visibility")
def fig_6_13(lab):
    rows, first, later = [], [], []
    settings = {"solver__bounces": 3, "solver__tolerance": 0, "solver__window": 1}
    for page in lab.sizes([64, 128], [256]):
        plain = pairwise(lab, LUCY, page, **settings)
        for mib in (1024, 4):
            cached = pairwise(lab, LUCY, page, solver__visibility="cached",
                              solver__visibility_cache_mib=mib, **settings)
            seeing = next(p for p in cached.passes if p["name"] == "visibility")["seconds"]
            bounces, plain_bounces = cached.bounces(), plain.bounces()
            one = (seeing + bounces[0]["seconds"]) / plain_bounces[0]["seconds"]
            more = bounces[-1]["seconds"] / plain_bounces[-1]["seconds"]
            covered = next((w["message"] for w in cached.manifest["warnings"]
                            if w["code"] == "visibility_cache_full"), "all pairs")
            rows.append((cached.command,
                         {"page": page, "mib": mib, "first_pass": one, "later_passes": more,
                          "covered": covered.split(" of all")[0],
                          "nrmse": lab.compare(plain, cached)["nrmse"]}))
            if mib == 1024:
                first.append((page, 100 * one))
                later.append((page, 100 * more))
    table("fig-6.13", rows)
    draw.plot(OUT / "fig-6.13.svg", "cached visibility", "page", "% of the time without",
              {"first bounce": first, "later ones": later}, log_y=False)


@figure("fig-6.14", "Voxels in place of rays (6.14, 6.15)")
def fig_6_14(lab):
    page, rows, pictures, lines = 128, [], [], {}
    plain = pairwise(lab, LUCY, page, solver__window=1, **ONE_BOUNCE)
    for march in ("fixed_steps", "exact"):
        row = [plain.png()]
        for grid in (32, 64, 128):
            baked = pairwise(lab, LUCY, page, solver__visibility="voxel", solver__voxel_grid=grid,
                             solver__voxel_march=march, solver__window=1,
                             output__layers=["irradiance", "voxels"], **ONE_BOUNCE)
            figures = lab.compare(plain, baked)
            share = baked.last()[0] / plain.last()[0]
            rows.append((baked.command, {"march": march, "grid": grid,
                                         "dfpr_all": figures["dfpr_all"], "nrmse": figures["nrmse"],
                                         "bias": figures["bias"], "time_share": share}))
            lines.setdefault(march, []).append((share, figures["dfpr_all"]))
            row.append(baked.png())
        row.append(baked.png("voxels"))
        pictures.append(row)
    for ratio in (0.25, 0.5, 0.75):
        baked = pairwise(lab, LUCY, page, solver__visibility="voxel", solver__voxel_grid=64,
                         solver__voxel_ratio=ratio, solver__window=1, **ONE_BOUNCE)
        figures = lab.compare(plain, baked)
        rows.append((baked.command, {"march": f"exact, ratio {ratio}", "grid": 64,
                                     "dfpr_all": figures["dfpr_all"], "nrmse": figures["nrmse"],
                                     "bias": figures["bias"],
                                     "time_share": baked.last()[0] / plain.last()[0]}))
    table("fig-6.14", rows)
    draw.plot(OUT / "fig-6.15.svg", "voxels beside rays", "time over rays", "DFPR", lines)
    draw.sheet(OUT / "fig-6.14.png", pictures, 160)


@figure("fig-6.17", "Small lamps and directions")
def fig_6_17(lab):
    page, rows, pictures = 256, [], []
    settings = TWO_BOUNCES
    reference = lab.reference("small_lights", page, samples=512, **settings)
    for name, more in (("256", {"solver__samples": 256, "solver__emitters": "transport"}),
                       ("1024", {"solver__samples": 1024, "solver__emitters": "transport"}),
                       ("1024, explicit", {"solver__samples": 1024})):
        baked = lab.bake("small_lights", page, solver__method="directional", **settings, **more)
        rows.append((baked.command, {"directions": name, "pass_seconds": baked.last()[0],
                                     "nrmse": lab.compare(reference, baked)["nrmse"]}))
        pictures.append(lab.view(baked, "room", "--size", "320x240"))
    table("fig-6.17", rows)
    draw.sheet(OUT / "fig-6.17.png", [pictures], 320)


@figure("fig-6.18", "Everything over resolution, and the cost of links")
def fig_6_18(lab):
    rows, lines = [], {}
    kinds = {"pairwise": (256, {"solver__method": "pairwise", "solver__window": 1}),
             "monte_carlo, 1/128": (1024, {"solver__method": "pairwise",
                                           "solver__undersampling": "monte_carlo"}),
             "quadtree 0.05": (512, {"solver__method": "pairwise",
                                     "solver__subdivision_threshold": 0.05}),
             "cached": (128, {"solver__method": "pairwise", "solver__visibility": "cached",
                              "solver__window": 1}),
             "links": (1024, {"solver__method": "links"}),
             "directional 256": (1024, {"solver__method": "directional",
                                        "solver__samples": 256})}
    for name, (most, settings) in kinds.items():
        for page in lab.sizes([64, 128, 256, 512], [1024]):
            if page > most or (page == 256 and name == "pairwise" and not lab.full):
                continue
            baked = lab.bake(LUCY, page, solver__bounces=2, solver__tolerance=0, **settings)
            seconds, rays = baked.last()
            rows.append((baked.command, {"method": name, "page": page, "texels": baked.texels,
                                         "pass_seconds": seconds, "rays": rays}))
            lines.setdefault(name, []).append((baked.texels, seconds))
    for name, line in lines.items():
        (n0, s0), (n1, s1) = line[0], line[-1]
        exponent = math.log(s1 / s0) / math.log(n1 / n0)
        print(f"    {name}: seconds grow as n^{exponent:.2f} from {n0} to {n1} texels")
        at = [i for i in range(len(line)) if line[i][1] <= 0.5]
        if at:
            n, s = line[at[-1]]
            print(f"    {name}: {n} texels take {s:.3f} s a bounce (two updates a second)")
    table("fig-6.18", rows)
    draw.plot(OUT / "fig-6.18.svg", "a bounce", "texels", "seconds", lines)


@figure("table-6.2", "Two bounces of RTRad's rows, and engines as published")
def table_6_2(lab):
    published = {(256, "u"): 0.5, (512, "u"): 2.49, (1024, "u"): 8.59, (2048, "u"): 33.17,
                 (256, "d"): 0.12, (512, "d"): 0.42, (1024, "d"): 0.70, (2048, "d"): 2.96}
    engines = {256: "4.1, 4.2; 6.5, 3.36", 512: "16.3, 5.4; 16.4, 57.91",
               1024: "58.5, 13.4; 50.4, 27.3", 2048: "214.2, 31.1; 179.2, 102.3"}
    rows = []
    for page in lab.sizes([256, 512], [1024, 2048]):
        kinds = {"u": {"solver__method": "pairwise", "solver__undersampling": "monte_carlo"},
                 "d": {"solver__method": "directional", "solver__samples": 1024},
                 "gather": {"solver__direct_samples": None}}
        for kind, settings in kinds.items():
            two = {} if kind == "gather" else TWO_BOUNCES
            baked = lab.bake(LUCY, page, **settings, **two)
            rows.append((baked.command,
                         {"page": page, "method": {"u": "undersampling", "d": "directional"}.get(
                             kind, "gather, all bounces, presets' error"),
                          "solve_seconds": baked.solve, "rtrad_gpu": published.get((page, kind), ""),
                          "unity_cpu_gpu_unreal_cpu_gpu": engines[page]}))
    table("table-6.2", rows)


@figure("batches", "Texels of a batch")
def batches(lab):
    rows, line = [], []
    for texels in (1, 8, 64, 256, 1024, 4096):
        baked = pairwise(lab, LUCY, 128, solver__batch_texels=texels, solver__window=1, **ONE_BOUNCE)
        rows.append((baked.command, {"batch_texels": texels, "pass_seconds": baked.last()[0]}))
        line.append((texels, baked.last()[0]))
    table("batches", rows)
    draw.plot(OUT / "batches.svg", "texels of a batch", "texels", "seconds of a bounce",
              {"pairwise": line}, log_y=False)


@figure("clamps", "What clamps take (4.7.3, 6.3.2)")
def clamps(lab):
    rows, pictures = [], []
    for near in (False, True):
        for clamp in (None, 0.05, 0.01):
            baked = pairwise(lab, "cornell", 128, solver__max_contribution=clamp,
                             solver__near_field=near, **TWO_BOUNCES)
            error = lab.work / f"clamps-{near}-{clamp}.png"
            figures = lab.compare(lab.reference("cornell", 128, **TWO_BOUNCES), baked, "--diff", error,
                                  "--diff-scale", 10)
            taken = next((w["message"] for w in baked.manifest["warnings"]
                          if w["code"] == "energy_clamped"), "nothing")
            rows.append((baked.command, {"near_field": str(near), "max_contribution": str(clamp),
                                         "nrmse": figures["nrmse"], "bias": figures["bias"],
                                         "taken": taken}))
            pictures.append(error)
    table("clamps", rows)
    draw.sheet(OUT / "clamps.png", [pictures[:3], pictures[3:]], 256)


@figure("seven", "Check 7: directions in seconds, and the wedge that is dark")
def seven(lab):
    page = 2048 if lab.full else 1024
    large = lab.bake(LUCY, page, solver__method="directional", solver__samples=256, **ONE_BOUNCE)
    wedge = lab.bake("cornell_layers", 128, solver__method="directional", solver__samples=1024)
    table("seven", [(large.command, {"page": page, "texels": large.texels,
                                     "pass_seconds": large.last()[0]}),
                    (wedge.command, {"page": 128, "texels": wedge.texels,
                                     "pass_seconds": wedge.last()[0]})])
    draw.sheet(OUT / "seven.png", [[wedge.png(), lab.view(wedge, "room", "--size", "384x384")]], 384)
