"""Edge-preserving smoothing of a slice: the guided filter (He, Sun, Tang, TPAMI 2013, doi:10.1109/TPAMI.2012.213).

Per window the slice is fitted by a linear function of the guide; the pixel's value is the mean of the fits
of all windows that hold it. The guide's mean and the inverse of its regularised covariance do not change
from plane to plane, so they are computed once per light field. Windows are cut at the image border.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numba as nb
import numpy as np
from numpy.typing import NDArray

from lfdepth.errors import LightFieldError
from lfdepth.sweep.parallel import STRIP, Workers


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
    threads
        Threads for the statistics.

    Raises
    ------
    LightFieldError
        For a radius below 1, a window larger than the image, an epsilon that is not positive, or a guide of
        another shape.
    """

    guide: NDArray[np.float32]
    radius: int = 4
    epsilon: float = 1e-4
    _channels: NDArray[np.float32] = field(init=False, repr=False)
    _mean: NDArray[np.float32] = field(init=False, repr=False)
    _inverse: NDArray[np.float32] = field(init=False, repr=False)
    _fit: NDArray[np.float32] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.guide.ndim != 3 or self.guide.shape[2] not in (1, 3):
            raise LightFieldError(
                f"guide: found shape {self.guide.shape}, expected (H, W, 1) or (H, W, 3); add the channel axis"
            )
        height, width, channels = self.guide.shape
        if self.radius < 1:
            raise LightFieldError(f"radius: found {self.radius}, expected at least 1 px")
        if 2 * self.radius + 1 > min(height, width):
            raise LightFieldError(
                f"radius: found windows of {2 * self.radius + 1} px for images of {width}×{height} px, expected "
                "windows no larger than the image; use larger images or a smaller --radius"
            )
        if not self.epsilon > 0:
            raise LightFieldError(f"epsilon: found {self.epsilon}, expected a positive number such as 1e-4")
        planes = np.ascontiguousarray(np.moveaxis(self.guide.astype(np.float32), 2, 0))
        mean = np.stack([box_mean(plane, self.radius) for plane in planes])
        object.__setattr__(self, "_channels", planes)
        object.__setattr__(self, "_mean", mean.astype(np.float32))
        object.__setattr__(self, "_inverse", self._inverse_covariance(mean))
        object.__setattr__(self, "_fit", np.empty((channels + 1, height, width), np.float32))

    def _inverse_covariance(self, mean: NDArray[np.float64]) -> NDArray[np.float32]:
        """Upper triangle of (Σ + ε·1)⁻¹ per pixel: (1, H, W) for grey, (6, H, W) for colour."""
        channels = self._channels
        count = channels.shape[0]
        upper = [(i, j) for i in range(count) for j in range(i, count)]
        cov = {
            (i, j): box_mean(channels[i].astype(np.float64) * channels[j], self.radius) - mean[i] * mean[j]
            for i, j in upper
        }
        for i in range(count):
            cov[i, i] += self.epsilon
        if count == 1:
            return (1.0 / cov[0, 0])[None].astype(np.float32)
        minors = {
            (0, 0): cov[1, 1] * cov[2, 2] - cov[1, 2] ** 2,
            (0, 1): cov[0, 2] * cov[1, 2] - cov[0, 1] * cov[2, 2],
            (0, 2): cov[0, 1] * cov[1, 2] - cov[0, 2] * cov[1, 1],
            (1, 1): cov[0, 0] * cov[2, 2] - cov[0, 2] ** 2,
            (1, 2): cov[0, 1] * cov[0, 2] - cov[0, 0] * cov[1, 2],
            (2, 2): cov[0, 0] * cov[1, 1] - cov[0, 1] ** 2,
        }
        determinant = cov[0, 0] * minors[0, 0] + cov[0, 1] * minors[0, 1] + cov[0, 2] * minors[0, 2]
        return np.stack([minors[pair] / determinant for pair in upper]).astype(np.float32)

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
        """Smooth `image` into `out`; what an engine for other hardware replaces. Not reentrant."""
        height = image.shape[0]
        workers.rows(
            height, _fit_kernel, self._fit, image, self._channels, self._mean, self._inverse, self.radius
        )
        workers.rows(height, _apply_kernel, out, self._fit, self._channels, self.radius)


def box_mean(image: NDArray[Any], radius: int) -> NDArray[np.float64]:
    """Mean over (2·radius + 1)² windows cut at the border; (H, W) float64."""
    mean = np.asarray(image, np.float64)
    for axis in (0, 1):
        length = mean.shape[axis]
        total = np.concatenate([np.zeros_like(mean.take([0], axis)), np.cumsum(mean, axis)], axis)
        index = np.arange(length)
        first, last = np.maximum(index - radius, 0), np.minimum(index + radius + 1, length)
        count = (last - first).reshape((-1, 1) if axis == 0 else (1, -1))
        mean = (total.take(last, axis) - total.take(first, axis)) / count
    return mean


@nb.njit(nogil=True, cache=True)
def _window_sums(sums, scratch, out, radius):  # type: ignore[no-untyped-def]
    """Sums over 2·radius + 1 neighbours along a row that carries `radius` zeros on both sides.

    Windows are put together from runs of 1, 2, 4 … values (the binary digits of the window's length), which
    vectorises and, unlike a running sum, does not drift. `sums` is destroyed.
    """
    width = out.size
    window, run, offset = 2 * radius + 1, 1, 0
    out[:] = 0
    while True:
        if window & run:
            for x in range(width):
                out[x] += sums[offset + x]
            offset += run
        if 2 * run > window:
            return
        for x in range(sums.size - 2 * run + 1):
            scratch[x] = sums[x] + sums[x + run]
        sums, scratch = scratch, sums
        run *= 2


