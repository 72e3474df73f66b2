"""Means and extremes over windows, for what is computed once per light field or map."""

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
        inner = max(length - radius, 0)
        total = np.empty((length + 1, mean.shape[1]) if axis == 0 else (len(mean), length + 1), mean.dtype)
        sums, means = (array if axis == 0 else array.T for array in (total, np.empty_like(mean, order="C")))
        sums[0] = 0
        np.cumsum(mean if axis == 0 else mean.T, 0, out=sums[1:])
        means[:inner], means[inner:] = sums[radius + 1 :][:inner], sums[-1]
        means[radius:] -= sums[:inner]
        first, last = window_ends(length, radius)
        means /= (last - first)[:, None].astype(kind)
        mean = means if axis == 0 else means.T
    return mean


def local_range(image: NDArray[np.float32], radius: int) -> NDArray[np.float32]:
    """Largest less smallest value within (2·radius + 1)² windows of an image (H, W), borders repeated."""
    high, low = local_extremes(image, radius)
    return high - low


def local_extremes(
    image: NDArray[np.float32], radius: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Largest and smallest value within (2·radius + 1)² windows of an image (H, W), borders repeated."""
    return local_largest(image, radius), join_around(np.minimum, image, radius)


def local_largest(image: NDArray[np.float32], radius: int) -> NDArray[np.float32]:
    """Largest value within (2·radius + 1)² windows of an image (H, W), borders repeated."""
    return join_around(np.maximum, image, radius)


def join_around(join: np.ufunc, image: NDArray[Any], radius: int) -> NDArray[Any]:
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
