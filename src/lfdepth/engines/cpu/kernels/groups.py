"""Kernels of groups of views: what each group shows of a plane, and which views belong together."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.cpu.kernels.photo import interpolate
from lfdepth.engines.layout import COLOUR_UNIT as UNIT
from lfdepth.engines.layout import COLOUR_WHITE as WHITE

_BLOCK = 8  # rows worked at once: their sums stay in the second-level cache


@nb.njit(**INNER)
def _add(sums, squares, levels, reference, member, start):
    """Add one view's differences in one channel, where it is a member."""
    for x in range(np.uintp(member.size)):
        change = np.float32(levels[start + x] - reference[start + x]) * np.float32(member[x])
        sums[start + x] += change
        squares[x] += change * change


@nb.njit(**INNER)
def _count(counts, member):
    for x in range(np.uintp(member.size)):
        counts[x] += np.float32(member[x])


@nb.njit(**INNER)
def _finish(sums, squares, counts, size, mean, variance):
    """Mean of each channel and unbiased variance, all channels together, in parts of full scale."""
    scale = np.float32(1.0 / WHITE)
    for x in range(counts.size):
        total = squares[x] * scale * scale
        share = np.float32(1) / max(counts[x], np.float32(1))
        for c in range(mean.shape[0]):
            part = sums[c * size + x] * scale
            mean[c, x] = part * share
            total -= part * part * share
        variance[x] = max(total, np.float32(0)) / max(counts[x] - np.float32(1), np.float32(1))


@nb.njit(**KERNEL)
def group_kernel(first, last, groups, data, shape, down, across, weights, present, means, variances):
    """Means and variances of two groups of views at one plane, in rows [first, last).

    `groups` (2, V·U, H, W) uint8 is 1 where a view belongs to a group. `means` (2, C, H, W) are less the
    reference view's levels; `variances` (2, H, W) of all channels together.
    """
    rows, columns, height, channels, length, margin, own = shape
    width = length - 2 * margin
    inner = groups.shape[3]
    sums = np.empty((_BLOCK, 2, channels * width), np.float32)
    squares, counts = np.empty((_BLOCK, 2, inner), np.float32), np.empty((_BLOCK, 2, inner), np.float32)
    reference, levels = np.empty((_BLOCK, channels * width), np.int16), np.empty(channels * width, np.int16)
    row_size = channels * length
    one, none = np.int16(UNIT), np.int16(0)
    for begin in range(first, last, _BLOCK):
        block = min(_BLOCK, last - begin)
        sums[:], squares[:], counts[:] = 0, 0, 0
        for i in range(block):
            start = np.uintp((own * height + begin + i) * row_size + margin)
            interpolate(reference[i], channels, data, start, start, length, one, none, none, none)
        for v in range(rows):
            for u in range(columns):
                if not present[v, u]:
                    continue
                n = v * columns + u
                column = margin + across[v, u]
                w00, w01, w10, w11 = weights[v, u]
                for i in range(block):
                    y = begin + i
                    upper = min(max(y + down[v, u], 0), height - 1)
                    lower = min(max(y + down[v, u] + 1, 0), height - 1)
                    above = np.uintp((n * height + upper) * row_size + column)
                    below = np.uintp((n * height + lower) * row_size + column)
                    interpolate(levels, channels, data, above, below, length, w00, w01, w10, w11)
                    for group in range(2):
                        member = groups[group, n, y]
                        _count(counts[i, group], member)
                        for c in range(channels):
                            start = np.uintp(c * width)
                            _add(sums[i, group], squares[i, group], levels, reference[i], member, start)
        for i in range(block):
            y = begin + i
            for group in range(2):
                found = (means[group, :, y], variances[group, y])
                _finish(sums[i, group], squares[i, group], counts[i, group], width, *found)


@nb.njit(**INNER)
def _distance(colours, n, centres, k):
    total = 0.0
    for c in range(colours.shape[1]):
        total += (colours[n, c] - centres[k, c]) ** 2
    return total


@nb.njit(**INNER)
def _seed(colours, centres, middle, nearest):
    """Centres: the middle's colour, and one after another the colour farthest from those so far."""
    centres[0] = colours[middle]
    nearest[:] = np.inf
    for k in range(1, len(centres)):
        farthest, at = -1.0, 0
        for n in range(len(colours)):
            nearest[n] = min(nearest[n], _distance(colours, n, centres, k - 1))
            if nearest[n] > farthest:
                farthest, at = nearest[n], n
        centres[k] = colours[at]


@nb.njit(**INNER)
def _assign(colours, centres, cluster):
    """Each colour's nearest centre; whether any has changed."""
    changed = False
    for n in range(len(colours)):
        best, least = 0, _distance(colours, n, centres, 0)
        for k in range(1, len(centres)):
            distance = _distance(colours, n, centres, k)
            if distance < least:
                best, least = k, distance
        changed |= cluster[n] != best
        cluster[n] = best
    return changed


@nb.njit(**INNER)
def _move_centres(colours, cluster, centres):
    for k in range(len(centres)):
        count = 0
        total = np.zeros(colours.shape[1])
        for n in range(len(colours)):
            if cluster[n] == k:
                count += 1
                total += colours[n]
        if count > 0:
            centres[k] = total / count


@nb.njit(**INNER)
def _join(centres, alike, own):
    """Which clusters are one with the middle's, directly or through another."""
    joined = np.zeros(len(centres), np.bool_)
    joined[own] = True
    for _ in range(len(centres)):
        for k in range(len(centres)):
            for other in range(len(centres)):
                if joined[other] and _distance(centres, k, centres, other) < alike * alike:
                    joined[k] = True
    return joined


@nb.njit(**INNER)
def _grow(region, allowed, side):
    """Grow the region over allowed neighbours."""
    growing = True
    while growing:
        growing = False
        for n in range(side * side):
            if region[n] or not allowed[n]:
                continue
            y, x = n // side, n % side
            for i in range(max(y - 1, 0), min(y + 2, side)):
                for j in range(max(x - 1, 0), min(x + 2, side)):
                    if region[i * side + j]:
                        region[n] = True
            growing |= region[n]


@nb.njit(**KERNEL)
def region_kernel(first, last, picture, points, radius, clusters, alike, rounds, out):
    """Regions (P, side²) of points [first, last) in the patches around them (`Engine.patch_regions`)."""
    height, width, channels = picture.shape
    side = 2 * radius + 1
    middle = side * radius + radius
    colours, centres = np.empty((side * side, channels)), np.empty((clusters, channels))
    cluster, allowed = np.empty(side * side, np.int64), np.empty(side * side, np.bool_)
    nearest = np.empty(side * side)
    for p in range(first, last):
        for n in range(side * side):
            y = min(max(points[p, 0] + n // side - radius, 0), height - 1)
            x = min(max(points[p, 1] + n % side - radius, 0), width - 1)
            for c in range(channels):
                colours[n, c] = picture[y, x, c]
        _seed(colours, centres, middle, nearest)
        cluster[:] = -1
        for _ in range(rounds):
            if not _assign(colours, centres, cluster):
                break
            _move_centres(colours, cluster, centres)
        joined = _join(centres, alike, cluster[middle])
        for n in range(side * side):
            allowed[n] = joined[cluster[n]]
            out[p, n] = n == middle
        _grow(out[p], allowed, side)
