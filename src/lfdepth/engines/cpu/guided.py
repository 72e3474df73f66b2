"""The guided filter's statistics of its guide, which do not change from plane to plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.base import Array, Float
from lfdepth.engines.boxes import box_mean, window_ends
from lfdepth.engines.cpu.kernels.smoothing import smooth_kernel
from lfdepth.engines.cpu.workers import Workers


@dataclass(frozen=True, eq=False)
class Prepared:
    """A guide and its statistics, the channels of a row side by side, row after row.

    `stats` are the means of the channels and the upper triangle of (Σ + ε·1)⁻¹; `shares` one over the number
    of columns in each pixel's window, which the border cuts; `shape` is (H, W, C).
    """

    guide: Float
    stats: Float
    shares: Float
    shape: tuple[int, int, int]
    radius: int


def prepare(workers: Workers, guide: Float, radius: int, epsilon: float) -> Prepared:
    """Compute the statistics of a guide (H, W, C) in [0, 1]."""
    height, width, channels = guide.shape
    planes = np.moveaxis(guide.astype(np.float32), 2, 0)
    mean = np.stack(workers.each(partial(box_mean, radius=radius), planes))
    stats = np.concatenate([mean, _inverse_covariance(workers, planes, mean, radius, epsilon)])
    first, last = window_ends(width, radius)
    shares = (1 / (last - first)).astype(np.float32)
    return Prepared(_row_by_row(planes), _row_by_row(stats), shares, (height, width, channels), radius)


def smooth(
    workers: Workers, prepared: Prepared, numerator: Array, denominator: Array, divide: bool, out: Array
) -> None:
    """Smooth one slice into `out`, or two and divide."""
    images = numerator.reshape(-1), denominator.reshape(-1)
    guide = (prepared.guide, prepared.stats, prepared.shares, prepared.shape, prepared.radius)
    workers.rows(out.shape[0], smooth_kernel, out, *images, divide, *guide)


def _inverse_covariance(
    workers: Workers, channels: Float, mean: NDArray[np.float64], radius: int, epsilon: float
) -> NDArray[np.float64]:
    """Upper triangle of (Σ + ε·1)⁻¹ per pixel: (1, H, W) for grey, (6, H, W) for colour."""
    count = channels.shape[0]
    upper = [(i, j) for i in range(count) for j in range(i, count)]

    def covariance(pair: tuple[int, int]) -> NDArray[np.float64]:
        i, j = pair
        mixed = box_mean(channels[i].astype(np.float64) * channels[j], radius)
        return np.asarray(mixed - mean[i] * mean[j])

    cov = dict(zip(upper, workers.each(covariance, upper), strict=True))
    for i in range(count):
        cov[i, i] += epsilon
    if count == 1:
        return np.asarray(1.0 / cov[0, 0])[None]
    minors = {
        (0, 0): cov[1, 1] * cov[2, 2] - cov[1, 2] ** 2,
        (0, 1): cov[0, 2] * cov[1, 2] - cov[0, 1] * cov[2, 2],
        (0, 2): cov[0, 1] * cov[1, 2] - cov[0, 2] * cov[1, 1],
        (1, 1): cov[0, 0] * cov[2, 2] - cov[0, 2] ** 2,
        (1, 2): cov[0, 1] * cov[0, 2] - cov[0, 0] * cov[1, 2],
        (2, 2): cov[0, 0] * cov[1, 1] - cov[0, 1] ** 2,
    }
    determinant = cov[0, 0] * minors[0, 0] + cov[0, 1] * minors[0, 1] + cov[0, 2] * minors[0, 2]
    return np.stack([minors[pair] / determinant for pair in upper])


def _row_by_row(channels: NDArray[Any]) -> Float:
    """Channels (C, H, W) as one array that holds the channels of a row side by side."""
    return np.ascontiguousarray(np.moveaxis(channels, 0, 1), np.float32).reshape(-1)
