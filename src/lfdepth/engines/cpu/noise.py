"""Kernel of the residual level."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import KERNEL
from lfdepth.engines.cpu.edges import sample


@nb.njit(**KERNEL)
def residual_kernel(views, present, rows, columns, planes, least):
    """Least mean absolute difference over planes between the reference view and the others, per pixel."""
    grid_rows, grid_columns, height, width, channels = views.shape
    reference = views[grid_rows // 2, grid_columns // 2]
    colour = np.empty(channels, np.float32)
    for i in range(rows.size):
        for plane in planes:
            total, count = np.float32(0), 0
            for v in range(grid_rows):
                for u in range(grid_columns):
                    y, x = (
                        rows[i] - (v - grid_rows // 2) * plane,
                        columns[i] - (u - grid_columns // 2) * plane,
                    )
                    if not present[v, u] or (v == grid_rows // 2 and u == grid_columns // 2):
                        continue
                    if y < 0 or x < 0 or y > height - 1 or x > width - 1:
                        continue
                    sample(views[v, u], y, x, colour)
                    for c in range(channels):
                        total += abs(colour[c] - np.float32(reference[rows[i], columns[i], c]))
                    count += channels
            if count > 0:
                least[i] = min(least[i], total / np.float32(count))
