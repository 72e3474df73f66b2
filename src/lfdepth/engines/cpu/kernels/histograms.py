"""Kernel of the distance between two signed histograms: the cost of the spinning parallelogram.

Nothing is convolved. For one pixel a sample of a view is put into the histograms of several labels at once:
it falls into the same bin in all of them, with a weight for each, so that one vector is added at one place.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL


@nb.njit(**INNER)
def _add(histogram, at, weights, start, labels):
    """Add a sample's weights, one for each label."""
    for label in range(labels):
        histogram[at + label] += weights[start + label]


@nb.njit(**INNER)
def _add_squares(sums, histogram, at, labels):
    """Add the squares of a bin, which is cleared."""
    for label in range(labels):
        value = histogram[at + label]
        sums[label] += value * value
        histogram[at + label] = 0


@nb.njit(**KERNEL)
def histogram_kernel(first_row, last_row, pictures, bins, walk, corners, weights, out):
    """Distances (L, H, W) of the histograms of L labels in rows [first_row, last_row).

    `pictures` (N, C, H, W) are levels below `bins`. From a pixel it is `corners` (N, 2) px to the first
    sample of a picture, and `walk` (2,) from one sample to the next, of which there are S; `weights` (N, S,
    L). Beyond the border pictures repeat.
    """
    views, channels, height, width = pictures.shape
    samples, labels = weights.shape[1:]
    size, flat = np.uintp(labels), weights.reshape(-1)
    histogram, sums = np.zeros(bins * labels, np.float32), np.empty(labels, np.float32)
    for y in range(first_row, last_row):
        for x in range(width):
            sums[:] = 0
            for c in range(channels):
                lowest, highest, start = bins, 0, np.uintp(0)
                for n in range(views):
                    row, column = y + corners[n, 0], x + corners[n, 1]
                    for _ in range(samples):
                        i, j = min(max(row, 0), height - 1), min(max(column, 0), width - 1)
                        level = np.int64(pictures[n, c, i, j])
                        lowest, highest = min(lowest, level), max(highest, level)
                        _add(histogram, np.uintp(level * labels), flat, start, size)
                        start += size
                        row, column = row + walk[0], column + walk[1]
                for level in range(lowest, highest + 1):
                    _add_squares(sums, histogram, np.uintp(level * labels), size)
            for label in range(labels):
                out[label, y, x] = sums[label]
