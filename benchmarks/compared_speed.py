"""Run times of the compared methods beside the published ones, on the size of the benchmark's scenes.

    python benchmarks/compared_speed.py [--data FOLDER/cotton] [--repeats 3] [--threads 2] [--methods NAMES]

Without data, on the procedural scene "demo" of 512×512 px. Kernels are compiled before; the least of the
repeats counts, as other work on the machine only adds to it.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import lfdepth
from lfdepth import LightField, scenes
from lfdepth.methods import COMPARED, method
from reporting import Cell, machine_line, markdown, write_json

PUBLISHED: dict[str, tuple[float, str]] = {
    "spo": (2130, "the benchmark's table, MATLAB, i7-4790"),
    "cae": (832, "FastLFnet's table 2"),
    "lf-occ": (1e4, "FastLFnet, read off a plot"),
    "oavc": (41, "its own script, on two cores"),
}
"""Seconds a scene, and where from."""

TARGETS = {"oavc": 10, "ofsy": 10, "cae": 20, "lf-occ": 60, "omg": 60, "spo": 60, "spo-mo": 120}


def measure(lf: LightField, name: str, repeats: int, threads: int) -> tuple[float, float]:
    """Least seconds on the clock, and least seconds that all threads computed, over the repeats."""
    side = min(96, lf.width, lf.height)
    lfdepth.estimate(lf.crop(0, 0, side, side), name, planes=12, threads=threads)
    found = []
    for _ in range(repeats):
        began = time.process_time()
        result = lfdepth.estimate(lf, method(name), threads=threads, check=False)
        found.append((result.runtime, time.process_time() - began))
    return min(wall for wall, _ in found), min(cpu for _, cpu in found)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, help="a scene of the benchmark")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--methods", nargs="+", default=list(COMPARED), choices=COMPARED)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    lf = lfdepth.read(chosen.data) if chosen.data else scenes.render("demo", size=chosen.size)
    found = {name: measure(lf, name, chosen.repeats, chosen.threads) for name in chosen.methods}
    v, u, height, width, _ = lf.shape
    print(f"{lf.name}, {v}×{u} views of {width}×{height} px, {chosen.threads} threads. {machine_line()}.\n")
    rows: list[list[Cell]] = []
    for name, (wall, cpu) in found.items():
        known, where = PUBLISHED.get(name, (None, "none found"))
        labels = method(name).parameters()["planes"]
        rows.append([name, labels, known, wall, known and known / wall, TARGETS[name], cpu, where])
    header = [
        "method",
        "labels",
        "published (s)",
        "here (s)",
        "times faster",
        "limit (s)",
        "CPU (s)",
        "source",
    ]
    print(markdown(header, rows))
    write_json(chosen.json, {"seconds": found})


if __name__ == "__main__":
    main()
