"""Bakes, compares and keeps what the figures of scripts/methods are made of.

A bake is kept in the work folder under a name that its scene and settings make, so that figures
share bakes and a run that was stopped goes on. Delete the folder after a change of the program."""
import csv
import hashlib
import json
import subprocess
import sys
from pathlib import Path

LIGHTKILN = "build/release/lightkiln"
OUT = Path("docs/methods")
FIGURES = {}  # name: (what it is, function)


def figure(name, title):
    def add(function):
        FIGURES[name] = (title, function)
        return function
    return add


class Baked:
    """A bake that is done: its folder, and what its manifest tells."""

    def __init__(self, folder, command):
        self.folder, self.command = folder, command
        self.manifest = json.loads((folder / "manifest.json").read_text())
        told = self.manifest["statistics"]
        self.texels, self.passes, self.triangles = told["texels"], told["passes"], told["triangles"]
        self.solve = next(s["seconds"] for s in told["stages"] if s["name"] == "solve")

    def bounces(self):
        return [p for p in self.passes if p["name"] in ("bounce", "tile", "shoot")]

    def last(self):
        """Returns seconds and rays of the last bounce."""
        bounce = self.bounces()[-1]
        return bounce["seconds"], bounce["rays"]

    def page(self):
        return self.folder / "page_00.exr"

    def png(self, layer=None):
        return self.folder / (f"page_00.{layer}.png" if layer else "page_00.png")


class Lab:
    def __init__(self, work, full):
        self.work, self.full = work, full
        work.mkdir(parents=True, exist_ok=True)

    def scene(self, name, detail=0):
        path = self.work / (f"{name}_{detail}.glb" if detail else f"{name}.glb")
        if not path.exists():
            args = [LIGHTKILN, "scene", name, "-o", str(path)]
            run(args + (["--detail", str(detail)] if detail else []))
        return path

    def bake(self, scene, page, detail=0, keep_passes=False, **settings):
        """Bakes a scene. Settings are named with __ for the dot: solver__window=2."""
        path = self.scene(scene, detail)
        sets = {"atlas.page_size": page, "output.precision": "float", "solver.direct_samples": 64}
        sets.update({k.replace("__", "."): v for k, v in settings.items()})
        if sets.get("solver.method") == "pairwise":  # figures of RTRad's passes, which trace
            sets.setdefault("solver.visibility", "ray")
        words = [f"{k}={text(v)}" for k, v in sets.items()]
        key = hashlib.sha256(" ".join([path.name, str(keep_passes), *words]).encode()).hexdigest()
        folder = self.work / f"{path.stem}-{key[:12]}"
        command = " ".join([f"lightkiln bake {path.name}"] + [f"--set '{w}'" for w in words])
        if not (folder / "manifest.json").exists():
            args = [LIGHTKILN, "bake", str(path), "-o", str(folder)]
            for word in words:
                args += ["--set", word]
            if keep_passes:
                args += ["--keep-passes", str(folder / "passes")]
            print("   ", command, flush=True)
            run(args)
        return Baked(folder, command)

    def reference(self, scene, page, samples=1024, **settings):
        return self.bake(scene, page, solver__method="path", solver__samples=samples,
                         **{"solver__direct_samples": 256, **settings})

    def compare(self, a, b, *args):
        out = run([LIGHTKILN, "compare", "--json", str(a.page()), str(b.page()), *map(str, args)])
        return json.loads(out)

    def view(self, baked, name, *args):
        path = self.work / f"{baked.folder.name}-{name}.png"
        if not path.exists():
            run([LIGHTKILN, "view", str(baked.folder), "-o", str(path), *map(str, args)])
        return path

    def sizes(self, quick, full):
        return quick + full if self.full else quick


def text(value):
    return value if isinstance(value, str) else json.dumps(value)


def run(args):
    done = subprocess.run(args, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, args))}\n{done.stderr}")
    return done.stdout


def table(name, rows):
    """Writes a .csv; a row is (command, {column: value})."""
    columns = list(dict.fromkeys(k for _, row in rows for k in row))
    with (OUT / f"{name}.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["command"] + columns)
        for command, row in rows:
            writer.writerow([command] + [shown(row.get(c, "")) for c in columns])
    for _, row in rows:
        print("   ", ", ".join(f"{k} {shown(v)}" for k, v in row.items()))


def shown(value):
    return f"{value:.4g}" if isinstance(value, float) else value


# The bakes that several figures share ------------------------------------------------------------

TWO_PASSES = {"solver__bounces": 1, "solver__emitters": "transport", "solver__tolerance": 0}
ONE_BOUNCE = {"solver__bounces": 1, "solver__tolerance": 0}
TWO_BOUNCES = {"solver__bounces": 2, "solver__tolerance": 0}
LUCY = "cornell_lucy"


def pairwise(lab, scene, page, **settings):
    return lab.bake(scene, page, solver__method="pairwise", **settings)


def monte_carlo(lab, scene, page, window, **settings):
    if window == 1:
        return pairwise(lab, scene, page, solver__window=1, **settings)
    return pairwise(lab, scene, page, solver__undersampling="monte_carlo", solver__window=window,
                    **settings)
