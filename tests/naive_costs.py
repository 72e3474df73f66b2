"""The oracles of the costs of planes: truncated differences, entropy, partial focal stacks; in plain NumPy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from naive_photo import UNIT, levels, sample

Array = NDArray[Any]
WHITE = 255 * UNIT


def moved(
    views: Array, disparity: float, present: Array, itself: bool = False
) -> Iterator[tuple[tuple[int, int], Array]]:
    """Place and levels (H, W, C) of every present view, or of the reference view, where a plane has it."""
    rows, columns = views.shape[:2]
    stack = levels(views)
    for i, j in np.argwhere(present).tolist():
        v, u = i - rows // 2, j - columns // 2
        source = stack[rows // 2, columns // 2] if itself else stack[i, j]
        yield (v, u), sample(source, -u * disparity, -v * disparity)


def differences(
    views: Array, disparity: float, limits: Array, beyond: float, present: Array, itself: bool = False
) -> Array:
    """Mean over views of the mean difference over channels; `beyond` where it is not below the limit."""
    own = levels(views)[views.shape[0] // 2, views.shape[1] // 2] / WHITE
    total = [
        np.where(change < limits.astype(np.float64) - 1e-12, change, beyond)
        for _, image in moved(views, disparity, present, itself)
        for change in [np.abs(image / WHITE - own).mean(axis=2)]
    ]
    return np.asarray(np.mean(total, axis=0))
