"""A first look at few views, and pictures made from many."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.base import Float
from lfdepth.engines.plain.sampling import bilinear, inside, repeated

Offsets = NDArray[np.float64]


def plane_costs(
    reference: Float,
    views: Float,
    down: Offsets,
    across: Offsets,
    sides: NDArray[np.int32],
    apertures: tuple[Float, Float],
    margin: int,
    limit: float,
) -> Float:
    """Cost (H, W) of one plane: that of the best aperture, a mean over 3×3 px plus its penalty."""
    height, width = reference.shape
    differences = np.array(
        [
            np.minimum(np.abs(_sampled(view, y, x + margin, (height, width)) - reference), limit)
            for view, y, x in zip(views, down, across, strict=True)
        ]
    )
    costs = []
    for chosen, weight, penalty in zip(_apertures(sides), *apertures, strict=False):
        total = differences[chosen].sum(axis=0)
        total = sum(total[repeated(move, height + move, height)] for move in (-1, 0, 1))
        total = sum(total[:, repeated(move, width + move, width)] for move in (-1, 0, 1))
        costs.append(total * weight + penalty)
    return np.asarray(np.min(costs, axis=0), np.float32)


def _apertures(sides: NDArray[np.int32]) -> list[NDArray[np.bool_]]:
    """Which views belong to each: all; those not to the right, not to the left, not below, not above."""
    beyond = [sides[:, axis] * side > 0 for axis, side in ((1, 1), (1, -1), (0, 1), (0, -1))]
    return [np.ones(len(sides), np.bool_), *(~each for each in beyond)]


def _sampled(view: Float, down: float, across: float, size: tuple[int, int]) -> NDArray[np.float64]:
    """A view's pixels from a place on; above and below, its border repeats."""
    top, left = int(np.floor(down)), int(np.floor(across))
    part_y, part_x = down - top, across - left
    rows = [view[repeated(start, start + size[0], len(view))].astype(np.float64) for start in (top, top + 1)]
    line = (1 - part_y) * rows[0] + part_y * rows[1]
    return np.asarray(
        (1 - part_x) * line[:, left : left + size[1]] + part_x * line[:, left + 1 : left + 1 + size[1]]
    )


def beside_best(costs: Float, apart: int) -> tuple[NDArray[np.int32], Float]:
    """Best plane of costs (K, H, W), and four: its own, those before and after it, the least far from it.

    At an end of the planes its own cost stands in for one that is not there.
    """
    planes = np.arange(len(costs))[:, None, None]
    best = costs.argmin(axis=0)
    before, at, after = (
        np.take_along_axis(costs, np.clip(best + move, 0, len(costs) - 1)[None], 0)[0] for move in (-1, 0, 1)
    )
    far = np.where(np.abs(planes - best) > apart, costs, np.inf).min(axis=0)
    return best.astype(np.int32), np.stack([at, before, after, far]).astype(np.float32)


def seen(disparity: Float, offset: tuple[float, float], plane: float, jump: float) -> Float:
    """Nearest disparity that lands on each pixel of a view: of pixels, and of points halfway between them.

    There is none halfway where the disparity jumps.
    """
    height, width = disparity.shape
    front = np.full(disparity.shape, -np.inf, np.float32)
    for down, across in product((0, 1), repeat=2):
        here, there = disparity[: height - down, : width - across], disparity[down:, across:]
        y, x = np.mgrid[: height - down, : width - across]
        shift = 0.5 * (here + there).astype(np.float64) - plane
        row = np.rint(y + 0.5 * down - offset[0] * shift).astype(np.int64)
        column = np.rint(x + 0.5 * across - offset[1] * shift).astype(np.int64)
        lands = (np.abs(there - here) < jump) & (row >= 0) & (row < height) & (column >= 0) & (column < width)
        np.maximum.at(front, (row[lands], column[lands]), np.minimum(here, there)[lands])
    return front


def gather(
    view: NDArray[Any],
    offset: tuple[float, float],
    disparity: Float,
    total: Float,
    count: Float,
    front: Float,
    limit: Float,
) -> None:
    """Add a view's samples where it shows the points of a map, unless something in front of them touches."""
    height, width = disparity.shape
    y, x = np.mgrid[:height, :width]
    row, column = (at - step * disparity.astype(np.float64) for at, step in zip((y, x), offset, strict=True))
    shown = inside(row, column, (height, width))
    row, column = np.where(shown, row, 0), np.where(shown, column, 0)
    for rows, columns in product((np.floor(row), np.ceil(row)), (np.floor(column), np.ceil(column))):
        shown &= front[rows.astype(np.int64), columns.astype(np.int64)] <= limit
    total[shown] += bilinear(view, row[shown], column[shown]).astype(np.float32)
    count[shown] += 1
