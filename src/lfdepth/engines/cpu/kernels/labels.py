"""Kernels of cost volumes (K, H, W): minima, paths with any penalty, local means."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL

_FAR = np.float32(np.inf)


@nb.njit(**KERNEL)
def minima_kernel(first_row, last_row, volume, index, beside):
    """Least cost along the labels, and what lies around it.

    `index` (H, W) is the first label of least cost; `beside` (4, H, W) the cost there, those of the labels
    before and after it (its own at the ends), and that of the next lowest local minimum, or where there is
    none the largest cost.
    """
    count, _, width = volume.shape
    falling = np.empty(width, np.bool_)
    largest, second = np.empty(width, np.float32), np.empty(width, np.float32)
    for y in range(first_row, last_row):
        best, before, after, other = beside[0, y], beside[1, y], beside[2, y], beside[3, y]
        at = index[y]
        for x in range(width):
            value = volume[0, y, x]
            at[x] = 0
            best[x] = before[x] = after[x] = largest[x] = value
            falling[x] = True
            other[x] = second[x] = _FAR
        for k in range(1, count):
            for x in range(width):
                value, last = volume[k, y, x], volume[k - 1, y, x]
                if at[x] == k - 1:
                    after[x] = value
                if value > last and falling[x]:  # the label before was a local minimum
                    _take_minimum(other, second, x, last)
                    falling[x] = False
                elif value < last:
                    falling[x] = True
                largest[x] = max(largest[x], value)
                if value < best[x]:
                    at[x] = k
                    best[x], before[x], after[x] = value, last, value
        for x in range(width):
            if falling[x]:
                _take_minimum(other, second, x, volume[count - 1, y, x])
            other[x] = second[x] if second[x] < _FAR else largest[x]


@nb.njit(**INNER)
def _take_minimum(lowest, second, x, value):
    """Keep the two lowest of the local minima."""
    if value < lowest[x]:
        second[x] = lowest[x]
        lowest[x] = value
    else:
        second[x] = min(second[x], value)


@nb.njit(**INNER)
def _reach(reached, path, table, weight, least):
    """Least cost to reach each label from the pixel before, above the least there; `path` is padded."""
    count = reached.size
    cut = np.uintp(table.size - 1)
    ceiling = weight * table[cut]
    for k in range(count):
        reached[k] = min(path[np.uintp(k) + cut] - least, ceiling)
    for change in range(1, table.size - 1):
        low, high = cut - np.uintp(change), cut + np.uintp(change)
        penalty = weight * table[change] - least
        for k in range(np.uintp(count)):
            reached[k] = min(reached[k], min(path[k + low], path[k + high]) + penalty)


@nb.njit(**INNER)
def _arrive(path, reached, energy, total, cut):
    """Add a pixel's own costs to the path, and the path to the total; its least."""
    least = _FAR
    for k in range(np.uintp(reached.size)):
        cost = reached[k] + energy[k]
        path[k + cut] = cost
        total[k] += cost
        least = min(least, cost)
    return least


@nb.njit(**INNER)
def _line(line, step, height, width):
    """First pixel and length of a line: lines run down, or across where they do not go down."""
    down, across = step
    if down == 0:
        return line, 0, width
    if across == 0:
        return 0, line, height
    y, x = max(line - width + 1, 0), min(line, width - 1)  # from the top row on, then down an edge
    if across > 0:
        x = width - 1 - x
        return y, x, min(height - y, width - x)
    return y, x, min(height - y, x + 1)


@nb.njit(**KERNEL)
def path_kernel(first_line, last_line, energy, total, weights, table, step):
    """Add the best paths along some lines, both ways, to `total`; both (H, W, K).

    A line leads from pixel to pixel by `step` (down, across): (0, 1), (1, 0), (1, 1) or (1, −1). `weights`
    (H, W) are those between a pixel and the next.
    """
    height, width, count = energy.shape
    down, across = step
    cut = np.uintp(table.size - 1)
    path, reached = np.full(count + 2 * (table.size - 1), _FAR, np.float32), np.empty(count, np.float32)
    for line in range(first_line, last_line):
        top, left, length = _line(line, step, height, width)
        for way in (1, -1):
            start = 0 if way == 1 else length - 1
            least = _FAR
            for i in range(length):
                at = start + way * i
                y, x = top + at * down, left + at * across
                if i == 0:
                    reached[:] = 0
                else:
                    pair = at - 1 if way == 1 else at
                    weight = weights[top + pair * down, left + pair * across]
                    _reach(reached, path, table, weight, least)
                least = _arrive(path, reached, energy[y, x], total[y, x], cut)


@nb.njit(**INNER)
def _add_weighted(out, weights, row):
    for x in range(out.size):
        out[x] += weights[x] * row[x]


@nb.njit(**KERNEL)
def local_mean_kernel(first_row, last_row, volume, weights, around, out):
    """Weighted sums of the pixels `around` (N, 2), px down and across; weights are (H, N, W)."""
    count, height, width = volume.shape
    for y in range(first_row, last_row):
        for k in range(count):
            out[k, y] = 0
            for n in range(len(around)):
                down, across = around[n]
                if 0 <= y + down < height:
                    start, end = max(0, -across), min(width, width - across)
                    row = volume[k, y + down, start + across : end + across]
                    _add_weighted(out[k, y, start:end], weights[y, n, start:end], row)
