"""The tables of docs/spo-lf-occ-omg.md: near depth edges, and SPO beside its published maps.

    python benchmarks/occluders.py [--scenes bars ...] [--size 128] [--labels 64]
                                   [--data FOLDER --maps FOLDER [--radius 7 5]]

Procedural scenes without their outer 8 px. The folder of data holds scenes of the 4D Light Field Benchmark
with low-resolution truth, that of maps SCENE.pfm as the authors of SPO submitted them, one label too far.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

import lfdepth
from lfdepth import scenes
from lfdepth.io.pfm import read_pfm
from reporting import Cell, machine_line, markdown

SCENES = ("bars", "fence", "leaves", "wedges")
LABELS = 256


def near_edges(names: Sequence[str], size: int, labels: int) -> None:
    """BadPix 0.07 within 5 px of jumps for SPO, and in the scenes' mask of depth edges for the others."""
    inner, rows = (slice(8, -8), slice(8, -8)), list[Sequence[Cell]]()
    for name in names:
        lf = scenes.render(name, size=size)
        truth = lf.truth
        assert truth is not None
        steps = ndimage.maximum_filter(truth, 3) - ndimage.minimum_filter(truth, 3)
        jumps = ndimage.binary_dilation(steps > 0.2, iterations=4)

        def bad(method: str, where: NDArray[np.bool_], **options: Any) -> float:
            found = lfdepth.estimate(lf, method, planes=labels, check=False, **options).disparity  # noqa: B023
            return 100 * float(np.mean((np.abs(found - truth) > 0.07)[inner][where[inner]]))  # noqa: B023

        edge = lf.masks["occlusion_boundary"]
        values = [bad("spo", jumps), bad("spo-mo", jumps)]
        for rule in ("none", "paths"):
            values += [bad(method, edge, regulariser=rule) for method in ("lf-occ", "omg")]
        rows.append([name, *values])
    columns = ["spo", "spo-mo", "lf-occ, none", "omg, none", "lf-occ, paths", "omg, paths"]
    print(markdown(["BadPix 0.07, %", *columns], rows), flush=True)


def beside_published(folder: Path, published: NDArray[np.float32], radius: int) -> list[list[str]]:
    """Scores (low-resolution truth, 15 px border) of `spo` and of the published map, moved by its label."""
    lf = lfdepth.read(folder)
    assert lf.disparity_range is not None
    assert lf.truth is not None
    label = (lf.disparity_range[1] - lf.disparity_range[0]) / (LABELS - 1)
    inner = (slice(15, -15), slice(15, -15))
    found = lfdepth.estimate(lf, "spo", radius=radius, check=False)
    moved = published + np.float32(label)
    rows = []
    for name, disparity in ((f"spo, r = {radius}", found.disparity), ("published, moved", moved)):
        error = np.abs(disparity - lf.truth)[inner]
        scores = [f"{100 * np.mean(error > each):.3f}" for each in (0.07, 0.03, 0.01)]
        near = 100 * np.mean(np.abs(disparity - moved)[inner] < 2.01 * label)
        rows.append([f"{lf.name}, {name}", *scores, f"{100 * np.mean(error**2):.3f}", f"{near:.1f}"])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=SCENES)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--labels", type=int, default=64)
    parser.add_argument("--data", type=Path, help="folder with scenes of the benchmark")
    parser.add_argument("--maps", type=Path, help="folder with SPO's published maps")
    parser.add_argument("--radius", type=int, nargs="+", default=[7], help="of SPO's guided filter")
    chosen = parser.parse_args()
    print(f"{machine_line()}.\n")
    near_edges(chosen.scenes, chosen.size, chosen.labels)
    if chosen.data and chosen.maps:
        header = ["", "BadPix 0.07", "0.03", "0.01", "MSE×100", "% within two labels"]
        for path in sorted(chosen.maps.glob("*.pfm")):
            for radius in chosen.radius:
                rows = beside_published(chosen.data / path.stem, read_pfm(path), radius)
                print("\n" + markdown(header, rows), flush=True)


if __name__ == "__main__":
    main()
