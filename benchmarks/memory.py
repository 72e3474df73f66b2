"""Peak memory of `lfdepth estimate` with few and with many planes.

    python benchmarks/memory.py [--scene FOLDER] [--size 512] [--steps 0.1 0.01] [--warm] \
[--json memory.json]
    python benchmarks/memory.py --large [--size 1024] [--views 17] [--json memory.json]

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
_TILES = 4  # of a rendered scene, along either axis of a large one


@dataclass(frozen=True)
class Peak:
    """Peak memory of one run, MB."""

    method: str
    planes: int
    compiled: bool
    peak: float
    seconds: float


def measure(scene: Path, method: str, step: float, cache: Path | None) -> Peak:
    with tempfile.TemporaryDirectory() as folder:
        command = [*processes.LFDEPTH, "estimate", str(scene), "-o", f"{folder}/map.pfm", "--json"]
        run = processes.run([*command, "--method", method, "--step", str(step)], cache)
    found = run.json()
    return Peak(method, found["planes"], found["compiled"], run.peak, run.seconds)


def large_parts(size: int, views: int) -> tuple[str, ...]:
    """What is read of the large light field: all, the middle half of the views, of the pixels, shrunk."""
    half, quarter = size // 2, size // 4
    middle = views // 2 + 1 - (views // 2) % 2
    return "", f"--views {middle}x{middle}", f"--crop {quarter} {quarter} {half} {half}", "--scale 0.5"


def write_large(folder: Path, size: int, views: int) -> tuple[float, float]:
    """Write a large light field view by view, a rendered scene repeated; the range of its disparities."""
    from lfdepth.io.picture import write_picture
    from lfdepth.scenes import render

    lf = render("demo", size=size // _TILES, views=views, samples=1)
    for v, u in np.ndindex(*lf.shape[:2]):
        view = np.tile(lf.views[v, u], (_TILES, _TILES, 1))
        write_picture(folder / f"view_v{v:02d}_u{u:02d}.png", view)
    assert lf.disparity_range is not None
    return lf.disparity_range


def measure_large(folder: Path, size: int, views: int) -> list[tuple[str, Peak]]:
    """Peak memory of estimates with the default method, per part of a large light field."""
    ends = map(str, write_large(folder, size, views))
    command = [*processes.LFDEPTH, "estimate", str(folder), "--range", *ends, "--json", "-o", f"{folder}.pfm"]
    found = []
    for part in large_parts(size, views):
        run = processes.run([*command, *part.split()])
        facts = run.json()
        peak = Peak(facts["method"]["name"], facts["planes"], facts["compiled"], run.peak, run.seconds)
        found.append((part, peak))
    return found


def report_large(size: int, views: int, json: Path | None) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "large"
        folder.mkdir()
        found = measure_large(folder, size, views)
    rows: list[list[Cell]] = [
        [part or "all of it", each.planes, each.peak, each.seconds] for part, each in found
    ]
    print(f"{views}×{views} views of {size}×{size} px, {found[0][1].method}. {machine_line()}.\n")
    print(markdown(["read", "planes", "peak (MB)", "seconds"], rows))
    print(f"\nThe limit is {LARGE_LIMIT} MB for 17×17 views of 1024×1024 px.")
    write_json(
        json, {"limit_mb": LARGE_LIMIT, "runs": [{"read": part} | asdict(each) for part, each in found]}
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", type=Path, help="folder of a light field; a procedural one if not given")
    parser.add_argument("--size", type=int, help="of the procedural one, px; 512, or 1024 of a large one")
    parser.add_argument("--views", type=int, default=17, help="of a large one, along either axis")
    parser.add_argument("--steps", type=float, nargs="+", default=[0.1, 0.01])
    parser.add_argument("--methods", nargs="+", help="all by default")
    parser.add_argument("--warm", action="store_true", help="no first runs, which compile kernels")
    parser.add_argument("--large", action="store_true", help="a large light field instead")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    if chosen.large:
        report_large(chosen.size or 1024, chosen.views, chosen.json)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = chosen.scene or processes.render("demo", chosen.size or 512, folder)
        peaks = [
            measure(scene, method, step, None if chosen.warm else folder / "numba" / method)
            for method in chosen.methods or processes.methods()
            for step in (*([] if chosen.warm else chosen.steps[:1]), *chosen.steps)
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
