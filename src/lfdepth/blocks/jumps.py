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
    return local_largest(image, radius), _around(np.minimum, image, radius)


def local_largest(image: NDArray[np.float32], radius: int) -> NDArray[np.float32]:
    """Largest value within (2·radius + 1)² windows of an image (H, W), borders repeated."""
    return _around(np.maximum, image, radius)


def near_jumps(disparity: NDArray[np.float32], jump: float, reach: int) -> NDArray[np.bool_]:
    """Pixels within `reach` px of a jump by at least `jump` px per view step, (H, W)."""
    change = local_range(disparity, 1)
    edge = (change >= np.float32(jump)) & (change >= np.float32(JUMP_SHARE) * local_range(disparity, 2))
    return _around(np.logical_or, edge, reach - 1)


def _around(join: np.ufunc, image: NDArray[Any], radius: int) -> NDArray[Any]:
    """Join every value with those in the (2·radius + 1)² window around it."""
    return _along(join, _along(join, image, radius, 0), radius, 1)


def _along(join: np.ufunc, image: NDArray[Any], radius: int, axis: int) -> NDArray[Any]:
    """Join every value with those up to `radius` away along one axis; what repeated borders add is there."""
    joined = image.copy()
    for distance in range(1, radius + 1):
        before, after = [slice(None)] * image.ndim, [slice(None)] * image.ndim
        before[axis], after[axis] = slice(None, -distance), slice(distance, None)
        for here, there in ((tuple(before), tuple(after)), (tuple(after), tuple(before))):
            join(joined[here], image[there], out=joined[here])
    return joined
