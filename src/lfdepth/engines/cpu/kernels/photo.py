"""Row kernels of the photo-consistency vote.

A few rows of one view after another are interpolated into a scratch of a few kilobytes and counted at once:
memory gives neighbouring rows of a view faster than single rows of many views. As in `voting_kernels`,
offsets are flat and unsigned and arithmetic 16 bits wide.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.layout import COLOUR_UNIT as UNIT
from lfdepth.engines.layout import COLOUR_WHITE as WHITE
from lfdepth.engines.layout import FEWEST_SEEING

_BLOCK = 32  # rows worked at once
_ONE = np.uintp(1)
_SHIFT, _HALF, _PART = np.uint16(7), np.uint16(64), np.uint16(127)  # of a sum with weights in 1/UNIT


@nb.njit(**INNER)
def _interpolate_bytes(out, start, size, source, upper, lower, w00, w01, w10, w11):
    """Levels in 1/UNIT of an 8-bit level, from levels."""
    for x in range(size):
        out[start + x] = np.int16(
            source[upper + x] * w00
            + source[upper + _ONE + x] * w01
            + source[lower + x] * w10
            + source[lower + _ONE + x] * w11
        )


@nb.njit(**INNER)
def _interpolate_words(out, start, size, source, upper, lower, w00, w01, w10, w11):
    """Levels in 1/UNIT of an 8-bit level, from the same; halves are rounded up.

    Whole levels and their parts are weighted apart, either of which fits 16 bits.
    """
    for x in range(size):
        a, b = source[upper + x], source[upper + _ONE + x]
        c, d = source[lower + x], source[lower + _ONE + x]
        whole = (a >> _SHIFT) * w00 + (b >> _SHIFT) * w01 + (c >> _SHIFT) * w10 + (d >> _SHIFT) * w11
        part = np.uint16(
            (a & _PART) * w00 + (b & _PART) * w01 + (c & _PART) * w10 + (d & _PART) * w11 + _HALF
        )
        out[start + x] = np.int16(whole + (part >> _SHIFT))


@nb.njit(**INNER)
def interpolate(out, channels, source, upper, lower, length, w00, w01, w10, w11):
    """All channels of one view's row, side by side in `out`."""
    size = np.uintp(out.size // channels)
    for c in range(channels):
        start, step = np.uintp(c) * size, np.uintp(c * length)
        if source.itemsize == 1:
            _interpolate_bytes(out, start, size, source, upper + step, lower + step, w00, w01, w10, w11)
        else:
            _interpolate_words(out, start, size, source, upper + step, lower + step, w00, w01, w10, w11)


@nb.njit(**INNER, inline="always")
def _distance(a, b):
    """Distance of two levels; neither exceeds 15 bits."""
    return np.uint16(max(a, b) - min(a, b))


@nb.njit(**INNER)
def _count_grey(votes, bounds, levels, reference):
    """Count one view where its difference to the reference view's row is below the bound."""
    for x in range(votes.size):
        votes[x] = np.int16(votes[x] + np.int16(_distance(levels[x], reference[x]) < bounds[x]))


@nb.njit(**INNER)
def _agrees(bounds, levels, reference, x, size):
    """Whether the differences to the reference view, summed over RGB, are below the bound.

    The sum of two differences fits 16 bits. That of three may not, so the third is compared with what the
    two leave of the bound.
    """
    red = _distance(levels[x], reference[x])
    green = _distance(levels[size + x], reference[size + x])
    blue = _distance(levels[size + size + x], reference[size + size + x])
    both = np.uint16(red + green)
    return blue < np.uint16(max(bounds[x], both) - both)


@nb.njit(**INNER)
def _count_colour(votes, bounds, levels, reference):
    """Count one view where it agrees with the reference view's row."""
    size = np.uintp(votes.size)
    for x in range(size):
        votes[x] = np.int16(votes[x] + np.int16(_agrees(bounds, levels, reference, x, size)))


@nb.njit(**INNER)
def _clear(votes, seen):
    for x in range(votes.size):
        votes[x] = 0
        seen[x] = 0


@nb.njit(**INNER)
def _integer_bounds(bounds, thresholds, scale):
    """Smallest whole sums over channels that no longer count: 16 bits, as thresholds are at most a half."""
    for x in range(thresholds.size):
        bounds[x] = np.uint16(math.ceil(np.float64(thresholds[x]) * scale))


@nb.njit(**INNER)
def _share(out, votes, possible):
    for x in range(out.size):
        out[x] = np.float32(votes[x]) / possible


@nb.njit(**INNER)
def _visible_share(out, votes, seen, everywhere, possible):
    """Share of the views that see the plane; a few of all views at least, or single views would decide.

    `seen` leaves out the views that see it `everywhere` along the row.
    """
    least, more = np.float32(FEWEST_SEEING) * possible, np.float32(everywhere)
    for x in range(out.size):
        out[x] = np.float32(votes[x]) / max(np.float32(seen[x]) + more, least)


@nb.njit(**INNER)
def _horizons(horizons, disparity, front, horizon):
    """Nearest surface with which a pixel still sees the plane: any, where it lies in `front` itself."""
    for x in range(disparity.size):
        horizons[x] = np.int16(32767) if disparity[x] > front else horizon
    for x in range(disparity.size, horizons.size):
        horizons[x] = horizon


@nb.njit(**INNER)
def _count_visible_colour(votes, seen, bounds, levels, reference, horizons, nearest, start):
    """As `_count_colour`, and at once as `_add_visible`."""
    size = np.uintp(votes.size)
    for x in range(size):
        sees = nearest[start + x] <= horizons[x]
        seen[x] = np.int16(seen[x] + np.int16(sees))
        votes[x] = np.int16(votes[x] + np.int16(sees & _agrees(bounds, levels, reference, x, size)))


@nb.njit(**INNER)
def _add_visible(votes, seen, agrees, horizons, nearest, start):
    """Count one view where it sees the plane; clears `agrees`."""
    for x in range(np.uintp(votes.size)):
        sees = nearest[start + x] <= horizons[x]
        seen[x] = np.int16(seen[x] + np.int16(sees))
        votes[x] = np.int16(votes[x] + agrees[x]) if sees else votes[x]
        agrees[x] = 0


@nb.njit(**KERNEL)
def photo_kernel(
    first, last, lines, out, thresholds, data, shape, down, across, weights, present, visibility, masked
):
    """Share of the views below the threshold, for rows lines[first], ..., lines[last - 1] of one plane.

    `out` has a row for each of `lines`.

    `shape` is (V, U, H, C, row length, margin, index of the reference view). With `masked`, only views that
    see the plane count: `visibility` is (nearest surfaces per view, nearest per row of a view, whole pixels
    down and across at which they are sampled, disparity (H, W) of the pixels, beyond which of it one lies in
    front of the plane, horizon).
    """
    nearest, row_nearest, nearest_down, nearest_across, disparity, front, horizon = visibility
    horizon16 = np.int16(horizon)
    rows, columns, height, channels, length, margin, own = shape
    possible, scale = np.float32(present.sum()), np.float64(channels * WHITE)
    width = length - 2 * margin
    votes, seen = np.empty((_BLOCK, width), np.int16), np.empty((_BLOCK, width), np.int16)
    horizons, everywhere = np.empty((_BLOCK, width), np.int16), np.empty(_BLOCK, np.int64)
    bounds, agrees = np.zeros((_BLOCK, width), np.uint16), np.zeros(width, np.int16)
    reference, levels = np.empty((_BLOCK, channels * width), np.int16), np.empty(channels * width, np.int16)
    row_size = channels * length
    one, none = np.int16(UNIT), np.int16(0)
    for begin in range(first, last, _BLOCK):
        block = min(_BLOCK, last - begin)
        view = own * height
        for i in range(block):
            y = lines[begin + i]
            start = np.uintp((view + y) * row_size + margin)
            interpolate(reference[i], channels, data, start, start, length, one, none, none, none)
            _integer_bounds(bounds[i], thresholds[y], scale)
            _clear(votes[i], seen[i])
            everywhere[i] = 0
            if masked:
                _horizons(horizons[i], disparity[y], front, horizon16)
        for v in range(rows):
            for u in range(columns):
                if not present[v, u]:
                    continue
                view = (v * columns + u) * height
                column = margin + across[v, u]
                w00, w01, w10, w11 = weights[v, u]
                for i in range(block):
                    y = lines[begin + i]
                    upper = min(max(y + down[v, u], 0), height - 1)
                    lower = min(max(y + down[v, u] + 1, 0), height - 1)
                    above = np.uintp((view + upper) * row_size + column)
                    below = np.uintp((view + lower) * row_size + column)
                    interpolate(levels, channels, data, above, below, length, w00, w01, w10, w11)
                    whole, at = True, np.uintp(0)
                    if masked:
                        there = y + nearest_down[v, u]
                        if 0 <= there < height:  # beside the picture nothing is known that hides the plane
                            whole = row_nearest[view + there] <= horizon16
                            at = np.uintp((view + there) * length + margin + nearest_across[v, u])
                    everywhere[i] += whole
                    if whole and channels == 1:
                        _count_grey(votes[i], bounds[i], levels, reference[i])
                    elif whole:
                        _count_colour(votes[i], bounds[i], levels, reference[i])
                    elif channels == 1:
                        _count_grey(agrees, bounds[i], levels, reference[i])
                        _add_visible(votes[i], seen[i], agrees, horizons[i], nearest, at)
                    else:
                        _count_visible_colour(
                            votes[i], seen[i], bounds[i], levels, reference[i], horizons[i], nearest, at
                        )
        for i in range(block):
            if masked:
                _visible_share(out[begin + i], votes[i], seen[i], everywhere[i], possible)
            else:
                _share(out[begin + i], votes[i], possible)
