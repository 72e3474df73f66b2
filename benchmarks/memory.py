"""Peak memory of `lfdepth estimate` with few and with many planes.

    python benchmarks/memory.py [--scene FOLDER] [--size 512] [--steps 0.1 0.01] [--json memory.json]

Each run is a process of its own; its peak is what it held in memory at most, interpreter and libraries
included. The first run of each method finds no compiled kernels, and shows what compiling them takes.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import processes
from reporting import Cell, machine_line, markdown, write_json

LIMIT = 600
"""MB that a streaming method may take on 9×9 views of 512×512 px."""


@dataclass(frozen=True)
class Peak:
    """Peak memory of one run, MB."""

    method: str
    planes: int
    compiled: bool
    peak: float
    seconds: float


def measure(scene: Path, method: str, step: float, cache: Path) -> Peak:
    with tempfile.TemporaryDirectory() as folder:
        command = [*processes.LFDEPTH, "estimate", str(scene), "-o", f"{folder}/map.pfm", "--json"]
        run = processes.run([*command, "--method", method, "--step", str(step)], cache)
    found = run.json()
    return Peak(method, found["planes"], found["compiled"], run.peak, run.seconds)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", type=Path, help="folder of a light field; a procedural one if not given")
    parser.add_argument("--size", type=int, default=512, help="of the procedural one")
    parser.add_argument("--steps", type=float, nargs="+", default=[0.1, 0.01])
    parser.add_argument("--methods", nargs="+", default=processes.methods())
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = chosen.scene or processes.render("demo", chosen.size, folder)
        peaks = [
            measure(scene, method, step, folder / "numba" / method)
            for method in chosen.methods
            for step in (chosen.steps[0], *chosen.steps)
        ]
    rows: list[list[Cell]] = [
        [each.method, each.planes, "yes" if each.compiled else "", each.peak, each.seconds] for each in peaks
    ]
    print(f"{scene.name}. {machine_line()}.\n")
    print(markdown(["method", "planes", "compiles", "peak (MB)", "seconds"], rows))
    print(f"\nThe limit is {LIMIT} MB for 9×9 views of 512×512 px, whatever the number of planes.")
    write_json(chosen.json, {"limit_mb": LIMIT, "runs": [asdict(each) for each in peaks]})


if __name__ == "__main__":
    main()
