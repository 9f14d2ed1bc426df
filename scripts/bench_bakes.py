"""Makes whole bakes for scripts/bench, with Lightkiln and with Cycles, and writes their seconds and
errors to bakes.csv.

Errors are nRMSE: the root of the mean square of the difference over texels and channels, over the
mean of the light. The noise of references cancels out: with two references r1, r2 that share a
limit but no noise, mean((x - r1)(x - r2)) is the square of x's distance from that limit.

  nrmse_own     distance from the tool's own limit. For Lightkiln, two path-traced bakes give it. For
                Cycles, the reference of the folder and the Cycles bake with the most samples (other
                than x) do.
  nrmse_cycles  Lightkiln only: distance from Cycles' limit. It differs where a texel spans many
                triangles: Lightkiln takes the mean over the texel, Cycles the triangle at its
                center.
"""
import argparse
import csv
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

LIGHTKILN = "build/release/lightkiln"
SIZE, BOUNCES, THREADS = 256, 8, 2
SHORT = 3  # s; longer bakes are not repeated
GENERATED = ["many_lights", "room_textured"]
WITHOUT_FOLDER = ["cornell", "bumpy_ball"]  # a folder has such scenes itself
# Techniques to leave out, one at a time. The series "gather" and "filter" have all of them.
ABLATION = {"dense": {"solver.coarse_indirect": False},
            "incoherent": {"solver.ray_pattern": "incoherent"},
            "no_hits": {"solver.hit_memory_mib": 1},
            **{name: {"solver.without": [name]} for name in
               ("low_discrepancy", "closed_form", "light_importance", "shadow_probes")}}
FIELDS = ["tool", "series", "scene", "setting", "seconds", "cpu_seconds", "solve_seconds", "texels",
          "nrmse_own", "nrmse_cycles", "bias_cycles", "session"]


class Effort:
    """The amount of work. `quick` tries the script and gives no figures to quote."""

    def __init__(self, quick):
        self.gather = [16, 64] if quick else [16, 32, 64, 128, 256, 512, 1024]
        self.rms = [0.2] if quick else [0.08, 0.04, 0.02, 0.01, 0.007]
        self.presets = ["draft"] if quick else ["draft", "preview", "production", "reference"]
        self.path = [4] if quick else [16]
        self.ablation = [16, 64] if quick else [32, 128, 512]
        self.reference = 16 if quick else 256
        self.cycles = [4, 16] if quick else [16, 64, 256, 1024]


def ours_settings(effort):
    """Yields (series, label, settings) of each point of Lightkiln's curves."""
    for n in effort.gather:
        fixed = {"solver.samples": n, "solver.direct_samples": n}
        yield "gather", f"samples {n}", {**fixed, "post.filter": False}
        yield "filter", f"samples {n}", {**fixed, "post.filter": True}
    for series, without in ABLATION.items():
        for n in effort.ablation:
            yield series, f"samples {n}", {"solver.samples": n, "solver.direct_samples": n, **without}
    for target in effort.rms:
        named = {"quality.measure": "rms", "quality.target_error": target}
        yield "rms", f"rms {target}", {**named, "post.filter": False}
        yield "rms_filter", f"rms {target}", named
    for preset in effort.presets:
        yield "presets", preset, {"quality.preset": preset}
    for n in effort.path:
        yield "path", f"samples {n}", {"solver.method": "path", "solver.samples": n}


def read_exr(path):
    """Returns an array (height, width, 4): R, G, B and the coverage."""
    image = oiio.ImageInput.open(str(path))
    if not image:
        sys.exit(f"bench: {path}: {oiio.geterror()}")
    spec = image.spec()
    values = np.asarray(image.read_image("float"), np.float64)
    return values.reshape(spec.height, spec.width, spec.nchannels)[..., :4]


def lit(*images):
    return np.logical_and.reduce([i[..., 3] > 0.5 for i in images])


