"""Row kernels of the photo-consistency vote.

One view's row is interpolated into a scratch of a few kilobytes and counted at once. As in `voting_kernels`,
offsets are flat and unsigned and arithmetic 16 bits wide.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

UNIT = 128
"""Sum of the four bilinear weights, parts of a pixel that shifts are rounded to, and of an 8-bit level."""

WHITE = 255 * UNIT
"""Full scale of interpolated levels; fits 15 bits."""

_ONE = np.uintp(1)
_SHIFT, _HALF, _PART = np.uint16(7), np.uint16(64), np.uint16(127)  # of a sum with weights in 1/UNIT


@nb.njit(nogil=True, cache=True)
def _interpolate_bytes(out, start, size, source, upper, lower, w00, w01, w10, w11):
    """Levels in 1/UNIT of an 8-bit level, from levels."""
    for x in range(size):
        out[start + x] = np.int16(
            source[upper + x] * w00
            + source[upper + _ONE + x] * w01
            + source[lower + x] * w10
            + source[lower + _ONE + x] * w11
        )


@nb.njit(nogil=True, cache=True)
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


@nb.njit(nogil=True, cache=True)
def _interpolate(out, channels, source, upper, lower, length, w00, w01, w10, w11):
    """All channels of one view's row, side by side in `out`."""
    size = np.uintp(out.size // channels)
    for c in range(channels):
        start, step = np.uintp(c) * size, np.uintp(c * length)
        if source.itemsize == 1:
            _interpolate_bytes(out, start, size, source, upper + step, lower + step, w00, w01, w10, w11)
        else:
            _interpolate_words(out, start, size, source, upper + step, lower + step, w00, w01, w10, w11)


@nb.njit(nogil=True, cache=True, inline="always")
def _distance(a, b):
    """Distance of two levels; neither exceeds 15 bits."""
    return np.uint16(max(a, b) - min(a, b))


@nb.njit(nogil=True, cache=True)
def _count_grey(votes, bounds, levels, reference):
    """Count one view where its difference to the reference view's row is below the bound."""
    for x in range(votes.size):
        votes[x] = np.int16(votes[x] + np.int16(_distance(levels[x], reference[x]) < bounds[x]))


@nb.njit(nogil=True, cache=True)
def _count_colour(votes, bounds, levels, reference):
    """Count one view where its differences to the reference view's row, summed over RGB, are below the bound.

    The sum of two differences fits 16 bits. That of three may not, so the third is compared with what the
    two leave of the bound.
    """
    size = np.uintp(votes.size)
    for x in range(size):
        red = _distance(levels[x], reference[x])
        green = _distance(levels[size + x], reference[size + x])
        blue = _distance(levels[size + size + x], reference[size + size + x])
        both = np.uint16(red + green)
        left = np.uint16(max(bounds[x], both) - both)
        votes[x] = np.int16(votes[x] + np.int16(blue < left))


@nb.njit(nogil=True, cache=True)
def _integer_bounds(bounds, thresholds, scale):
    """Smallest whole sums over channels that no longer count: 16 bits, as thresholds are at most a half."""
    for x in range(thresholds.size):
        bounds[x] = np.uint16(math.ceil(np.float64(thresholds[x]) * scale))


@nb.njit(nogil=True, cache=True)
def _share(out, votes, possible):
    for x in range(out.size):
        out[x] = np.float32(votes[x]) / possible


@nb.njit(nogil=True, cache=True)
def _visible_share(out, votes, seen, possible):
    """Share of the views that see the plane; a few of all views at least, or single views would decide."""
    least = np.float32(0.1) * possible
    for x in range(out.size):
        out[x] = np.float32(votes[x]) / max(np.float32(seen[x]), least)


@nb.njit(nogil=True, cache=True)
def _count_visible_colour(votes, seen, bounds, levels, reference, front, nearest, start, horizon):
    """As `_count_colour`, and at once as `_add_visible`."""
    size = np.uintp(votes.size)
    for x in range(size):
        red = _distance(levels[x], reference[x])
        green = _distance(levels[size + x], reference[size + x])
        blue = _distance(levels[size + size + x], reference[size + size + x])
        both = np.uint16(red + green)
        left = np.uint16(max(bounds[x], both) - both)
        sees = (nearest[start + x] <= horizon) | (front[x] != 0)
        seen[x] = np.int16(seen[x] + np.int16(sees))
        votes[x] = np.int16(votes[x] + np.int16(sees & (blue < left)))


@nb.njit(nogil=True, cache=True)
def _add_visible(votes, seen, agrees, front, nearest, start, horizon):
    """Count one view where it sees the plane, or the pixel itself lies in front; clears `agrees`."""
    for x in range(np.uintp(votes.size)):
        sees = (nearest[start + x] <= horizon) | (front[x] != 0)
        seen[x] = np.int16(seen[x] + np.int16(sees))
        votes[x] = np.int16(votes[x] + agrees[x]) if sees else votes[x]
        agrees[x] = 0


@nb.njit(nogil=True, cache=True)
def photo_kernel(
    first_row, last_row, out, thresholds, data, shape, down, across, weights, present, visibility, masked
):
    """Share of the views below the threshold, for rows [first_row, last_row) of one plane.

    `shape` is (V, U, H, C, row length, margin). With `masked`, only views that see the plane count:
    `visibility` is (nearest surfaces per view, whole pixels down and across at which they are sampled, pixels
    in front of the plane, horizon).
    """
    nearest, nearest_down, nearest_across, front, horizon = visibility
    horizon16 = np.int16(horizon)
    rows, columns, height, channels, length, margin = shape
    possible, scale = np.float32(present.sum()), np.float64(channels * WHITE)
    votes = np.empty(length - 2 * margin, np.int16)
    agrees, seen, front_row = np.zeros_like(votes), np.empty_like(votes), np.zeros_like(votes)
    bounds = np.zeros(votes.size, np.uint16)
    levels = np.empty(channels * votes.size, np.int16)
    reference = np.empty_like(levels)
    one, none = np.int16(UNIT), np.int16(0)
    for y in range(first_row, last_row):
        start = np.uintp(((rows // 2 * height + y) * columns + columns // 2) * channels * length + margin)
        _interpolate(reference, channels, data, start, start, length, one, none, none, none)
        _integer_bounds(bounds, thresholds[y], scale)
        votes[:] = 0
        seen[:] = 0
        if masked:
            front_row[: out.shape[1]] = front[y]
        for v in range(rows):
            upper = min(max(y + down[v], 0), height - 1)
            lower = min(max(y + down[v] + 1, 0), height - 1)
            for u in range(columns):
                if not present[v, u]:
                    continue
                column = margin + across[u]
                _interpolate(
                    levels,
                    channels,
                    data,
                    np.uintp(((v * height + upper) * columns + u) * channels * length + column),
                    np.uintp(((v * height + lower) * columns + u) * channels * length + column),
                    length,
                    weights[v, u, 0],
                    weights[v, u, 1],
                    weights[v, u, 2],
                    weights[v, u, 3],
                )
                if not masked:
                    if channels == 1:
                        _count_grey(votes, bounds, levels, reference)
                    else:
                        _count_colour(votes, bounds, levels, reference)
                    continue
                row = min(max(y + nearest_down[v], 0), height - 1)
                at = np.uintp(((v * height + row) * columns + u) * length + margin + nearest_across[u])
                if channels == 1:
                    _count_grey(agrees, bounds, levels, reference)
                    _add_visible(votes, seen, agrees, front_row, nearest, at, horizon16)
                else:
                    _count_visible_colour(
                        votes, seen, bounds, levels, reference, front_row, nearest, at, horizon16
                    )
        if masked:
            _visible_share(out[y], votes, seen, possible)
        else:
            _share(out[y], votes, possible)