@nb.njit(nogil=True, cache=True)
def _add_fit_row(columns, image, guide, y, sign, radius):  # type: ignore[no-untyped-def]
    """Add (or subtract) image row y, and its product with each guide channel, to the column sums."""
    width = image.shape[1]
    for x in range(width):
        columns[0, radius + x] += sign * image[y, x]
    for c in range(guide.shape[0]):
        for x in range(width):
            columns[c + 1, radius + x] += sign * image[y, x] * guide[c, y, x]


@nb.njit(nogil=True, cache=True)
def _fit_kernel(first_row, last_row, fit, image, guide, mean, inverse, radius):  # type: ignore[no-untyped-def]
    """Linear fits a, b of every window: fit[0] = b, fit[1:] = a, for rows [first_row, last_row)."""
    channels, height, width = guide.shape
    columns = np.zeros((channels + 1, width + 2 * radius), np.float32)
    spare, scratch = np.zeros(width + 2 * radius, np.float32), np.zeros(width + 2 * radius, np.float32)
    window = np.empty((channels + 1, width), np.float32)
    covariance = np.empty((channels, width), np.float32)
    for y in range(first_row, last_row):
        if y % STRIP == 0 or y == first_row:
            columns[:] = 0
            for row in range(max(y - radius, 0), min(y + radius + 1, height)):
                _add_fit_row(columns, image, guide, row, np.float32(1), radius)
        else:
            if y + radius < height:
                _add_fit_row(columns, image, guide, y + radius, np.float32(1), radius)
            if y - radius - 1 >= 0:
                _add_fit_row(columns, image, guide, y - radius - 1, np.float32(-1), radius)
        rows = min(y + radius + 1, height) - max(y - radius, 0)
        for c in range(channels + 1):
            spare[:] = columns[c]
            _window_sums(spare, scratch, window[c], radius)
            _normalise(window[c], rows, radius)
        for c in range(channels):
            for x in range(width):
                covariance[c, x] = window[c + 1, x] - mean[c, y, x] * window[0, x]
        if channels == 1:
            for x in range(width):
                fit[1, y, x] = inverse[0, y, x] * covariance[0, x]
                fit[0, y, x] = window[0, x] - fit[1, y, x] * mean[0, y, x]
        else:
            for x in range(width):
                r, g, b = covariance[0, x], covariance[1, x], covariance[2, x]
                a0 = inverse[0, y, x] * r + inverse[1, y, x] * g + inverse[2, y, x] * b
                a1 = inverse[1, y, x] * r + inverse[3, y, x] * g + inverse[4, y, x] * b
                a2 = inverse[2, y, x] * r + inverse[4, y, x] * g + inverse[5, y, x] * b
                fit[0, y, x] = window[0, x] - a0 * mean[0, y, x] - a1 * mean[1, y, x] - a2 * mean[2, y, x]
                fit[1, y, x] = a0
                fit[2, y, x] = a1
                fit[3, y, x] = a2


@nb.njit(nogil=True, cache=True)
def _normalise(window, rows, radius):  # type: ignore[no-untyped-def]
    """Turn window sums into means; windows are cut at the border."""
    width = window.size
    inner = np.float32(1.0 / (rows * (2 * radius + 1)))
    for x in range(width):
        window[x] *= inner
    for x in range(min(radius, width)):
        window[x] *= np.float32(2 * radius + 1) / np.float32(min(x + radius + 1, width))
    for x in range(max(width - radius, radius), width):
        window[x] *= np.float32(2 * radius + 1) / np.float32(width - x + radius)


@nb.njit(nogil=True, cache=True)
def _add_row(columns, fit, y, sign, radius):  # type: ignore[no-untyped-def]
    for c in range(fit.shape[0]):
        for x in range(fit.shape[2]):
            columns[c, radius + x] += sign * fit[c, y, x]


@nb.njit(nogil=True, cache=True)
def _apply_kernel(first_row, last_row, out, fit, guide, radius):  # type: ignore[no-untyped-def]
    """Mean of the fits, applied to the guide, for rows [first_row, last_row)."""
    channels, height, width = guide.shape
    columns = np.zeros((channels + 1, width + 2 * radius), np.float32)
    spare, scratch = np.zeros(width + 2 * radius, np.float32), np.zeros(width + 2 * radius, np.float32)
    window = np.empty((channels + 1, width), np.float32)
    for y in range(first_row, last_row):
        if y % STRIP == 0 or y == first_row:
            columns[:] = 0
            for row in range(max(y - radius, 0), min(y + radius + 1, height)):
                _add_row(columns, fit, row, np.float32(1), radius)
        else:
            if y + radius < height:
                _add_row(columns, fit, y + radius, np.float32(1), radius)
            if y - radius - 1 >= 0:
                _add_row(columns, fit, y - radius - 1, np.float32(-1), radius)
        rows = min(y + radius + 1, height) - max(y - radius, 0)
        for c in range(channels + 1):
            spare[:] = columns[c]
            _window_sums(spare, scratch, window[c], radius)
            _normalise(window[c], rows, radius)
        for x in range(width):
            out[y, x] = window[0, x]
        for c in range(channels):
            for x in range(width):
                out[y, x] += window[c + 1, x] * guide[c, y, x]
