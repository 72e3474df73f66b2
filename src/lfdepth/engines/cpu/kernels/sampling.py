"""One bilinear sample of one view: for kernels that look at scattered places.

Kernels that interpolate whole rows at one shift (`voting`, `photo`) do so in fixed point, in loops of their
own: their samples are exact whole numbers, and the border of a view repeats. Here a place outside a view is
no sample at all: callers ask `inside` first.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL


@nb.njit(**INNER)
def inside(y, x, height, width):
    """Whether a place lies within the centres of a view's outermost pixels."""
    return 0 <= y <= height - 1 and 0 <= x <= width - 1


@nb.njit(**KERNEL)
def sample(image, y, x, scale, out):
    """Colour at (y, x), inside the image (H, W, C), times `scale`, into `out`."""
    height, width, channels = image.shape
    top, left = min(int(y), height - 2), min(int(x), width - 2)
    fy, fx = np.float32(y - top), np.float32(x - left)
    for c in range(channels):
        a, b = scale * np.float32(image[top, left, c]), scale * np.float32(image[top, left + 1, c])
        d, e = scale * np.float32(image[top + 1, left, c]), scale * np.float32(image[top + 1, left + 1, c])
        upper, lower = a + fx * (b - a), d + fx * (e - d)
        out[c] = upper + fy * (lower - upper)
