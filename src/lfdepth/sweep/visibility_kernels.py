"""Kernel of exact visibility."""

from __future__ import annotations

import numba as nb
import numpy as np

PARTS = 1000
"""Parts of a px per view step in which disparities are kept."""

SATURATED = 32000
"""Largest disparity that is told apart, in these parts."""

EMPTY = -32768
"""Where no surface is known."""


@nb.njit(nogil=True, cache=True)
def splat_kernel(first, last, disparity, nearest, margin):
    """Splat the map into views [first, last), counted row by row of the grid; nearest wins."""
    height, width = disparity.shape
    rows, _, columns, _ = nearest.shape
    limit = np.float32(SATURATED)
    for view in range(first, last):
        v, u = view // columns, view % columns
        dv, du = np.float32(v - rows // 2), np.float32(u - columns // 2)
        for y in range(height):
            for x in range(width):
                here = disparity[y, x]
                to_x = int(np.floor(np.float32(x) - du * here + np.float32(0.5)))
                to_y = int(np.floor(np.float32(y) - dv * here + np.float32(0.5)))
                if 0 <= to_x < width and 0 <= to_y < height:
                    level = np.int16(min(max(here * np.float32(PARTS), -limit), limit))
                    if nearest[v, to_y, u, margin + to_x] < level:
                        nearest[v, to_y, u, margin + to_x] = level
