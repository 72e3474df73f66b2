"""Kernel that averages small windows of views where they show points of the reference view."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL


@nb.njit(**INNER)
def _sum_grey(window, sums, least, most):
    """Sum, least and most of a window's samples (H, W, 1)."""
    total = np.float32(0)
    low = high = window[0, 0, 0]
    for y in range(window.shape[0]):
        for x in range(window.shape[1]):
            level = window[y, x, 0]
            total += np.float32(level)
            low, high = min(low, level), max(high, level)
    sums[0], least[0], most[0] = total, low, high


@nb.njit(**INNER)
def _sum_colours(window, sums, least, most):
    """The same of samples (H, W, 3), all channels at once: a sum by itself would wait for itself."""
    red = green = blue = np.float32(0)
    low_red = high_red = window[0, 0, 0]
    low_green = high_green = window[0, 0, 1]
    low_blue = high_blue = window[0, 0, 2]
    for y in range(window.shape[0]):
        for x in range(window.shape[1]):
            r, g, b = window[y, x, 0], window[y, x, 1], window[y, x, 2]
            red += np.float32(r)
            green += np.float32(g)
            blue += np.float32(b)
            low_red, high_red = min(low_red, r), max(high_red, r)
            low_green, high_green = min(low_green, g), max(high_green, g)
            low_blue, high_blue = min(low_blue, b), max(high_blue, b)
    sums[0], sums[1], sums[2] = red, green, blue
    least[0], least[1], least[2] = low_red, low_green, low_blue
    most[0], most[1], most[2] = high_red, high_green, high_blue


@nb.njit(**KERNEL)
def window_kernel(first, last, views, present, offsets, points, disparity, reach, white, means, usable):
    """Mean levels of views first to last of a grid (V, U, H, W, C), row by row, where they show points.

    `points` (N, 2) are rows and columns of the reference view, whole px; in a view, which is `offsets` (V, U,
    2) steps away, a window of (2·reach + 1)² px lies on the nearest whole px. `means` is (V·U, N, C);
    `usable` the same, False where the view is absent, the window leaves it, or a sample is 0 or `white`.
    """
    columns, height, width, channels = views.shape[1:]
    share = np.float32(1 / (2 * reach + 1) ** 2)
    sums, least = np.empty(channels, np.float32), np.empty(channels, np.float32)
    most = np.empty(channels, np.float32)
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
            window = view[y - reach : y + reach + 1, x - reach : x + reach + 1]
            if channels == 3:
                _sum_colours(window, sums, least, most)
            else:
                _sum_grey(window, sums, least, most)
            for c in range(channels):
                clipped = least[c] <= 0 or most[c] >= white
                means[n, i, c], usable[n, i, c] = sums[c] * share, not clipped
