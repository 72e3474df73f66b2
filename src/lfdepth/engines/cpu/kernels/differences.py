"""Row kernel of truncated colour differences between the views and the reference view."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.cpu.kernels.photo import interpolate
from lfdepth.engines.layout import COLOUR_UNIT as UNIT
from lfdepth.engines.layout import COLOUR_WHITE as WHITE

_BLOCK = 32  # rows worked at once, as in `photo`


@nb.njit(**INNER)
def _add(total, sums, levels, reference, bounds, beyond):
    """Add one view's differences where they are below the bound, or else `beyond`; `sums` is scratch."""
    size = np.uintp(total.size)
    sums[:] = 0
    for c in range(levels.size // total.size):
        start = np.uintp(c) * size
        for x in range(size):
            sums[x] += abs(np.int32(levels[start + x]) - np.int32(reference[start + x]))
    for x in range(size):
        total[x] += sums[x] if sums[x] < bounds[x] else beyond


@nb.njit(**KERNEL)
def difference_kernel(first, last, out, limits, beyond, data, shape, down, across, weights, present, itself):
    """Mean over the views of their mean difference over channels, for rows [first, last) of one plane.

    Differences of `limits` (H, W) and more count as `beyond`; both are parts of full scale. `shape` is (V, U,
    H, C, row length, margin, index of the reference view). With `itself`, every view is the reference view.
    """
    rows, columns, height, channels, length, margin, own = shape
    width = length - 2 * margin
    scale = np.float64(channels * WHITE)
    whole = np.int32(np.rint(beyond * scale))
    total, bounds = np.empty((_BLOCK, width), np.int32), np.zeros((_BLOCK, width), np.int32)
    sums = np.empty(width, np.int32)
    reference, levels = np.empty((_BLOCK, channels * width), np.int16), np.empty(channels * width, np.int16)
    row_size = channels * length
    one, none = np.int16(UNIT), np.int16(0)
    share = np.float32(1 / (present.sum() * scale))
    for begin in range(first, last, _BLOCK):
        block = min(_BLOCK, last - begin)
        total[:] = 0
        for i in range(block):
            start = np.uintp((own * height + begin + i) * row_size + margin)
            interpolate(reference[i], channels, data, start, start, length, one, none, none, none)
            for x in range(limits.shape[1]):
                bounds[i, x] = np.int32(math.ceil(min(np.float64(limits[begin + i, x]), 2.0) * scale))
        for v in range(rows):
            for u in range(columns):
                if not present[v, u]:
                    continue
                view = (own if itself else v * columns + u) * height
                column = margin + across[v, u]
                w00, w01, w10, w11 = weights[v, u]
                for i in range(block):
                    y = begin + i
                    upper = min(max(y + down[v, u], 0), height - 1)
                    lower = min(max(y + down[v, u] + 1, 0), height - 1)
                    above = np.uintp((view + upper) * row_size + column)
                    below = np.uintp((view + lower) * row_size + column)
                    interpolate(levels, channels, data, above, below, length, w00, w01, w10, w11)
                    _add(total[i], sums, levels, reference[i], bounds[i], whole)
        for i in range(block):
            for x in range(out.shape[1]):
                out[begin + i, x] = np.float32(total[i, x]) * share
