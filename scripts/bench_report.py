"""Draws the results of scripts/bench: plots and bakes.csv into the docs folder, and the tables of
performance.md between their marks `<!-- bench: NAME -->` and `<!-- end -->`."""
import argparse
import csv
import json
import math
import re
import shutil
from pathlib import Path

COLORS = {"cycles": "#c0392b", "path": "#7f8c8d", "gather": "#1f6fb2", "filter": "#1e8449",
           "rms": "#d68910", "rms_filter": "#17a589", "presets": "#8e44ad"}
NAMES = {"cycles": "Cycles", "path": "Lightkiln, path", "gather": "Lightkiln, gather, no filter",
         "filter": "Lightkiln, gather",
         "rms": "Lightkiln, error named, no filter", "rms_filter": "Lightkiln, error named",
         "presets": "Lightkiln, presets"}
BOUNCES_AT = {"cornell": "256²", "bumpy_ball": "1024²"}  # pages of the bounces benchmark
TARGETS = [0.05, 0.02, 0.01]
# The technique that a curve leaves out and "filter" has.
ABLATION = {"gather": "the filter", "dense": "interpolation between every second texel",
            "incoherent": "packets of rays that stay together", "no_hits": "remembered hits",
            "low_discrepancy": "low-discrepancy points", "closed_form": "lamps in closed form",
            "light_importance": "choice of lights by tile", "shadow_probes": "probing of shadow rays"}


def read_bakes(path):
    rows = list(csv.DictReader(path.open())) if path.exists() else []
    for r in rows:
        for key in r:
            if key not in ("tool", "series", "scene", "setting", "session"):
                r[key] = float(r[key]) if r[key] else None
    return rows


def curve(rows, scene, series, time="seconds", error="nrmse_own"):
    points = [(r[time], r[error]) for r in rows
              if r["scene"] == scene and r["series"] == series and r[error]]
    return sorted(points)


def seconds_to(points, error):
    """Returns the seconds at which a curve comes down to `error`, along straight lines of the log-log
    plot, and whether the curve was extended beyond its last point. Returns None where it never does."""
    logs = [(math.log(t), math.log(e)) for t, e in points]
    goal = math.log(error)
    # This is the last crossing: from there on the error stays below.
    for (t0, e0), (t1, e1) in reversed(list(zip(logs, logs[1:]))):
        if e0 >= goal >= e1 and e0 > e1:
            return math.exp(t0 + (t1 - t0) * (e0 - goal) / (e0 - e1)), False
    if len(logs) < 2 or logs[0][1] < goal:
        return (points[0][0], False) if points else None
    (t0, e0), (t1, e1) = logs[0], logs[-1]
    slope = (e1 - e0) / (t1 - t0)
    # A curve that has nearly stopped falling has reached its bias, so extending it means nothing.
    (ta, ea), (tb, eb) = logs[-2:]
    if slope >= 0 or (eb - ea) / (tb - ta) > slope / 2:
        return None
    return math.exp(t1 + (goal - e1) / slope), True


# --- the plot -------------------------------------------------------------------------------------

class Axes:
    """A log-log frame. Positions are in pixels."""
    left, top, width, height = 70, 40, 560, 360

    def __init__(self, points):
        xs, ys = [p[0] for p in points], [100 * p[1] for p in points]
        self.x = (math.floor(math.log10(min(xs))), math.ceil(math.log10(max(xs))))
        self.y = (math.log10(min(ys)) - 0.1, math.log10(max(ys)) + 0.1)

    def at(self, seconds, percent):
        fx = (math.log10(seconds) - self.x[0]) / (self.x[1] - self.x[0])
        fy = (math.log10(percent) - self.y[0]) / (self.y[1] - self.y[0])
        return self.left + fx * self.width, self.top + (1 - fy) * self.height


def text(x, y, words, anchor="start", size=13, color="#333"):
    return (f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}" '
            f'fill="{color}">{words}</text>')


def line(x0, y0, x1, y1, color, width=1.0):
    return (f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{color}" '
            f'stroke-width="{width}"/>')


def grid(axes):
    parts = []
    bottom, right = axes.top + axes.height, axes.left + axes.width
    for decade in range(axes.x[0], axes.x[1] + 1):
        x, _ = axes.at(10.0 ** decade, 1)
        parts += [line(x, axes.top, x, bottom, "#ddd"),
                  text(x, bottom + 18, f"{10.0 ** decade:g} s", "middle")]
    for percent in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50):
        if axes.y[0] <= math.log10(percent) <= axes.y[1]:
            _, y = axes.at(1, percent)
            parts += [line(axes.left, y, right, y, "#ddd"),
                      text(axes.left - 8, y + 4, f"{percent:g} %", "end")]
    return parts


