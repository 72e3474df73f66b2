"""Weights of a joint bilateral filter, which do not change from slice to slice."""

from __future__ import annotations

import numpy as np

from lfdepth.engines.base import Float
from lfdepth.engines.cpu.workers import Workers


def weights(workers: Workers, guide: Float, radius: int, sigma_colour: float, sigma_space: float) -> Float:
    """Weights (H, N, W) of the pixels of a window, row by row: 1 in all, 0 beyond the border."""
    height, width, _ = guide.shape
    side = 2 * radius + 1
    padded = np.pad(guide, ((radius, radius), (radius, radius), (0, 0)), constant_values=np.nan)
    out = np.empty((height, side * side, width), np.float32)

    def fill(first: int, last: int) -> None:
        for n, (down, across) in enumerate(np.ndindex(side, side)):
            other = padded[first + down : last + down, across : across + width]
            colour = ((other - guide[first:last]) ** 2).sum(axis=2) / (2 * sigma_colour**2)
            space = ((down - radius) ** 2 + (across - radius) ** 2) / (2 * sigma_space**2)
            out[first:last, n] = np.nan_to_num(np.exp(-colour - space))
        out[first:last] /= out[first:last].sum(axis=1, keepdims=True)

    workers.rows(height, fill)
    return out
