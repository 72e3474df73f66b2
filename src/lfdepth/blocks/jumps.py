"""Where a disparity map jumps from one surface to another, and how far it changes around a pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.layout import JUMP_SHARE


def local_range(image: NDArray[np.float32], radius: int) -> NDArray[np.float32]:
    """Largest less smallest value within (2·radius + 1)² windows of an image (H, W), borders repeated."""
    high, low = local_extremes(image, radius)
    return high - low


def local_extremes(
    image: NDArray[np.float32], radius: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Largest and smallest value within (2·radius + 1)² windows of an image (H, W), borders repeated."""
    high, low = image, image
    for axis in (0, 1):
        high, low = _along(np.maximum, high, radius, axis), _along(np.minimum, low, radius, axis)
    return high, low


def near_jumps(disparity: NDArray[np.float32], jump: float, reach: int) -> NDArray[np.bool_]:
    """Pixels within `reach` px of a jump by at least `jump` px per view step, (H, W)."""
    change = local_range(disparity, 1)
    edge = (change >= np.float32(jump)) & (change >= np.float32(JUMP_SHARE) * local_range(disparity, 2))
    for axis in (0, 1):
        edge = _along(np.logical_or, edge, reach - 1, axis)
    return edge


def _along(join: np.ufunc, image: NDArray[Any], radius: int, axis: int) -> NDArray[Any]:
    """Join every value with those up to `radius` away along one axis."""
    border = [(0, 0), (0, 0)]
    border[axis] = (radius, radius)
    padded, length = np.pad(image, border, "edge"), image.shape[axis]
    moved = [padded.take(range(start, start + length), axis) for start in range(2 * radius + 1)]
    return np.asarray(join.reduce(moved))
