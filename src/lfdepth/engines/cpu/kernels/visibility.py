"""Kernel of exact visibility."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.layout import UNKNOWN_SURFACE as EMPTY


@nb.njit(**INNER)
def _clear(nearest, start, size):
    for x in range(np.uintp(size)):
        nearest[start + x] = EMPTY


@nb.njit(**INNER)
def _greatest(values, start, size):
    greatest = np.int16(EMPTY)
    for x in range(np.uintp(size)):
        greatest = max(greatest, values[start + x])
    return greatest


@nb.njit(**INNER)
def _places(places, disparity, y, dv, du, height, stride):
    """Where a row's pixels fall in one view, rows `stride` apart; −1 outside."""
    width = disparity.size
    for x in range(width):
        here = disparity[x]
        to_x = np.int32(np.floor(np.float32(x) - du * here + np.float32(0.5)))
        to_y = np.int32(np.floor(np.float32(y) - dv * here + np.float32(0.5)))
        inside = (to_x >= 0) & (to_x < width) & (to_y >= 0) & (to_y < height)
        places[x] = to_y * np.int32(stride) + to_x if inside else np.int32(-1)


@nb.njit(**KERNEL)
def splat_kernel(first, last, disparity, levels, present, offsets, nearest, row_nearest, margin, row_length):
    """Splat `levels` into the present ones of views [first, last), counted row by row; nearest wins.

    `levels` (H, W) is the disparity in parts; `offsets` (V, U, 2) say where views stand; `nearest` is flat,
    laid out (V, U, H, row_length), and `row_nearest` holds the nearest of each row.
    """
    height, width = disparity.shape
    columns = present.shape[1]
    places = np.empty(width, np.int32)
    stride = row_length
    for view in range(first, last):
        v, u = view // columns, view % columns
        if not present[v, u]:
            continue
        start = (v * columns + u) * height * row_length
        for y in range(height):
            _clear(nearest, np.uintp(start + y * stride), row_length)
        dv, du = np.float32(offsets[v, u, 0]), np.float32(offsets[v, u, 1])
        for y in range(height):
            _places(places, disparity[y], y, dv, du, height, stride)
            for x in range(width):
                if places[x] >= 0:
                    at = start + margin + places[x]
                    nearest[at] = max(nearest[at], levels[y, x])
        for y in range(height):
            row = (v * columns + u) * height + y
            row_nearest[row] = _greatest(nearest, np.uintp(row * row_length), row_length)
