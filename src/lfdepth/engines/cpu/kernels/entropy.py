"""Row kernel of the constrained angular entropy."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.cpu.kernels.photo import interpolate
from lfdepth.engines.layout import COLOUR_UNIT as UNIT

_HALF = np.int32(UNIT // 2)


@nb.njit(**INNER)
def _to_bins(bins, levels, reference, middle):
    """Whole levels less the reference view's, about the middle bin, within the bins."""
    most = np.int32(2 * middle)
    for x in range(levels.size):
        level = (np.int32(levels[x]) + _HALF) // np.int32(UNIT)
        own = (np.int32(reference[x]) + _HALF) // np.int32(UNIT)
        bins[x] = np.uint8(min(max(level - own + np.int32(middle), 0), most))


@nb.njit(**INNER)
def _entropy(bins, x, counts, growth, weights):
    """Entropy of what the views show of one channel of a pixel."""
    counts[:] = 0
    total, inside = np.float32(0), np.float32(0)
    for j in range(bins.shape[0]):
        b = bins[j, x]
        n = counts[b]
        counts[b] = n + np.uint8(1)
        total += growth[n, b]
        inside += weights[b]
    return -total / inside


@nb.njit(**KERNEL)
def entropy_kernel(first, last, out, growth, weights, data, shape, down, across, mixing, present):
    """Mean over channels of the constrained angular entropy, for rows [first, last) of one plane.

    `weights` of the bins, whose middle one holds the reference view's level; `growth` (N, bins) is what a
    bin's `h·ln h`, h its weight, gains by another view. `shape` is (V, U, H, C, row length, margin, index of
    the reference view).
    """
    rows, columns, height, channels, length, margin, own = shape
    width, row_size, middle = length - 2 * margin, channels * length, weights.size // 2
    reference, levels = np.empty(channels * width, np.int16), np.empty(channels * width, np.int16)
    bins, counts = np.empty((growth.shape[0], channels * width), np.uint8), np.empty(weights.size, np.uint8)
    one, none = np.int16(UNIT), np.int16(0)
    share = np.float32(1 / channels)
    for y in range(first, last):
        start = np.uintp((own * height + y) * row_size + margin)
        interpolate(reference, channels, data, start, start, length, one, none, none, none)
        found = 0
        for v in range(rows):
            for u in range(columns):
                if not present[v, u]:
                    continue
                view = (v * columns + u) * height
                upper = min(max(y + down[v, u], 0), height - 1)
                lower = min(max(y + down[v, u] + 1, 0), height - 1)
                above = np.uintp((view + upper) * row_size + margin + across[v, u])
                below = np.uintp((view + lower) * row_size + margin + across[v, u])
                w00, w01, w10, w11 = mixing[v, u]
                interpolate(levels, channels, data, above, below, length, w00, w01, w10, w11)
                _to_bins(bins[found], levels, reference, middle)
                found += 1
        for x in range(out.shape[1]):
            total = np.float32(0)
            for c in range(channels):
                total += _entropy(bins, c * width + x, counts, growth, weights)
            out[y, x] = total * share
