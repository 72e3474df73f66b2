"""Kernel of exact visibility."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.cpu.kernels.runs import RUN, find_breaks, run_length

_STRETCH = 64
"""Pixels of a row that are looked at for gaps at once."""


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
def _land(out, start, step, disparity, row):
    """Where a row's pixels, from `start` on, land along one axis, in whole pixels."""
    for x in range(np.uintp(out.size)):
        out[x] = np.int32(np.floor(start[x] - step * disparity[row + x] + np.float32(0.5)))


@nb.njit(**INNER)
def _flat(places, rows, columns, height, stride):
    """Places as one number, rows `stride` apart; −1 outside of the view."""
    width, last, step = np.int32(places.size), np.int32(height), np.int32(stride)
    for x in range(np.uintp(places.size)):
        inside = (columns[x] >= 0) & (columns[x] < width) & (rows[x] >= 0) & (rows[x] < last)
        places[x] = rows[x] * step + columns[x] if inside else np.int32(-1)


@nb.njit(**INNER)
def _put_run(nearest, at, levels, start, length):
    """Put levels side by side, where nothing nearer is there."""
    for x in range(length):
        nearest[at + x] = max(nearest[at + x], levels[start + x])


@nb.njit(**INNER)
def _put_each(nearest, start, levels, row, first, last, places):
    """Put levels where they land in the view, where nothing nearer is there."""
    for x in range(first, last):
        if places[x] >= 0:
            at = start + np.uintp(places[x])
            nearest[at] = max(nearest[at], levels[row + x])


@nb.njit(**INNER)
def _put_row(nearest, start, levels, row, places, breaks):
    """Put a row's levels from `row` on at their places."""
    find_breaks(breaks, places)
    block, one = np.uintp(0), np.uintp(1)
    while block < breaks.size:
        x = block * np.uintp(RUN)
        if breaks[block] != 0:
            _put_each(nearest, start, levels, row, x, x + np.uintp(RUN), places)
            block += one
            continue
        length = run_length(breaks, block, places)
        _put_run(nearest, start + np.uintp(places[x]), levels, row + x, length)
        block += length // np.uintp(RUN)
    x = np.uintp(breaks.size) * np.uintp(RUN)
    _put_each(nearest, start, levels, row, x, np.uintp(places.size), places)


@nb.njit(**INNER)
def _gaps(own, here, other, there, levels, level, beside, size, jump):
    """Number of places two pixels away from those of the neighbours, on one surface.

    Places are in `own` from `here` on, the neighbours' in `other` from `there` on, and their levels are in
    `levels` from `level` and from `beside` on.
    """
    count = np.int32(0)
    for x in range(size):
        change = np.float32(levels[level + x]) - np.float32(levels[beside + x])
        count += np.int32((own[here + x] - other[there + x] == 2) & (abs(change) < jump))
    return count


@nb.njit(**INNER)
def _put(nearest, start, stride, row, column, size, level):
    """Put a level where it lands, if that is inside the view and nothing nearer is there."""
    if 0 <= row < size[0] and 0 <= column < size[1]:
        at = start + row * stride + column
        nearest[at] = max(nearest[at], level)


@nb.njit(**INNER)
def _fill_gaps(nearest, view, landed, own, other, step, levels, row, jump):
    """Put the farther one of two neighbours on one surface between them where they land two pixels apart.

    `view` is (where it starts, length of its rows, its size), `landed` the rows and columns at which the
    pixels of a row land, `own` one of the two, and `other` that of the neighbours, `step` (up, left).
    """
    start, stride, size = view
    up, left = step
    back = np.uintp(up * own.size + left)
    for begin in range(left, own.size, _STRETCH):
        end = min(begin + _STRETCH, own.size)
        x = np.uintp(begin)
        here = row + x
        length = np.uintp(end - begin)
        if _gaps(own, x, other, x - np.uintp(left), levels, here, here - back, length, jump) == 0:
            continue
        for x in range(np.uintp(begin), np.uintp(end)):
            level, beside = levels[row + x], levels[row + x - back]
            if own[x] - other[x - np.uintp(left)] == 2 and abs(np.float32(level) - np.float32(beside)) < jump:
                to_row, column = landed[0][x] - up, landed[1][x] - left
                _put(nearest, start, stride, to_row, column, size, min(level, beside))


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
    here_x = np.empty(width, np.int32)
    places, breaks = np.empty(width, np.int32), np.empty(width // RUN, np.int32)
    depths, flat = disparity.reshape(-1), levels.reshape(-1)
    # Converted once: LLVM has no vector instruction for it.
    across, down = np.arange(width).astype(np.float32), np.empty(width, np.float32)
    for view in range(first, last):
        v, u = view // columns, view % columns
        if not present[v, u]:
            continue
        start = (v * columns + u) * height * row_length
        for y in range(height):
            _clear(nearest, np.uintp(start + y * row_length), row_length, nothing)
        start += margin
        dv, du = np.float32(offsets[v, u, 0]), np.float32(offsets[v, u, 1])
        place = (start, row_length, size)
        for y in range(height):
            row = np.uintp(y * width)
            down[:] = y
            _land(here_x, across, du, depths, row)
            _land(here_y, down, dv, depths, row)
            _flat(places, here_y, here_x, height, row_length)
            _put_row(nearest, np.uintp(start), flat, row, places, breaks)
            landed = (here_y, here_x)
            if du != 0:
                _fill_gaps(nearest, place, landed, here_x, here_x, (0, 1), flat, row, jump)
            if y > 0 and dv != 0:
                _fill_gaps(nearest, place, landed, here_y, above_y, (1, 0), flat, row, jump)
            here_y, above_y = above_y, here_y
        for y in range(height):
            row_of_view = (v * columns + u) * height + y
            row_nearest[row_of_view] = _greatest(nearest, np.uintp(row_of_view * row_length), row_length)
