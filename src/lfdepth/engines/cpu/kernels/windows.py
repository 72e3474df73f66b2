"""Kernel that averages small windows of views where they show points of the reference view."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import KERNEL


@nb.njit(**KERNEL)
def window_kernel(first, last, views, present, offsets, points, disparity, reach, white, means, usable):
    """Mean levels of views first to last of a grid (V, U, H, W, C), row by row, where they show points.

    `points` (N, 2) are rows and columns of the reference view, whole px; in a view, which is `offsets` (V, U,
    2) steps away, a window of (2·reach + 1)² px lies on the nearest whole px. `means` is (V·U, N, C);
    `usable` the same, False where the view is absent, the window leaves it, or a sample is 0 or `white`.
    """
    columns, height, width, channels = views.shape[1:]
    share = np.float32(1 / (2 * reach + 1) ** 2)
    for n in range(first, last):
        v, u = n // columns, n % columns
        view = views[v, u]
        for i in range(len(points)):
            y = round(points[i, 0] - disparity[i] * offsets[v, u, 0])
            x = round(points[i, 1] - disparity[i] * offsets[v, u, 1])
            inside = y >= reach and x >= reach and y < height - reach and x < width - reach
            for c in range(channels):
                means[n, i, c], usable[n, i, c] = 0, False
            if not (inside and present[v, u]):
                continue
            for c in range(channels):
                total, clipped = np.float32(0), False
                for j in range(y - reach, y + reach + 1):
                    for k in range(x - reach, x + reach + 1):
                        level = np.float32(view[j, k, c])
                        total += level
                        clipped |= level <= 0 or level >= white
                means[n, i, c], usable[n, i, c] = total * share, not clipped
