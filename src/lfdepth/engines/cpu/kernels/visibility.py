"""Kernel of exact visibility."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL


@nb.njit(**INNER)
def _clear(nearest, start, size, nothing):
    for x in range(np.uintp(size)):
        nearest[start + x] = nothing


@nb.njit(**INNER)
def _greatest(values, start, size):
    greatest = values[start]
    for x in range(np.uintp(size)):
        greatest = max(greatest, values[start + x])
    return greatest


@nb.njit(**INNER)
def _places(rows, columns, disparity, y, dv, du):
    """Rows and columns at which a row's pixels land in one view."""
    for x in range(disparity.size):
        here = disparity[x]
        columns[x] = np.int32(np.floor(np.float32(x) - du * here + np.float32(0.5)))
        rows[x] = np.int32(np.floor(np.float32(y) - dv * here + np.float32(0.5)))


@nb.njit(**INNER)
def _flat(places, rows, columns, height, stride):
    """Places as one number, rows `stride` apart; −1 outside of the view."""
    width = places.size
    for x in range(width):
        inside = (columns[x] >= 0) & (columns[x] < width) & (rows[x] >= 0) & (rows[x] < height)
        places[x] = rows[x] * np.int32(stride) + columns[x] if inside else np.int32(-1)


@nb.njit(**INNER)
def _gaps(here, before, level, other, jump):
    """Number of places two pixels away from that of the neighbour, on one surface."""
    count = 0
    for x in range(here.size):
        count += (here[x] - before[x] == 2) & (abs(level[x] - other[x]) < jump)
    return count


@nb.njit(**INNER)
def _put(nearest, start, stride, row, column, size, level):
    """Put a level where it lands, if that is inside the view and nothing nearer is there."""
    if 0 <= row < size[0] and 0 <= column < size[1]:
        at = start + row * stride + column
        nearest[at] = max(nearest[at], level)


@nb.njit(**KERNEL)
def splat_kernel(
    first,
    last,
    disparity,
    levels,
    present,
    offsets,
    nearest,
    row_nearest,
    margin,
    row_length,
    jump,
    nothing,
):
    """Splat `levels` into the present ones of views [first, last), counted row by row; nearest wins.

    Pixels land by `disparity` (H, W), and leave `levels` (H, W), `nothing` where none lands. `offsets`
    (V, U, 2) say where views stand; `nearest` is flat, laid out (V, U, H, row_length), and `row_nearest`
    holds the nearest of each row. Where neighbours whose levels differ by less than `jump` land two pixels
    apart, the farther one also lands between them.
    """
    size, columns = disparity.shape, present.shape[1]
    height, width = size
    here_y, above_y = np.empty(width, np.int32), np.empty(width, np.int32)
    here_x, above_x = np.empty(width, np.int32), np.empty(width, np.int32)
    places = np.empty(width, np.int32)
    for view in range(first, last):
        v, u = view // columns, view % columns
        if not present[v, u]:
            continue
        start = (v * columns + u) * height * row_length
        for y in range(height):
            _clear(nearest, np.uintp(start + y * row_length), row_length, nothing)
        start += margin
        dv, du = np.float32(offsets[v, u, 0]), np.float32(offsets[v, u, 1])
        for y in range(height):
            _places(here_y, here_x, disparity[y], y, dv, du)
            _flat(places, here_y, here_x, height, row_length)
            for x in range(width):
                if places[x] >= 0:
                    at = start + places[x]
                    nearest[at] = max(nearest[at], levels[y, x])
            if _gaps(here_x[1:], here_x[:-1], levels[y, 1:], levels[y, :-1], jump) > 0:
                for x in range(1, width):
                    if here_x[x] - here_x[x - 1] == 2 and abs(levels[y, x] - levels[y, x - 1]) < jump:
                        low = min(levels[y, x], levels[y, x - 1])
                        _put(nearest, start, row_length, here_y[x], here_x[x] - 1, size, low)
            if y > 0 and _gaps(here_y, above_y, levels[y], levels[y - 1], jump) > 0:
                for x in range(width):
                    if here_y[x] - above_y[x] == 2 and abs(levels[y, x] - levels[y - 1, x]) < jump:
                        low = min(levels[y, x], levels[y - 1, x])
                        _put(nearest, start, row_length, here_y[x] - 1, here_x[x], size, low)
            here_y, above_y = above_y, here_y
            here_x, above_x = above_x, here_x
        for y in range(height):
            row = (v * columns + u) * height + y
            row_nearest[row] = _greatest(nearest, np.uintp(row * row_length), row_length)
