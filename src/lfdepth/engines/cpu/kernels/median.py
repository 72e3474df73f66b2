"""Row kernels of the weighted median.

Blocks of a row are worked on as a whole: every step of a sorting network is one loop over the block's pixels,
which vectorises, where sorting pixel by pixel would branch. Values and weights of a block stay in the
first-level cache.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL

WEIGHT_UNIT = 1 << 20
"""Weight of a pixel like the centre. Whole weights make sums exact, whatever order they are added in."""

BLOCK = 128
"""Pixels of a row that are sorted together."""

_LARGEST_EXPONENT = np.float32(30)


@nb.njit(**INNER)
def _distances(exponents, guide, here, there):
    """Add the squared differences of two rows of one channel."""
    for x in range(exponents.size):
        difference = guide[here + np.uintp(x)] - guide[there + np.uintp(x)]
        exponents[x] += difference * difference


@nb.njit(**INNER)
def _weigh(weights, start, exponents, scale, offset, prior, there):
    """Whole weights `prior · 2^−(scale·exponents + offset)`.

    The power is rounded to a whole number, which is a shift, and a rest f, for which the series of 2^−f is
    as precise as single precision.
    """
    for x in range(exponents.size):
        power = min(exponents[x] * scale + offset, _LARGEST_EXPONENT)
        whole = np.int32(power + np.float32(0.5))
        f = power - np.float32(whole)
        series = np.float32(1.5403530e-4) * f - np.float32(1.3333558e-3)
        series = series * f + np.float32(9.6181291e-3)
        series = series * f - np.float32(5.5504109e-2)
        series = series * f + np.float32(2.4022651e-1)
        series = series * f - np.float32(6.9314718e-1)
        series = series * f + np.float32(1)
        weight = series * prior[there + np.uintp(x)] / np.float32(np.int32(1) << whole)
        weights[start + np.uintp(x)] = np.int32(weight * np.float32(WEIGHT_UNIT) + np.float32(0.5))


@nb.njit(**INNER)
def _copy(out, start, source, there, size):
    for x in range(np.uintp(size)):
        out[start + x] = source[there + x]


@nb.njit(**INNER)
def _exchange(values, weights, low, high, size):
    """Put two rows of values in order, pixel by pixel; weights follow."""
    for x in range(np.uintp(size)):
        a, b = values[low + x], values[high + x]
        v, w = weights[low + x], weights[high + x]
        swap = b < a
        values[low + x] = b if swap else a
        values[high + x] = a if swap else b
        weights[low + x] = w if swap else v
        weights[high + x] = v if swap else w


@nb.njit(**INNER)
def _add(total, weights, start):
    for x in range(total.size):
        total[x] = np.int32(total[x] + weights[start + np.uintp(x)])


@nb.njit(**INNER)
def _halve(total):
    """The smallest whole number that is at least half."""
    for x in range(total.size):
        total[x] = np.int32((total[x] + np.int32(1)) >> np.int32(1))


@nb.njit(**INNER)
def _pass(out, half, values, weights, start):
    """Take the next value where half the weight is not reached before it; `half` is what is left to reach."""
    for x in range(out.size):
        at = start + np.uintp(x)
        out[x] = values[at] if half[x] > 0 else out[x]
        half[x] = np.int32(half[x] - weights[at])


@nb.njit(**KERNEL)
def median_kernel(first_row, last_row, out, image, guide, prior, offsets, network, scale):
    """Weighted medians of rows [first_row, last_row).

    `image` and `prior` are flat, padded by the radius; so is `guide`, channel by channel. The pad's `prior`
    is zero. `offsets` lists (down, across, exponent) of the window's pixels, the exponent without the
    colour's part, which is `scale` times the squared difference.
    """
    width, count = out.shape[1], offsets.shape[0]
    radius = int(offsets[:, 0].max())
    length = width + 2 * radius
    plane = prior.size
    values, weights = np.empty(count * BLOCK, np.float32), np.empty(count * BLOCK, np.int32)
    exponents, half = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.int32)
    for y in range(first_row, last_row):
        for first in range(0, width, BLOCK):
            size = min(BLOCK, width - first)
            here = (y + radius) * length + first + radius
            half[:] = 0
            for k in range(count):
                there = here + int(offsets[k, 0]) * length + int(offsets[k, 1])
                start = np.uintp(k * BLOCK)
                exponents[:] = 0
                for c in range(guide.size // plane):
                    _distances(
                        exponents[:size], guide, np.uintp(c * plane + here), np.uintp(c * plane + there)
                    )
                _weigh(weights, start, exponents[:size], scale, offsets[k, 2], prior, np.uintp(there))
                _copy(values, start, image, np.uintp(there), size)
                _add(half[:size], weights, start)
            for pair in range(network.shape[0]):
                low, high = np.uintp(network[pair, 0] * BLOCK), np.uintp(network[pair, 1] * BLOCK)
                _exchange(values, weights, low, high, size)
            _halve(half[:size])
            # Where no pixel of the window has weight the value stays.
            _copy(out[y], np.uintp(first), image, np.uintp(here), size)
            for k in range(count):
                _pass(out[y, first : first + size], half[:size], values, weights, np.uintp(k * BLOCK))
