"""Kernels of the gloss block: high-passed views, peaks of photo votes along rows."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.layout import COLOUR_UNIT as UNIT

RADIUS = 3
"""Radius in px of the window whose mean is subtracted."""

MIDDLE = 128
"""Level of 8 bits that stands for no difference to the mean."""

ALONG = 3
"""Radius in px of the mean along a probed row."""

_SIDE = 2 * RADIUS + 1


@nb.njit(**INNER)
def _add_row(sums, row, start, sign):
    """Add a row's columns start − RADIUS, ... to sums down columns; beyond its ends the row repeats."""
    begin = min(max(RADIUS - start, 0), sums.size)
    end = min(max(row.size + RADIUS - start, 0), sums.size)
    for i in range(begin):
        sums[i] += sign * np.int32(row[0])
    for i in range(begin, end):
        sums[i] += sign * np.int32(row[start - RADIUS + i])
    for i in range(end, sums.size):
        sums[i] += sign * np.int32(row[-1])


@nb.njit(**INNER)
def _subtract_mean(out, row, sums, scale):
    """Levels less their window's mean; the area is odd, so no half has to be rounded."""
    area, share = np.int32(_SIDE * _SIDE), np.float32(1) / np.float32(_SIDE * _SIDE)
    white, middle = np.float32(255 * scale), np.float32(MIDDLE * scale)
    for x in range(row.size):
        total = np.int32(0)
        for i in range(_SIDE):
            total += sums[x + i]
        change = np.floor(np.float32(np.int32(row[x]) * area - total) * share + np.float32(0.5))
        out[x] = np.uint16(min(max(change + middle, np.float32(0)), white))


@nb.njit(**KERNEL)
def high_pass_kernel(first, last, views, data, margin, width, corner, out):
    """High-pass views [first, last) of a list, in a window whose upper left pixel is `corner`.

    `data` and `out` are laid out (V, U, H, C, row length), rows start `margin` columns before the image,
    `width` columns wide, or before the window. Columns of `out` outside of the image repeat its border.
    """
    top, left = corner[0], corner[1] - margin
    height, scale = data.shape[2], 1 if data.itemsize == 1 else UNIT
    start, end = max(left, 0), min(left + out.shape[4], width)
    sums = np.empty(end - start + 2 * RADIUS, np.int32)
    for i in range(first, last):
        v, u = views[i, 0], views[i, 1]
        for c in range(data.shape[3]):
            image, filtered = data[v, u, :, c, margin : margin + width], out[v, u, :, c]
            sums[:] = 0
            for y in range(top - RADIUS, top + RADIUS):
                _add_row(sums, image[min(max(y, 0), height - 1)], start, np.int32(1))
            for y in range(out.shape[2]):
                _add_row(sums, image[min(top + y + RADIUS, height - 1)], start, np.int32(1))
                line = filtered[y]
                _subtract_mean(line[start - left : end - left], image[top + y, start:end], sums, scale)
                line[: start - left] = line[start - left]
                line[end - left :] = line[end - left - 1]
                _add_row(sums, image[max(top + y - RADIUS, 0)], start, np.int32(-1))


@nb.njit(**KERNEL)
def peak_kernel(first, last, shares, peaks):
    """Raise rows [first, last) of `peaks` to one plane's shares, smoothed along the row."""
    width = shares.shape[1]
    for i in range(first, last):
        total = np.float32(0)
        for x in range(-ALONG, ALONG):
            total += shares[i, min(max(x, 0), width - 1)]
        for x in range(width):
            total += shares[i, min(x + ALONG, width - 1)]
            peaks[i, x] = max(peaks[i, x], total / np.float32(2 * ALONG + 1))
            total -= shares[i, max(x - ALONG, 0)]
