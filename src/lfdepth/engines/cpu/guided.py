"""The guided filter's statistics of its guide, which do not change from plane to plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.base import Array, Float
from lfdepth.engines.boxes import window_ends
from lfdepth.engines.cpu.kernels.guides import columns_kernel, statistics_kernel
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
    planes = np.ascontiguousarray(np.moveaxis(guide, 2, 0), np.float32)
    pairs = np.array(
        [(i, -1) for i in range(channels)] + [(i, j) for i in range(channels) for j in range(i, channels)]
    )
    means = np.empty((len(pairs), height, width))
    workers.rows(width, columns_kernel, planes, pairs, radius, means)
    stats = np.empty((height, len(pairs), width), np.float32)
    workers.rows(height, statistics_kernel, means, radius, float(epsilon), stats)
    first, last = window_ends(width, radius)
    shares = (1 / (last - first)).astype(np.float32)
    return Prepared(_row_by_row(planes), stats.reshape(-1), shares, (height, width, channels), radius)


def smooth(
    workers: Workers, prepared: Prepared, numerator: Array, denominator: Array, divide: bool, out: Array
) -> None:
    """Smooth one slice into `out`, or two and divide."""
    images = numerator.reshape(-1), denominator.reshape(-1)
    guide = (prepared.guide, prepared.stats, prepared.shares, prepared.shape, prepared.radius)
    workers.rows(out.shape[0], smooth_kernel, out, *images, divide, *guide)


def _row_by_row(channels: NDArray[Any]) -> Float:
    """Channels (C, H, W) as one array that holds the channels of a row side by side."""
    return np.ascontiguousarray(np.moveaxis(channels, 0, 1), np.float32).reshape(-1)