def noise_free_nrmse(x, r1, r2):
    """Returns the nRMSE without the references' noise, as described above. Noise can make the square
    of a very small error negative; that counts as zero."""
    mask = lit(x, r1, r2)
    a, b, c = (i[mask][:, :3] for i in (x, r1, r2))
    square = ((a - b) * (a - c)).mean()
    return float(np.sqrt(max(0.0, square)) / ((b + c).mean() / 2))


def bias(x, r):
    mask = lit(x, r)
    a, b = x[mask][:, :3], r[mask][:, :3]
    return float((a - b).mean() / b.mean())


def folder_name(label, series):
    return (series + " " + label).replace(" ", "_").replace(",", "")


class Lightkiln:
    def __init__(self, scene, glb, work):
        self.scene, self.glb, self.work = scene, glb, work

    def bake(self, name, settings):
        """Bakes once. Returns the seconds of the stages atlas and solve, of solve alone, and the CPU
        seconds of the whole process; and the image."""
        out = self.work / name
        merged = {"atlas.page_size": SIZE, "solver.bounces": BOUNCES, "output.precision": "float",
                  "output.formats": ["exr"], **settings}
        command = [LIGHTKILN, "bake", str(self.glb), "-o", str(out), "--threads", str(THREADS)]
        for key, value in merged.items():
            command += ["--set", f"{key}={value if isinstance(value, str) else json.dumps(value)}"]
        log = self.work / "log"
        with log.open("w") as f:
            process = subprocess.Popen(command, stdout=f, stderr=subprocess.STDOUT)
            _, status, used = os.wait4(process.pid, 0)
        if status != 0:
            sys.exit(f"bench: {' '.join(command)} failed:\n{log.read_text()}")
        manifest = json.loads((out / "manifest.json").read_text())
        stages = {s["name"]: s["seconds"] for s in manifest["statistics"]["stages"]}
        return {"seconds": stages["atlas"] + stages["solve"], "solve_seconds": stages["solve"],
                "cpu_seconds": used.ru_utime + used.ru_stime}, read_exr(out / "page_00.exr")

    def references(self, effort, keep):
        refs = []
        first = folder_name(f"samples {effort.reference}", "path")
        for seed, name in ((101, first), (102, "reference")):
            if not keep or not (self.work / name / "manifest.json").exists():
                refs.append(self.bake(name, {"solver.method": "path", "solver.seed": seed,
                                             "solver.samples": effort.reference}))
            else:
                refs.append((None, read_exr(self.work / name / "page_00.exr")))
        return refs

    def curve(self, repeat, effort, keep, only):
        refs = self.references(effort, keep)
        r1, r2 = refs[0][1], refs[1][1]
        for series, label, settings in ours_settings(effort):
            if only not in (None, series):
                continue
            runs = [self.bake(folder_name(label, series), settings)]
            while len(runs) < repeat and runs[0][0]["seconds"] < SHORT:
                runs.append(self.bake(folder_name(label, series), settings))
            image = runs[0][1]
            yield row("lightkiln", series, self.scene, label, image,
                      {k: statistics.median(r[0][k] for r in runs) for k in runs[0][0]},
                      noise_free_nrmse(image, r1, r2))
        if keep or only not in (None, "path"):
            return
        # The references are a point of the path tracer's curve. Half of their squared distance is
        # its squared error.
        apart = np.sqrt(noise_free_nrmse(r1, r2, r2) ** 2 / 2)
        yield row("lightkiln", "path", self.scene, f"samples {effort.reference}", r1,
                  {k: statistics.median(r[0][k] for r in refs) for k in refs[0][0]}, float(apart))


def row(tool, series, scene, setting, image, seconds, error):
    r = {"tool": tool, "series": series, "scene": scene, "setting": setting,
         "texels": int(lit(image).sum()), "nrmse_own": error, "image": image, **seconds}
    print(f"  {scene:14} {tool:9} {setting:26} {r['seconds']:8.3f} s  {100 * error:7.3f} %", flush=True)
    return r


def bake_ours(scenes, work, repeat, effort, keep, only):
    for scene, glb in scenes:
        folder = work / scene
        folder.mkdir(parents=True, exist_ok=True)
        yield from Lightkiln(scene, glb, folder).curve(repeat, effort, keep, only)


