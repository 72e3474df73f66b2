"""Row kernel of the symmetry of focal stacks.

A few pixels of a row are refocused at all planes, which fits the second-level cache, and compared at once.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.cpu.kernels.photo import interpolate

_BLOCK = 64  # pixels of a row worked at once
_FARTHEST = np.float32(24)  # powers of 1/2 beyond which nothing is left


@nb.njit(**INNER)
def _add_levels(total, levels):
    for i in range(levels.size):
        total[i] += np.int32(levels[i])


@nb.njit(**INNER)
def _take_mean(stack, total, share):
    """Mean over views, rounded to a level's parts; clears the total."""
    for i in range(stack.size):
        stack[i] = np.int16(np.float32(total[i]) * share + np.float32(0.5))
        total[i] = 0


@nb.njit(**INNER)
def _square(least, squares, before, behind):
    """Squared distances of colours, and the least of them so far."""
    size = np.uintp(squares.size)
    for c in range(before.size // squares.size):
        start = np.uintp(c) * size
        for x in range(size):
            change = np.float32(np.int32(before[start + x]) - np.int32(behind[start + x]))
            squares[x] = change * change + (squares[x] if c > 0 else np.float32(0))
    for x in range(size):
        least[x] = min(least[x], squares[x])


@nb.njit(**INNER)
def _add_unlikeness(total, squares, scale):
    """Add 1 − 2^−(scale·squares): a shift by whole powers, and a series for the rest."""
    for x in range(total.size):
        power = min(squares[x] * scale, _FARTHEST)
        whole = np.int32(power + np.float32(0.5))
        f = power - np.float32(whole)
        series = np.float32(1.5403530e-4) * f - np.float32(1.3333558e-3)
        series = series * f + np.float32(9.6181291e-3)
        series = series * f - np.float32(5.5504109e-2)
        series = series * f + np.float32(2.4022651e-1)
        series = series * f - np.float32(6.9314718e-1)
        series = series * f + np.float32(1)
        total[x] += np.float32(1) - series / np.float32(np.int32(1) << whole)


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
def symmetry_kernel(first, last, out, data, shape, index, down, across, weights, member, pairs, reach, scale):
    """Costs (K, H, W) of planes in rows [first, last) by pairs of focal stacks before and behind them.

    `index` (M,) are views, row by row of the grid; `down`, `across` (P, M) and `weights` (P, M, 4) how each
    plane samples them; `member` (N, M) the stacks that they belong to. `scale` turns summed squares into
    powers of 1/2. `shape` is (V, U, H, C, row length, margin, -).
    """
    channels, width = shape[3], out.shape[2]
    size = channels * _BLOCK
    focused = np.empty((len(member), len(down), size), np.int16)
    total, levels = np.zeros((len(member), size), np.int32), np.empty(size, np.int16)
    least, squares = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    cost = np.empty(_BLOCK, np.float32)
    share = np.float32(1 / (reach + 1))
    for y in range(first, last):
        for begin in range(0, width, _BLOCK):
            _focus(focused, total, levels, data, shape, y, begin, index, down, across, weights, member)
            for k in range(len(out)):
                cost[:] = 0
                for d in range(reach + 1):
                    least[:] = np.inf
                    for n in range(len(pairs)):
                        before = focused[pairs[n, 0], k + reach - d]
                        _square(least, squares, before, focused[pairs[n, 1], k + reach + d])
                    _add_unlikeness(cost, least, scale)
                for x in range(min(_BLOCK, width - begin)):
                    out[k, y, begin + x] = cost[x] * share
