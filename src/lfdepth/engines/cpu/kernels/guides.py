"""Kernels of the guided filter's statistics of its guide: means over windows, in double precision.

Sums run from the image's first row and column, as they do in `engines.boxes`, so that results are the same
to the last bit wherever a band begins.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL


@nb.njit(**INNER)
def _add_up(totals, above, guide, one, other, square, size):
    """Add a row of one channel, or with `square` of its products with another, to the sums above it."""
    below = above + size
    for x in range(size):
        value = np.float64(guide[one + x])
        totals[below + x] = totals[above + x] + (value * guide[other + x] if square else value)


@nb.njit(**INNER)
def _differ(out, to, totals, last, first, count, size):
    for x in range(size):
        out[to + x] = (totals[last + x] - totals[first + x]) / count


@nb.njit(**KERNEL)
def columns_kernel(first, last, guide, pairs, radius, means):
    """Means down the windows of columns [first, last) of a guide (C, H, W), into `means` (P, H, W).

    `pairs` (P, 2) are channels whose product is meant; of one channel itself the second is −1.
    """
    size = np.uintp(last - first)
    height, width, channels = guide.shape[1], guide.shape[2], guide.reshape(-1)
    totals, out = np.zeros((height + 1) * (last - first), np.float64), means.reshape(-1)
    for p in range(len(pairs)):
        one, other = pairs[p, 0], pairs[p, 1]
        for y in range(height):
            own = np.uintp((one * height + y) * width + first)
            there = np.uintp((max(other, 0) * height + y) * width + first)
            _add_up(totals, np.uintp(y) * size, channels, own, there, other >= 0, size)
        for y in range(height):
            begin, end = max(y - radius, 0), min(y + radius + 1, height)
            to = np.uintp((p * height + y) * width + first)
            _differ(
                out, to, totals, np.uintp(end) * size, np.uintp(begin) * size, np.float64(end - begin), size
            )


@nb.njit(**INNER)
def _mean_along(row, totals, radius):
    """Replace a row by its means over windows."""
    width = row.size
    totals[0] = 0
    for x in range(width):
        totals[x + 1] = totals[x] + row[x]
    for x in range(width):
        begin, end = max(x - radius, 0), min(x + radius + 1, width)
        row[x] = (totals[end] - totals[begin]) / np.float64(end - begin)


@nb.njit(**INNER)
def _invert_grey(means, epsilon, stats):
    for x in range(means.shape[1]):
        level, square = means[0, x], means[1, x]
        stats[0, x] = level
        stats[1, x] = 1.0 / (square - level * level + epsilon)


@nb.njit(**INNER)
def _invert_colour(means, epsilon, stats):
    """Upper triangle of (Σ + ε·1)⁻¹ behind the three means."""
    for x in range(means.shape[1]):
        r, g, b = means[0, x], means[1, x], means[2, x]
        rr, rg, rb = means[3, x] - r * r, means[4, x] - r * g, means[5, x] - r * b
        gg, gb, bb = means[6, x] - g * g, means[7, x] - g * b, means[8, x] - b * b
        rr += epsilon
        gg += epsilon
        bb += epsilon
        first, second, third = gg * bb - gb * gb, rb * gb - rg * bb, rg * gb - rb * gg
        determinant = rr * first + rg * second + rb * third
        stats[0, x], stats[1, x], stats[2, x] = r, g, b
        stats[3, x] = first / determinant
        stats[4, x] = second / determinant
        stats[5, x] = third / determinant
        stats[6, x] = (rr * bb - rb * rb) / determinant
        stats[7, x] = (rg * rb - rr * gb) / determinant
        stats[8, x] = (rr * gg - rg * rg) / determinant


@nb.njit(**KERNEL)
def statistics_kernel(first_row, last_row, columns, radius, epsilon, stats):
    """Statistics of rows [first_row, last_row) from means (P, H, W) down the columns.

    `stats` (H, P, W) are the means of the channels and the upper triangle of (Σ + ε·1)⁻¹.
    """
    count, _, width = columns.shape
    means, totals = np.empty((count, width), np.float64), np.empty(width + 1, np.float64)
    for y in range(first_row, last_row):
        for p in range(count):
            means[p] = columns[p, y]
            _mean_along(means[p], totals, radius)
        if count == 2:
            _invert_grey(means, epsilon, stats[y])
        else:
            _invert_colour(means, epsilon, stats[y])