def plot(title, curves):
    """Returns the plot as SVG text. curves: (series, [(seconds, error)])."""
    axes = Axes([p for _, points in curves for p in points])
    parts = ['<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 660 460" '
             'font-family="sans-serif">', '<rect width="660" height="460" fill="white"/>',
             text(axes.left, 24, title, size=15)] + grid(axes)
    for i, (series, points) in enumerate(curves):
        color = COLORS[series]
        places = [axes.at(t, 100 * e) for t, e in points]
        parts.append(f'<polyline fill="none" stroke="{color}" stroke-width="2" points="' +
                     " ".join(f"{x:.1f},{y:.1f}" for x, y in places) + '"/>')
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="{color}"/>'
                  for x, y in places]
        y = axes.top + 20 + 18 * i
        parts += [line(axes.left + 350, y - 4, axes.left + 375, y - 4, color, 3),
                  text(axes.left + 382, y, NAMES[series])]
    parts += [text(axes.left + axes.width / 2, 452, "CPU seconds of the bake", "middle"),
              "</svg>"]
    return "\n".join(parts) + "\n"


# --- the tables -----------------------------------------------------------------------------------

def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(r) + " |" for r in rows])


def percent(value):
    return "" if value is None else f"{100 * value:.2f} %"


def seconds(value):
    if value is None:
        return "not reached"
    t, prolonged = value
    return ("≈ " if prolonged else "") + (f"{t:.0f}" if t >= 100 else f"{t:.2g}" if t < 1 else f"{t:.1f}")


def quiet(rows):
    """Returns whether wall time means something: all rows come from one session, begun on an idle
    machine."""
    labels = {r["session"] for r in rows}
    return len(labels) == 1 and float(labels.pop().rsplit(" ", 1)[1]) < 1


def factors(rows, time):
    """Returns the table of time to equal error, Lightkiln against Cycles."""
    out = []
    for scene in scenes(rows):
        for series in ("gather", "filter", "rms", "rms_filter", "presets"):
            for goal in TARGETS:
                theirs = seconds_to(curve(rows, scene, "cycles", time), goal)
                ours = seconds_to(curve(rows, scene, series, time), goal)
                if not theirs or not curve(rows, scene, series):
                    continue
                out.append([scene, NAMES[series], f"{100 * goal:g} %", seconds(theirs), seconds(ours),
                            f"{theirs[0] / ours[0]:.0f} ×" if ours else ""])
    if not out:
        return "Not measured."
    unit = "CPU s" if time == "cpu_seconds" else "s"
    return table(["scene", "ours", "nRMSE", f"Cycles, {unit}", f"ours, {unit}", "factor"], out)


def ablation(rows):
    """Returns the table of CPU time to equal error with one technique left out, over that with all."""
    out = []
    for scene in scenes(rows):
        for goal in (0.02, 0.01):
            whole = seconds_to(curve(rows, scene, "filter", "cpu_seconds"), goal)
            if not whole or not curve(rows, scene, "dense"):
                continue
            line = [scene, f"{100 * goal:g} %", seconds(whole)]
            for series in ABLATION:
                t = seconds_to(curve(rows, scene, series, "cpu_seconds"), goal)
                line.append(f"{t[0] / whole[0]:.1f} ×" if t else "not reached")
            out.append(line)
    head = ["scene", "nRMSE", "all, CPU s"] + [f"without {w}" for w in ABLATION.values()]
    return table(head, out) if out else "Not measured."


def slopes(rows):
    """Returns the table of the powers of the samples by which the error falls, by least squares over
    the curves' logarithms."""
    found = []
    for scene in scenes(rows):
        for series in ("gather", "filter"):
            points = [(math.log(float(r["setting"].split()[1])), math.log(r["nrmse_own"]))
                      for r in rows if r["scene"] == scene and r["series"] == series
                      and r["setting"].startswith("samples") and r["nrmse_own"]]
            if len(points) < 3:
                continue
            x, y = (sum(p[k] for p in points) / len(points) for k in (0, 1))
            slope = (sum((a - x) * (b - y) for a, b in points) /
                     sum((a - x) ** 2 for a, _ in points))
            found.append([scene, NAMES[series], f"{-slope:.2f}"])
    return table(["scene", "curve", "a of N^-a"], found)


def wall_factors(rows):
    compared = [r for r in rows if r["scene"] in {c["scene"] for c in rows if c["tool"] == "cycles"}]
    if not quiet(compared):
        return ("Not given: other work ran beside the last run, or the tools ran in different "
                "sessions.")
    return factors(compared, "seconds")


def bakes(rows):
    walls = quiet(rows)
    head = ["scene", "tool", "setting"] + ["bake, s"] * walls + [
        "CPU, s", "nRMSE", "from Cycles' limit", "bias to it"]
    return table(head, [
        [r["scene"], NAMES[r["series"]], r["setting"]] + [f"{r['seconds']:.2f}"] * walls +
        [f"{r['cpu_seconds']:.2f}", percent(r["nrmse_own"]), percent(r["nrmse_cycles"]),
         percent(r["bias_cycles"])] for r in rows])


def scenes(rows):
    return list(dict.fromkeys(r["scene"] for r in rows))


