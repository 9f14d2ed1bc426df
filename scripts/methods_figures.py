"""Measures the figures and tables of the theses with this program. scripts/methods runs it."""
import argparse
import time
from pathlib import Path

import methods_rtrad  # noqa: F401, the figures of both register themselves
import methods_maps  # noqa: F401
from methods_lab import FIGURES, OUT, Lab


def main():
    parser = argparse.ArgumentParser(prog="scripts/methods")
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--work", type=Path, default=Path("out/methods"))
    args = parser.parse_args()
    if args.list:
        for name, (title, _) in FIGURES.items():
            print(f"{name:12} {title}")
        return
    unknown = [n for n in args.names if n not in FIGURES]
    if unknown:
        parser.error(f"no figure is called {unknown[0]}; --list names them all")
    OUT.mkdir(parents=True, exist_ok=True)
    lab = Lab(args.work, args.full)
    for name in args.names or FIGURES:
        start = time.monotonic()
        print(f"{name}: {FIGURES[name][0]}", flush=True)
        FIGURES[name][1](lab)
        print(f"    took {time.monotonic() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