def bake_cycles(scenes, work, effort):
    for scene, glb in scenes:
        folder = work / scene
        folder.mkdir(parents=True, exist_ok=True)
        runs = {}
        for n in effort.cycles:
            out = folder / f"cycles_{n}.npy"
            # Each run gets a seed of its own, since runs must not share noise.
            command = ["blender", "-b", "-P", "scripts/bench_cycles.py", "--", str(glb), str(out),
                       "--size", str(SIZE), "--samples", str(n), "--bounces", str(BOUNCES),
                       "--threads", str(THREADS), "--seed", str(n)]
            log = folder / f"cycles_{n}.log"
            with open(log, "w") as f:
                if subprocess.run(command, stdout=f, stderr=subprocess.STDOUT).returncode != 0:
                    sys.exit(f"bench: Blender failed: {log}")
            runs[n] = (json.loads(out.with_suffix(".json").read_text()), np.load(out).astype(float))
        reference = read_exr(glb.with_name(scene + "_256.exr"))
        for n, (said, image) in runs.items():
            other = runs[max(k for k in runs if k != n)][1]
            yield row("cycles", "cycles", scene, f"samples {n}", image,
                      {"seconds": said["seconds"], "cpu_seconds": said["cpu_seconds"]},
                      noise_free_nrmse(image, reference, other))


def compare_with_cycles(rows, folder, work, effort):
    """Adds Lightkiln's distance from Cycles' limit to the rows. Cycles gives irradiance over pi."""
    glbs = dict(folder)
    for r in rows:
        if r["tool"] != "lightkiln" or r["scene"] not in glbs:
            continue
        best = work / r["scene"] / f"cycles_{max(effort.cycles)}.npy"
        exr = work / r["scene"] / folder_name(r["setting"], r["series"]) / "page_00.exr"
        if not best.exists() or not exr.exists():
            continue
        image = read_exr(exr)
        x = np.concatenate([image[..., :3] / np.pi, image[..., 3:]], axis=2)
        reference = read_exr(glbs[r["scene"]].with_name(r["scene"] + "_256.exr"))
        r["nrmse_cycles"] = noise_free_nrmse(x, reference, np.load(best).astype(float))
        r["bias_cycles"] = bias(x, reference)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("step", choices=["bakes", "cycles"])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--keep-references", action="store_true")
    parser.add_argument("--series")
    parser.add_argument("--session", required=True)
    a = parser.parse_args()
    effort = Effort(a.quick)
    folder = []
    if a.folder:
        folder = [(p.stem, p) for p in sorted(a.folder.glob("*.glb"))
                  if p.with_name(p.stem + "_256.exr").exists()]
        if not folder:
            sys.exit(f"bench: {a.folder} has no NAME.glb with a NAME_256.exr")
    table = a.out / "bakes.csv"
    rows = list(csv.DictReader(table.open())) if table.exists() else []
    if a.step == "cycles":
        new = list(bake_cycles(folder, a.out, effort))
    else:
        generated = []
        for name in GENERATED + ([] if folder else WITHOUT_FOLDER):
            glb = a.out / f"{name}.glb"
            subprocess.run([LIGHTKILN, "scene", name, "-o", str(glb)], check=True,
                           stdout=subprocess.DEVNULL)
            generated.append((name, glb))
        new = list(bake_ours(folder + generated, a.out, a.repeat, effort, a.keep_references,
                             a.series))
    for r in new:
        r["session"] = a.session
    tool = "cycles" if a.step == "cycles" else "lightkiln"
    kept = [r for r in rows if r["tool"] != tool or a.series not in (None, r["series"])]
    rows = sorted(kept + new, key=lambda r: r["tool"] == "cycles")
    compare_with_cycles(rows, folder, a.out, effort)
    with table.open("w", newline="") as f:
        writer = csv.DictWriter(f, FIELDS, extrasaction="ignore", restval="", lineterminator="\n")
        writer.writeheader()
        for r in rows:
            writer.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in r.items()})


main()