def rate(value):
    return f"{value * 1e-6:.1f}"


def kernel_tables(path):
    if not path.exists():
        return {}
    runs = json.loads(path.read_text())
    by_name = {b["name"]: b for b in runs["benchmarks"] if not b.get("error_occurred")}
    tracing, kernels, stages, scaling, bounces = [], {}, [], [], []
    for name, b in by_name.items():
        parts = name.split("/")
        if parts[0] == "trace_rate":
            samples = int(parts[1].split(":")[1])
            for kind, rays in (("gather", samples), ("shadow", samples // 4)):
                tracing.append([kind, str(rays),
                                f"{b[kind + '_embree_Mray_per_s']:.1f}",
                                f"{b[kind + '_Mray_per_s']:.1f}",
                                f"{b[kind + '_percent_of_embree']:.0f} %"])
        elif parts[0] == "threads":
            scaling.append([parts[1], f"{b['one_thread_s']:.3f}", f"{b['two_threads_s']:.3f}",
                            f"{b['speedup']:.2f} ×"])
        elif parts[0] == "bounces":
            one, sixteen = b["one_bounce_s"], b["sixteen_bounces_s"]
            bounces.append([f"{parts[1]}, {BOUNCES_AT[parts[1]]}", f"{one:.2f}", f"{sixteen:.2f}",
                            f"{sixteen / one:.2f} ×"])
        elif "set:" in name:
            kernels.setdefault(parts[0], {})[b["label"]] = rate(b["items_per_second"])
        else:
            stages.append([" ".join(parts), f"{b['cpu_time']:.1f}"])
    sets = ["sse2", "avx2", "avx512"]
    return {
        "tracing": table(["rays", "per texel", "Embree alone, M/s", "ours, M/s", "share"], tracing),
        "kernels": table(["kernel, M lanes/s"] + sets,
                         [[k] + [v.get(s, "") for s in sets] for k, v in kernels.items()]),
        "stages": table(["stage", "CPU, ms"], stages),
        "bounces": table(["scene", "one bounce, CPU s", "sixteen, CPU s", "ratio"], bounces),
        "threads": table(["scene, 256²", "one thread, s", "two threads, s", "speed-up"], scaling)
        if scaling else "Not measured in the last run: the machine was not idle.",
    }


def machine():
    """Describes the machine that gave the figures."""
    def first(path, pattern):
        found = re.search(pattern, Path(path).read_text(), re.M)
        return found.group(1).strip() if found else "unknown"
    cpu = first("/proc/cpuinfo", r"^model name\s*:(.*)$")
    cores = len(re.findall(r"^processor", Path("/proc/cpuinfo").read_text(), re.M))
    return f"{cores} cores of {cpu}, {first('/etc/os-release', r'^PRETTY_NAME=.(.*).$')}"


def sessions(rows):
    words = f"Measured on {machine()}."
    theirs = {r["session"] for r in rows if r["tool"] == "cycles"}
    ours = {}  # session: curves
    for r in rows:
        if r["tool"] == "lightkiln":
            ours.setdefault(r["session"], {})[NAMES.get(r["series"], "ablation")] = True
    if len(theirs) == 1 and theirs <= set(ours):
        both = theirs.pop()
        ours.pop(both)
        words += (f" Both tools ran in one session ({both}), one after the other, with two threads "
                  "each.")
    words += "".join(f" Cycles: {s}." for s in sorted(theirs))
    return words + "".join(f" {', '.join(names)}: {s}." for s, names in sorted(ours.items()))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--from", dest="source", type=Path, required=True)
    parser.add_argument("--docs", type=Path, required=True)
    a = parser.parse_args()
    rows = read_bakes(a.source / "bakes.csv")
    tables = kernel_tables(a.source / "kernels.json")
    if rows:
        shutil.copy(a.source / "bakes.csv", a.docs / "performance.csv")
        tables |= {"factors": factors(rows, "cpu_seconds"),
                   "wall_factors": wall_factors(rows), "ablation": ablation(rows),
                   "bakes": bakes([r for r in rows if r["series"] in NAMES]),
                   "slopes": slopes(rows), "session": sessions(rows)}
    for scene in scenes(rows):
        curves = [(s, curve(rows, scene, s, "cpu_seconds")) for s in NAMES]
        name = "performance-" + scene.replace("/", "-") + ".svg"
        (a.docs / name).write_text(plot(f"{scene}, 256²: error (nRMSE) against time",
                                        [c for c in curves if c[1]]))
    page = a.docs / "performance.md"
    words = page.read_text()
    for name, body in tables.items():
        mark = re.compile(rf"(<!-- bench: {name} -->\n).*?(<!-- end -->)", re.S)
        words, found = mark.subn(lambda m: m.group(1) + "\n" + body + "\n\n" + m.group(2), words)
        if not found:
            raise SystemExit(f"bench: {page} has no place for the table '{name}'")
    page.write_text(words)


main()
