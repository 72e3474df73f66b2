"""Row kernels of the guided filter.

Column sums run down the image, window sums are put together along each row, so the work per pixel hardly
depends on the radius. Leaf functions take one-dimensional rows indexed from zero: that is what LLVM turns
into vector loops.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.sweep.parallel import STRIP

_RESIDUE = np.float32(1e-6)


@nb.njit(nogil=True, cache=True)
def _add(total, row):
    for x in range(row.size):
        total[x] += row[x]


@nb.njit(nogil=True, cache=True)
def _subtract(total, row):
    for x in range(row.size):
        total[x] -= row[x]


@nb.njit(nogil=True, cache=True)
def _add_product(total, row, other):
    for x in range(row.size):
        total[x] += row[x] * other[x]


@nb.njit(nogil=True, cache=True)
def _subtract_product(total, row, other):
    for x in range(row.size):
        total[x] -= row[x] * other[x]


@nb.njit(nogil=True, cache=True)
def _add_shifted(out, row, shifted):
    for x in range(out.size):
        out[x] = row[x] + shifted[x]


@nb.njit(nogil=True, cache=True)
def _window_means(out, columns, run, rows, radius):
    """Means over 2·radius + 1 neighbours of column sums that carry `radius` zeros on both sides.

    Windows are put together from runs of 1, 2, 4 … values (the binary digits of the window's length), which
    vectorises and, unlike a running sum along the row, does not drift. `run` is scratch of the row's length.
    """
    window, length, offset, width = 2 * radius + 1, 1, 1, out.size
    out[:] = columns[:width]
    run[:] = columns
    while 2 * length <= window:
        # run[x] becomes the sum of 2·length values from x; in place, since it reads only ahead of x.
        _add(run[: run.size - length], run[length:])
        length *= 2
        if window & length:
            _add(out, run[offset : offset + width])
            offset += length
    inner = np.float32(1.0 / (rows * window))
    for x in range(width):
        out[x] *= inner
    # Windows are cut at the left and right border (eq. of He et al. with |ω| counted).
    for x in range(radius):
        cut = np.float32(window) / np.float32(min(x + radius + 1, width))
        out[x] *= cut
        out[width - 1 - x] *= cut


@nb.njit(nogil=True, cache=True)
def _drop_residue(row):
    """Set to zero what rounding of the running sums leaves behind where nothing was summed."""
    for x in range(row.size):
        row[x] = row[x] if abs(row[x]) > _RESIDUE else np.float32(0)


@nb.njit(nogil=True, cache=True)
def _grey_fit(slope, offset, window, mean, inverse):
    for x in range(offset.size):
        slope[x] = inverse[x] * (window[1, x] - mean[x] * window[0, x])
        offset[x] = window[0, x] - slope[x] * mean[x]


@nb.njit(nogil=True, cache=True)
def _colour_fit(fit0, fit1, fit2, fit3, p, pr, pg, pb, mr, mg, mb, i0, i1, i2, i3, i4, i5):
    for x in range(p.size):
        r, g, b = pr[x] - mr[x] * p[x], pg[x] - mg[x] * p[x], pb[x] - mb[x] * p[x]
        a0 = i0[x] * r + i1[x] * g + i2[x] * b
        a1 = i1[x] * r + i3[x] * g + i4[x] * b
        a2 = i2[x] * r + i4[x] * g + i5[x] * b
        fit0[x] = p[x] - a0 * mr[x] - a1 * mg[x] - a2 * mb[x]
        fit1[x] = a0
        fit2[x] = a1
        fit3[x] = a2


@nb.njit(nogil=True, cache=True)
def fit_kernel(first_row, last_row, fit, image, guide, mean, inverse, radius):
    """Linear fits of every window, fit[0] the offset, fit[1:] the slopes, for rows [first_row, last_row)."""
    channels, height, width = guide.shape
    columns = np.zeros((channels + 1, width + 2 * radius), np.float32)
    inner = columns[:, radius : radius + width]
    run = np.empty(width + 2 * radius, np.float32)
    window = np.empty((channels + 1, width), np.float32)
    for y in range(first_row, last_row):
        fresh = y % STRIP == 0 or y == first_row
        if fresh:
            columns[:] = 0
        for row in range(max(y - radius, 0) if fresh else y + radius, min(y + radius + 1, height)):
            _add(inner[0], image[row])
            for c in range(channels):
                _add_product(inner[c + 1], image[row], guide[c, row])
        if not fresh and y - radius - 1 >= 0:
            _subtract(inner[0], image[y - radius - 1])
            for c in range(channels):
                _subtract_product(inner[c + 1], image[y - radius - 1], guide[c, y - radius - 1])
        rows = min(y + radius + 1, height) - max(y - radius, 0)
        for c in range(channels + 1):
            _window_means(window[c], columns[c], run, rows, radius)
        if channels == 1:
            _grey_fit(fit[1, y], fit[0, y], window, mean[0, y], inverse[0, y])
        else:
            _colour_fit(
                fit[0, y],
                fit[1, y],
                fit[2, y],
                fit[3, y],
                window[0],
                window[1],
                window[2],
                window[3],
                mean[0, y],
                mean[1, y],
                mean[2, y],
                inverse[0, y],
                inverse[1, y],
                inverse[2, y],
                inverse[3, y],
                inverse[4, y],
                inverse[5, y],
            )


@nb.njit(nogil=True, cache=True)
def apply_kernel(first_row, last_row, out, fit, guide, radius):
    """Mean of the fits, applied to the guide, for rows [first_row, last_row)."""
    channels, height, width = guide.shape
    columns = np.zeros((channels + 1, width + 2 * radius), np.float32)
    inner = columns[:, radius : radius + width]
    run = np.empty(width + 2 * radius, np.float32)
    window = np.empty(width, np.float32)
    for y in range(first_row, last_row):
        fresh = y % STRIP == 0 or y == first_row
        if fresh:
            columns[:] = 0
        for row in range(max(y - radius, 0) if fresh else y + radius, min(y + radius + 1, height)):
            for c in range(channels + 1):
                _add(inner[c], fit[c, row])
        if not fresh and y - radius - 1 >= 0:
            for c in range(channels + 1):
                _subtract(inner[c], fit[c, y - radius - 1])
        rows = min(y + radius + 1, height) - max(y - radius, 0)
        for c in range(channels + 1):
            _window_means(window, columns[c], run, rows, radius)
            if c == 0:
                out[y] = window
            else:
                _add_product(out[y], window, guide[c - 1, y])
        _drop_residue(out[y])


@nb.njit(nogil=True, cache=True)
def divide_kernel(first_row, last_row, out, denominator):
    """Divide in place, bounded to [−1, 1]; the filter overshoots, so small denominators are kept off zero."""
    for y in range(first_row, last_row):
        for x in range(out.shape[1]):
            ratio = out[y, x] / max(denominator[y, x], np.float32(1e-3))
            out[y, x] = min(max(ratio, np.float32(-1)), np.float32(1))
