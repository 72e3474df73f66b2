"""Kernels of `lfdepth.render.refocus`."""

# numba ships no types for its decorators
# mypy: disallow-untyped-decorators=False
from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

Map = npt.NDArray[np.float32]


@njit(cache=True, nogil=True)
def splat_kernel(front: Map, disparity: Map, plane: float, v: float, u: float, jump: float) -> None:
    """Nearest disparity that lands on each pixel of view (u, v) as seen from a plane; starts at −inf.

    A pixel lands at (x, y) − (u, v)·(D − plane). So do the points halfway to its neighbours to the right,
    below and diagonally, unless the disparity jumps in between: else a surface that is wider in the view than
    in the reference view would have gaps.
    """
    height, width = disparity.shape
    for y in range(height):
        for x in range(width):
            here = disparity[y, x]
            for down in range(min(2, height - y)):
                for across in range(min(2, width - x)):
                    there = disparity[y + down, x + across]
                    if abs(there - here) >= jump:
                        continue
                    shift = 0.5 * (here + there) - plane
                    row = int(np.rint(y + 0.5 * down - v * shift))
                    column = int(np.rint(x + 0.5 * across - u * shift))
                    nearer = min(here, there)
                    if 0 <= row < height and 0 <= column < width and nearer > front[row, column]:
                        front[row, column] = nearer


@njit(cache=True, nogil=True)
def gather_kernel(
    first: int,
    last: int,
    total: Map,
    count: Map,
    view: npt.NDArray[Any],
    v: float,
    u: float,
    disparity: Map,
    front: Map,
    nearest: Map,
) -> None:
    """Add view (u, v), sampled where the points of the reference view at `disparity` appear in it.

    Samples outside the view do not count, nor do those that touch a pixel whose `front`, the disparity of
    what the view shows there, is above `nearest`, a limit for each point.
    """
    height, width, channels = view.shape
    for y in range(first, last):
        for x in range(width):
            row, column = y - v * disparity[y, x], x - u * disparity[y, x]
            if not (0 <= row <= height - 1 and 0 <= column <= width - 1):
                continue
            top, left = int(row), int(column)
            bottom, right = int(np.ceil(row)), int(np.ceil(column))
            limit = nearest[y, x]
            if max(front[top, left], front[top, right], front[bottom, left], front[bottom, right]) > limit:
                continue
            below, beside = np.float32(row - top), np.float32(column - left)
            above, before = np.float32(1) - below, np.float32(1) - beside
            for c in range(channels):
                upper = before * view[top, left, c] + beside * view[top, right, c]
                lower = before * view[bottom, left, c] + beside * view[bottom, right, c]
                total[y, x, c] += above * upper + below * lower
            count[y, x] += np.float32(1)
