"""Row kernel of the symmetry of focal stacks.

A part of a row is refocused at all planes and compared at once; the planes around one fit the second-level
cache.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.cpu.kernels.photo import interpolate

_BLOCK = 128  # pixels of a row worked at once


@nb.njit(**INNER)
def _add_levels(total, levels):
    for i in range(levels.size):
        total[i] += np.int32(levels[i])


@nb.njit(**INNER)
def _take_mean(stack, total, share):
    """Mean over views; clears the total."""
    for i in range(stack.size):
        stack[i] = np.float32(total[i]) * share
        total[i] = 0


@nb.njit(**INNER)
def _least_square(least, before, behind):
    """The least of the squared distances of colours so far."""
    size = np.uintp(least.size)
    if before.size == size:
        for x in range(size):
            change = before[x] - behind[x]
            least[x] = min(least[x], change * change)
    else:
        for x in range(size):
            red = before[x] - behind[x]
            green = before[size + x] - behind[size + x]
            blue = before[size + size + x] - behind[size + size + x]
            least[x] = min(least[x], red * red + green * green + blue * blue)


@nb.njit(**INNER)
def _add_unlikeness(total, squares, scale):
    """Add 1 − exp(−64·scale·squares): a series for a 64th of the power, squared six times."""
    for x in range(total.size):
        part = min(squares[x] * scale, np.float32(1))
        like = np.float32(1) - part + np.float32(0.5) * part * part
        like = like * like
        like = like * like
        like = like * like
        like = like * like
        like = like * like
        like = like * like
        total[x] += np.float32(1) - like


@nb.njit(**INNER)
def _focus(focused, total, levels, data, shape, y, begin, index, down, across, weights, member):
    """Fill stacks (N, P, C·block) of the pixels of row y from `begin` on."""
    height, channels, length, margin = shape[2], shape[3], shape[4], shape[5]
    row_size = channels * length
    for p in range(focused.shape[1]):
        for i in range(len(index)):
            view = index[i] * height
            upper = min(max(y + down[p, i], 0), height - 1)
            lower = min(max(y + down[p, i] + 1, 0), height - 1)
            column = margin + begin + across[p, i]
            above, below = (
                np.uintp((view + upper) * row_size + column),
                np.uintp((view + lower) * row_size + column),
            )
            w00, w01, w10, w11 = weights[p, i]
            interpolate(levels, channels, data, above, below, length, w00, w01, w10, w11)
            for n in range(len(member)):
                if member[n, i]:
                    _add_levels(total[n], levels)
        for n in range(len(member)):
            _take_mean(focused[n, p], total[n], np.float32(1) / np.float32(member[n].sum()))


@nb.njit(**KERNEL)
def symmetry_kernel(
    first, last, out, data, shape, index, down, across, weights, member, pairs, distances, scale
):
    """Costs (K, H, W) of planes in rows [first, last) by pairs of focal stacks before and behind them.

    `index` (M,) are views, row by row of the grid; `down`, `across` (P, M) and `weights` (P, M, 4) how each
    plane samples them; `member` (N, M) the stacks that they belong to. `scale` turns summed squares into
    a 64th of the power of 1/e. `shape` is (V, U, H, C, row length, margin, -).
    """
    channels, width = shape[3], out.shape[2]
    inner = shape[4] - 2 * shape[5]  # of a row, beyond which nothing may be read
    block = min(_BLOCK, inner)
    size = channels * block
    focused = np.empty((len(member), len(down), size), np.float32)
    total, levels = np.zeros((len(member), size), np.int32), np.empty(size, np.int16)
    least, cost = np.empty(block, np.float32), np.empty(block, np.float32)
    reach, stride = distances
    share = np.float32(1 / (reach // stride + 1))
    for y in range(first, last):
        for place in range(0, width, block):
            begin = min(place, inner - block)
            _focus(focused, total, levels, data, shape, y, begin, index, down, across, weights, member)
            for k in range(len(out)):
                cost[:] = 0
                for d in range(0, reach + 1, stride):
                    least[:] = np.inf
                    for n in range(len(pairs)):
                        before = focused[pairs[n, 0], k + reach - d]
                        _least_square(least, before, focused[pairs[n, 1], k + reach + d])
                    _add_unlikeness(cost, least, scale)
                for x in range(min(block, width - begin)):
                    out[k, y, begin + x] = cost[x] * share
