"""The guided filter and the weighted median."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lfdepth.engines.base import Array, Float

_LEAST_EVIDENCE = 1e-3
"""Smoothed denominators are kept off zero, since the filter overshoots."""

_WEIGHT_PARTS = 1 << 20
"""Whole weights per unit in the median: sums of them are exact."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """A guide (H, W, C), its mean over windows, and the inverse of its covariance there, (H, W, C, C)."""

    guide: NDArray[np.float64]
    radius: int
    mean: NDArray[np.float64]
    inverse: NDArray[np.float64]


def prepare(guide: Float, radius: int, epsilon: float) -> Prepared:
    """Statistics of a guide."""
    image = guide.astype(np.float64)
    mean = _window_mean(image, radius)
    products = _window_mean(image[..., :, None] * image[..., None, :], radius)
    covariance = products - mean[..., :, None] * mean[..., None, :]
    inverse = np.linalg.inv(covariance + epsilon * np.eye(image.shape[2]))
    return Prepared(image, radius, mean, np.asarray(inverse))


def smooth(prepared: Prepared, image: Array) -> NDArray[np.float64]:
    """The mean of all windows' linear fits of an image (H, W) to the guide."""
    guide, radius = prepared.guide, prepared.radius
    values = image.astype(np.float64)[..., None]
    mean = _window_mean(values, radius)
    covariance = _window_mean(guide * values, radius) - prepared.mean * mean
    slope = np.einsum("yxab,yxb->yxa", prepared.inverse, covariance)
    level = mean - (slope * prepared.mean).sum(axis=2, keepdims=True)
    fitted = (_window_mean(slope, radius) * guide).sum(axis=2) + _window_mean(level, radius)[..., 0]
    return np.asarray(fitted, np.float64)


def smooth_quotient(prepared: Prepared, numerator: Array, denominator: Array) -> NDArray[np.float64]:
    """Smoothed numerator over smoothed denominator, within [−1, 1]."""
    evidence = np.maximum(smooth(prepared, denominator), _LEAST_EVIDENCE)
    return np.clip(smooth(prepared, numerator) / evidence, -1, 1)


def _window_mean(image: NDArray[np.float64], radius: int) -> NDArray[np.float64]:
    """Means over windows of the first two axes, cut at the border.

    Sums of few terms, not differences of running sums: nothing is left behind where nothing was summed.
    """
    ones = np.ones(2 * radius + 1)
    out = image
    for axis in (0, 1):
        total = ndimage.correlate1d(out, ones, axis, mode="constant")
        count = ndimage.correlate1d(np.ones(image.shape[axis]), ones, mode="constant")
        out = total / count.reshape([-1 if each == axis else 1 for each in range(image.ndim)])
    return np.asarray(out)


def weighted_median(
    disparity: NDArray[Any],
    guide: NDArray[Any],
    weight: NDArray[Any] | None,
    radius: int,
    sigma_colour: float,
    sigma_space: float,
) -> Float:
    """The first value, in ascending order, at which half of a window's whole weights is reached."""
    height, width = disparity.shape
    values = np.pad(disparity.astype(np.float32), radius, "edge")
    colours = np.pad(guide.astype(np.float64), ((radius, radius), (radius, radius), (0, 0)), "edge")
    prior = np.pad(np.ones(disparity.shape) if weight is None else weight, radius)  # none beyond the border
    own = guide.astype(np.float64)
    windows, weights = [], []
    for dy, dx in product(range(2 * radius + 1), repeat=2):
        place = slice(dy, dy + height), slice(dx, dx + width)
        colour = ((colours[place] - own) ** 2).sum(axis=2) / (2 * sigma_colour**2)
        space = ((dy - radius) ** 2 + (dx - radius) ** 2) / (2 * sigma_space**2)
        windows.append(values[place])
        weights.append(np.floor(prior[place] * np.exp(-colour - space) * _WEIGHT_PARTS + 0.5))
    order = np.argsort(windows, axis=0, kind="stable")
    ascending = np.take_along_axis(np.array(windows), order, 0)
    reached = np.cumsum(np.take_along_axis(np.array(weights), order, 0), axis=0)
    first = np.argmax(2 * reached >= reached[-1], axis=0)
    median = np.take_along_axis(ascending, first[None], 0)[0]
    return np.where(reached[-1] > 0, median, disparity.astype(np.float32))
