"""The animated picture of the README: a walk through the views, and the disparity map of the reference view.

    python benchmarks/animation.py [--data FOLDER/cotton]

Without a scene, lfdepth's own "demo" is rendered. Writes docs/images/parallax.webp.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import lfdepth
from lfdepth import scenes
from lfdepth.pictures import disparity_colours

TARGET = Path(__file__).parents[1] / "docs" / "images" / "parallax.webp"
FRAMES, MILLISECONDS, GAP, EDGE = 36, 70, 8, 2


def walk(grid: tuple[int, int]) -> list[tuple[float, float]]:
    """Places (v, u) on an ellipse around the reference view, as large as the grid allows."""
    angles = np.linspace(0, 2 * np.pi, FRAMES, endpoint=False)
    v, u = (grid[0] - 1) / 2, (grid[1] - 1) / 2
    return [(float(v + v * np.sin(angle)), float(u + u * np.cos(angle))) for angle in angles]


def between(lf: lfdepth.LightField, disparity: NDArray[np.float32], v: float, u: float) -> NDArray[np.uint8]:
    """What is seen from between the views: the nearest one, moved on by the median disparity."""
    row, column = round(v), round(u)
    # Blending the four views around the place would double edges.
    middle = float(np.median(disparity))
    down, across = (row - v) * middle, (column - u) * middle
    view = Image.fromarray(lf.views[row, column])
    moved = view.transform(
        view.size, Image.Transform.AFFINE, (1, 0, -across, 0, 1, -down), Image.Resampling.BICUBIC
    )
    return np.asarray(moved)


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="light field to show")
    parser.add_argument("--size", type=int, default=288, help="side of the rendered views, px")
    chosen = parser.parse_args()
    lf = lfdepth.read(chosen.data) if chosen.data else scenes.render("demo", size=chosen.size, views=13)
    result = lfdepth.estimate(lf)
    colours = disparity_colours(result.disparity, result.range)
    gap = np.full((lf.height, GAP, 3), 255, np.uint8)
    frames = []
    for v, u in walk(lf.shape[:2]):
        view = between(lf, result.disparity, v, u)
        picture = np.concatenate([view[:, EDGE:-EDGE], gap, colours[:, EDGE:-EDGE]], axis=1)
        frames.append(Image.fromarray(picture[EDGE:-EDGE]))
    frames[0].save(
        TARGET, save_all=True, append_images=frames[1:], duration=MILLISECONDS, loop=0, quality=78, method=6
    )
    print(f"{TARGET}: {len(frames)} frames, {TARGET.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
