"""Edge-preserving smoothing of a slice: the guided filter.

He, Sun, Tang: Guided Image Filtering, TPAMI 2013, doi:10.1109/TPAMI.2012.213.

Per window the slice is fitted by a linear function of the guide; the pixel's value is the mean of the fits
of all windows that hold it. The guide's mean and the inverse of its regularised covariance do not change
from plane to plane, so they are computed once per light field. Windows are cut at the image border.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.cpu.smoothing import smooth_kernel
from lfdepth.engines.cpu.workers import Workers
from lfdepth.errors import LightFieldError


@dataclass(frozen=True, eq=False)
class GuidedFilter:
    """A guided filter with its guide's statistics.

    Parameters
    ----------
    guide
        (H, W, C) in [0, 1], C = 1 (grey) or 3 (colour).
    radius
        Window radius in px: windows are (2·radius + 1)² pixels; at least 1.
    epsilon
        Regularisation, in the guide's squared units (ε); larger smooths across weaker edges.

    Raises
    ------
    LightFieldError
        For a radius below 1, a window larger than the image, an epsilon that is not positive, or a guide of
        another shape.
    """

    guide: NDArray[np.float32]
    radius: int = 4
    epsilon: float = 1e-4
    _prepared: tuple[Any, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.guide.ndim != 3 or self.guide.shape[2] not in (1, 3):
            raise LightFieldError(
                f"guide: found shape {self.guide.shape}, expected (H, W, 1) or (H, W, 3); "
                "add the channel axis"
            )
        height, width, channels = self.guide.shape
        if self.radius < 1:
            raise LightFieldError(f"radius: found {self.radius}, expected at least 1 px")
        if 2 * self.radius + 1 > min(height, width):
            raise LightFieldError(
                f"radius: found windows of {2 * self.radius + 1} px for images of {width}×{height} px, "
                "expected windows no larger than the image; use larger images or a smaller --radius"
            )
        if not self.epsilon > 0:
            raise LightFieldError(f"epsilon: found {self.epsilon}, expected a positive number such as 1e-4")
        planes = np.moveaxis(self.guide.astype(np.float32), 2, 0)
        mean = np.stack([box_mean(plane, self.radius) for plane in planes])
        stats = np.concatenate([mean, self._inverse_covariance(planes, mean)])
        first, last = _window_ends(width, self.radius)
        rows = (_row_by_row(planes), _row_by_row(stats), (1 / (last - first)).astype(np.float32))
        object.__setattr__(self, "_prepared", (*rows, (height, width, channels), self.radius))

    def _inverse_covariance(
        self, channels: NDArray[np.float32], mean: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Upper triangle of (Σ + ε·1)⁻¹ per pixel: (1, H, W) for grey, (6, H, W) for colour."""
        count = channels.shape[0]
        upper = [(i, j) for i in range(count) for j in range(i, count)]
        cov = {
            (i, j): box_mean(channels[i].astype(np.float64) * channels[j], self.radius) - mean[i] * mean[j]
            for i, j in upper
        }
        for i in range(count):
            cov[i, i] += self.epsilon
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

    def __call__(self, image: NDArray[Any], *, threads: int | None = 1) -> NDArray[np.float32]:
        """Smooth an (H, W) image; returns (H, W) float32.

        Raises
        ------
        LightFieldError
            If the image has another size than the guide.
        """
        if image.shape != self.guide.shape[:2]:
            raise LightFieldError(
                f"image: found shape {image.shape}, expected {self.guide.shape[:2]} like the guide; resize it"
            )
        out = np.empty(image.shape, np.float32)
        with Workers(threads) as workers:
            self.smooth_plane(np.ascontiguousarray(image, np.float32), workers, out)
        return out

    def smooth_plane(self, image: NDArray[np.float32], workers: Workers, out: NDArray[np.float32]) -> None:
        """Smooth `image` into `out`; what an engine for other hardware replaces."""
        self._smooth(image, image, False, workers, out)

    def smooth_quotient(
        self,
        numerator: NDArray[np.float32],
        denominator: NDArray[np.float32],
        workers: Workers,
        out: NDArray[np.float32],
    ) -> None:
        """Normalised smoothing: smoothed numerator over smoothed denominator, within [−1, 1], into `out`."""
        self._smooth(numerator, denominator, True, workers, out)

    def _smooth(
        self,
        numerator: NDArray[np.float32],
        denominator: NDArray[np.float32],
        divide: bool,
        workers: Workers,
        out: NDArray[np.float32],
    ) -> None:
        images = numerator.reshape(-1), denominator.reshape(-1)
        workers.rows(out.shape[0], smooth_kernel, out, *images, divide, *self._prepared)


def _window_ends(length: int, radius: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First place, and the one after the last, of every place's window, cut at the ends."""
    index = np.arange(length)
    return np.maximum(index - radius, 0), np.minimum(index + radius + 1, length)


def _row_by_row(channels: NDArray[Any]) -> NDArray[np.float32]:
    """Channels (C, H, W) as one array that holds the channels of a row side by side."""
    return np.ascontiguousarray(np.moveaxis(channels, 0, 1), np.float32).reshape(-1)


def box_mean(image: NDArray[Any], radius: int) -> NDArray[np.float64]:
    """Mean over (2·radius + 1)² windows cut at the border; (H, W) float64."""
    mean = np.asarray(image, np.float64)
    for axis in (0, 1):
        length = mean.shape[axis]
        total = np.concatenate([np.zeros_like(mean.take([0], axis)), np.cumsum(mean, axis)], axis)
        first, last = _window_ends(length, radius)
        count = (last - first).reshape((-1, 1) if axis == 0 else (1, -1))
        mean = (total.take(last, axis) - total.take(first, axis)) / count
    return mean
