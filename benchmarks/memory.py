"""Peak memory of `lfdepth estimate` with few and with many planes.

    python benchmarks/memory.py [--scene FOLDER] [--size 512] [--steps 0.1 0.01] [--json memory.json]
    python benchmarks/memory.py --large [--json memory.json]

The second form takes 17×17 views of 1024×1024 px: all of them, 9×9 of them, a window of all, and all shrunk.

Each run is a process of its own; its peak is what it held in memory at most, interpreter and libraries
included. The first run of each method finds no compiled kernels, and shows what compiling them takes.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import processes
from reporting import Cell, machine_line, markdown, write_json

LIMIT = 600
"""MB that a streaming method may take on 9×9 views of 512×512 px."""
LARGE_LIMIT = 4000
"""MB that the default method may take on 17×17 views of 1024×1024 px."""
LARGE_PARTS = ("", "--views 9x9", "--crop 256 256 512 512", "--scale 0.5")
"""What is read of the large light field."""
_TILE, _TILES, _VIEWS = 256, 4, 17


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


def write_large(folder: Path) -> tuple[float, float]:
    """Write a large light field view by view, a rendered scene repeated; the range of its disparities."""
    from lfdepth.io.picture import write_picture
    from lfdepth.scenes import render

    lf = render("demo", size=_TILE, views=_VIEWS, samples=1)
    for v, u in np.ndindex(*lf.shape[:2]):
        view = np.tile(lf.views[v, u], (_TILES, _TILES, 1))
        write_picture(folder / f"view_v{v:02d}_u{u:02d}.png", view)
    assert lf.disparity_range is not None
    return lf.disparity_range


def measure_large(folder: Path) -> list[tuple[str, Peak]]:
    """Peak memory of estimates with the default method, per part of a large light field."""
    ends = map(str, write_large(folder))
    command = [*processes.LFDEPTH, "estimate", str(folder), "--range", *ends, "--json", "-o", f"{folder}.pfm"]
    found = []
    for part in LARGE_PARTS:
        run = processes.run([*command, *part.split()])
        facts = run.json()
        peak = Peak(facts["method"]["name"], facts["planes"], facts["compiled"], run.peak, run.seconds)
        found.append((part, peak))
    return found


def report_large(json: Path | None) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "large"
        folder.mkdir()
        found = measure_large(folder)
    rows: list[list[Cell]] = [
        [part or "all of it", each.planes, each.peak, each.seconds] for part, each in found
    ]
    size = _TILE * _TILES
    print(f"{_VIEWS}×{_VIEWS} views of {size}×{size} px, {found[0][1].method}. {machine_line()}.\n")
    print(markdown(["read", "planes", "peak (MB)", "seconds"], rows))
    print(f"\nThe limit is {LARGE_LIMIT} MB.")
    write_json(
        json, {"limit_mb": LARGE_LIMIT, "runs": [{"read": part} | asdict(each) for part, each in found]}
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", type=Path, help="folder of a light field; a procedural one if not given")
    parser.add_argument("--size", type=int, default=512, help="of the procedural one")
    parser.add_argument("--steps", type=float, nargs="+", default=[0.1, 0.01])
    parser.add_argument("--methods", nargs="+", default=processes.methods())
    parser.add_argument("--large", action="store_true", help="17×17 views of 1024×1024 px instead")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    if chosen.large:
        report_large(chosen.json)
        return
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
