"""Means over windows, for statistics that are computed once per light field."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def window_ends(length: int, radius: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First place, and the one after the last, of every place's window, cut at the ends."""
    index = np.arange(length)
    return np.maximum(index - radius, 0), np.minimum(index + radius + 1, length)


def box_mean(image: NDArray[Any], radius: int, kind: Any = np.float64) -> NDArray[Any]:
    """Mean over (2·radius + 1)² windows cut at the border; (H, W) of a kind; single will do for pictures."""
    mean = np.asarray(image, kind)
    for axis in (0, 1):
        length = mean.shape[axis]
        total = np.concatenate([np.zeros_like(mean.take([0], axis)), np.cumsum(mean, axis)], axis)
        first, last = window_ends(length, radius)
        count = (last - first).reshape((-1, 1) if axis == 0 else (1, -1)).astype(kind)
        mean = (total.take(last, axis) - total.take(first, axis)) / count
    return mean
