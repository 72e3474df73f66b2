"""How long it takes until something happens: help, import, and the first run, which compiles the kernels.

    python benchmarks/startup.py [--size 256] [--repeats 5] [--json startup.json]

Medians over several processes. First runs begin with an empty cache of compiled kernels; warm ones find what
the first ones left.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import processes
from reporting import Cell, machine_line, markdown, write_json

LIMITS = {"help": 0.35, "import": 0.1, "first run": 10.0}
"""Seconds: of help, of import, and of a first run more than of a warm one."""


@dataclass(frozen=True)
class FirstRun:
    """Seconds of a method's first and of later runs, as processes; on the wall and of computing.

    And whether kernels were compiled, in the first one and in any later one.
    """

    method: str
    cold: float
    warm: float
    cold_cpu: float
    warm_cpu: float
    cold_compiled: bool
    warm_compiled: bool


def median(command: list[str], repeats: int) -> tuple[float, float]:
    """Seconds on the wall, and of computing."""
    runs = [processes.run(command) for _ in range(repeats)]
    return statistics.median(run.seconds for run in runs), statistics.median(run.cpu for run in runs)


def first_run(scene: Path, method: str, folder: Path, repeats: int) -> FirstRun:
    words = ["estimate", str(scene), "-o", str(folder / "map.pfm"), "--method", method, "--json"]
    command = [*processes.LFDEPTH, *words]
    cold, *warm = (processes.run(command, folder / "numba" / method) for _ in range(1 + repeats))
    return FirstRun(
        method,
        cold.seconds,
        min(each.seconds for each in warm),
        cold.cpu,
        min(each.cpu for each in warm),
        cold.json()["compiled"],
        any(each.json()["compiled"] for each in warm),
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", type=int, default=256, help="of the procedural scene that is estimated")
    parser.add_argument("--methods", nargs="+", help="all by default")
    parser.add_argument("--repeats", type=int, default=5, help="processes for a median")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    commands = {
        "python": [sys.executable, "-c", ""],
        "import lfdepth": [sys.executable, "-c", "import lfdepth"],
        "lfdepth --help": [*processes.LFDEPTH, "--help"],
        "lfdepth estimate --help": [*processes.LFDEPTH, "estimate", "--help"],
    }
    starts = {name: median(command, chosen.repeats) for name, command in commands.items()}
    with tempfile.TemporaryDirectory() as name:
        scene = processes.render("demo", chosen.size, Path(name))
        runs = [
            first_run(scene, method, Path(name), min(2, chosen.repeats))
            for method in chosen.methods or processes.methods()
        ]
    print(f"{machine_line()}.\n")
    print(markdown(["start", "seconds", "CPU (s)"], [[name, *both] for name, both in starts.items()]))
    rows: list[list[Cell]] = [
        [each.method, each.cold, each.warm, each.cold - each.warm, each.cold_cpu, each.warm_cpu]
        for each in runs
    ]
    header = ["method", "first run (s)", "warm run (s)", "difference", "first, CPU (s)", "warm, CPU (s)"]
    print(f"\n{markdown(header, rows)}")
    print(
        f"\nLimits: help {LIMITS['help']} s, import {LIMITS['import']} s more than python, a first run "
        f"{LIMITS['first run']} s over a warm one."
    )
    found = {"limits_s": LIMITS, "starts_s": starts, "first_runs_s": [asdict(each) for each in runs]}
    write_json(chosen.json, found)


if __name__ == "__main__":
    main()
