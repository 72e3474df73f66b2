"""Kernel of the residual level."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import KERNEL
from lfdepth.engines.cpu.kernels.sampling import inside, sample


@nb.njit(**KERNEL)
def residual_kernel(first, last, views, reference, others, rows, columns, planes, least):
    """Least mean absolute difference over planes between the reference view and the others.

    For pixels [first, last) of the list `rows`, `columns`. `others` is (present but for the reference view,
    offsets) of the views, (V, U) and (V, U, 2).
    """
    grid_rows, grid_columns, height, width, channels = views.shape
    present, offsets = others
    colour = np.empty(channels, np.float32)
    for i in range(first, last):
        for plane in planes:
            total, count = np.float32(0), 0
            for v in range(grid_rows):
                for u in range(grid_columns):
                    y, x = rows[i] - offsets[v, u, 0] * plane, columns[i] - offsets[v, u, 1] * plane
                    if not present[v, u] or not inside(y, x, height, width):
                        continue
                    sample(views[v, u], y, x, np.float32(1), colour)
                    for c in range(channels):
                        total += abs(colour[c] - np.float32(reference[rows[i], columns[i], c]))
                    count += channels
            if count > 0:
                least[i] = min(least[i], total / np.float32(count))
