"""How long it takes until something happens: help, import, and the first run, which compiles the kernels.

    python benchmarks/startup.py [--size 256] [--json startup.json]

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

REPEATS = 5
LIMITS = {"help": 0.5, "import": 0.5, "first run": 20.0}
"""Seconds: of help, of import, and of a first run more than of a warm one."""


@dataclass(frozen=True)
class FirstRun:
    """Seconds of a method's first and of a later run, as processes; on the wall and of computing."""

    method: str
    cold: float
    warm: float
    cold_cpu: float
    warm_cpu: float


def median(command: list[str]) -> tuple[float, float]:
    """Seconds on the wall, and of computing."""
    runs = [processes.run(command) for _ in range(REPEATS)]
    return statistics.median(run.seconds for run in runs), statistics.median(run.cpu for run in runs)


def first_run(scene: Path, method: str, folder: Path) -> FirstRun:
    command = [*processes.LFDEPTH, "estimate", str(scene), "-o", str(folder / "map.pfm"), "--method", method]
    cold, *warm = (processes.run(command, folder / "numba" / method) for _ in range(3))
    return FirstRun(
        method,
        cold.seconds,
        min(each.seconds for each in warm),
        cold.cpu,
        min(each.cpu for each in warm),
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", type=int, default=256, help="of the procedural scene that is estimated")
    parser.add_argument("--methods", nargs="+", default=processes.methods())
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    starts = {
        "python": median([sys.executable, "-c", ""]),
        "import lfdepth": median([sys.executable, "-c", "import lfdepth"]),
        "lfdepth --help": median([*processes.LFDEPTH, "--help"]),
        "lfdepth estimate --help": median([*processes.LFDEPTH, "estimate", "--help"]),
    }
    with tempfile.TemporaryDirectory() as name:
        scene = processes.render("demo", chosen.size, Path(name))
        runs = [first_run(scene, method, Path(name)) for method in chosen.methods]
    print(f"{machine_line()}.\n")
    print(markdown(["start", "seconds", "CPU (s)"], [[name, *both] for name, both in starts.items()]))
    rows: list[list[Cell]] = [
        [each.method, each.cold, each.warm, each.cold - each.warm, each.cold_cpu, each.warm_cpu]
        for each in runs
    ]
    header = ["method", "first run (s)", "warm run (s)", "difference", "first, CPU (s)", "warm, CPU (s)"]
    print(f"\n{markdown(header, rows)}")
    print(
        f"\nLimits: help and import {LIMITS['help']} s, a first run {LIMITS['first run']} s over a warm one."
    )
    found = {"limits_s": LIMITS, "starts_s": starts, "first_runs_s": [asdict(each) for each in runs]}
    write_json(chosen.json, found)


if __name__ == "__main__":
    main()
