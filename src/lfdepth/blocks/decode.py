"""From a pixel's profile along the planes to its disparity and confidence.

The ideal profile is one step: −1 while the plane lies in front of the surface, +1 once it lies behind. Both
decoders stream: they keep a few maps and never the volume.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.cpu.decode import sign_step_kernel
from lfdepth.engines.cpu.workers import Workers


class Decoder(Protocol):
    """Takes smoothed slices front to back, then gives disparity and confidence."""

    def update(self, index: int, smoothed: NDArray[np.float32], workers: Workers) -> None:
        """Take the slice of plane `index`."""

    def decide(self, workers: Workers) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Disparity (H, W) in px per view step, and confidence (H, W) in [0, 1]."""


class SignStep:
    """Sign function approximation (FBS-SFA): the step with the smallest L1 error to the profile.

    For values in [−1, 1] a step at position c leaves the error `K + 2·Σ_{k≤c} C̃_k − Σ_k C̃_k`, so the best c
    minimises the running sum; per pixel the running sum, its minimum and the two values around it are kept.

    Parameters
    ----------
    planes
        (K,) disparities front to back.
    size
        (H, W).
    subplane
        Place the disparity at the zero crossing between the two planes, by linear interpolation, instead of
        halfway between them.
    """

    def __init__(self, planes: NDArray[np.float64], size: tuple[int, int], *, subplane: bool = True) -> None:
        self.planes = planes
        self.subplane = subplane
        self.sum = np.zeros(size, np.float32)
        self.lowest = np.zeros(size, np.float32)
        self.index = np.full(size, -1, np.int32)  # last plane in front of the surface; −1: none
        self.before = np.zeros(size, np.float32)
        self.after = np.zeros(size, np.float32)

    def update(self, index: int, smoothed: NDArray[np.float32], workers: Workers) -> None:
        """Take the slice of plane `index`."""
        workers.rows(
            smoothed.shape[0],
            sign_step_kernel,
            index,
            smoothed,
            self.sum,
            self.lowest,
            self.index,
            self.before,
            self.after,
        )

    def decide(self, workers: Workers) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Disparity and confidence (H, W)."""
        return self.disparity(), self.confidence()

    def disparity(self) -> NDArray[np.float32]:
        """Disparity (H, W); at the ends of the range, the end."""
        step = self.planes[0] - self.planes[1]
        part = np.full(self.index.shape, 0.5, np.float32)
        if self.subplane:
            rise = self.after - self.before
            np.divide(-self.before, rise, out=part, where=rise > 0)
        disparity = self.planes[0] - step * (self.index + part)
        return np.asarray(np.clip(disparity, self.planes[-1], self.planes[0]), np.float32)

    def confidence(self) -> NDArray[np.float32]:
        """Fit of the step, `(Σ C̃ − 2·min running sum)/K`: 1 for a perfect step, 0 without evidence."""
        fit = (self.sum - 2 * self.lowest) / np.float32(len(self.planes))
        return np.asarray(np.clip(fit, 0, 1), np.float32)


class Accumulate:
    """Accumulation of the binary maps (FBS): `D = D_min + step·(Σ_k BW_k − ½)`.

    Parameters as for `SignStep`, which it uses for the confidence.
    """

    def __init__(self, planes: NDArray[np.float64], size: tuple[int, int]) -> None:
        self.planes = planes
        self.count = np.zeros(size, np.int32)
        self._fit = SignStep(planes, size, subplane=False)

    def update(self, index: int, smoothed: NDArray[np.float32], workers: Workers) -> None:
        """Take the slice of plane `index`."""
        self.count += smoothed > 0
        self._fit.update(index, smoothed, workers)

    def decide(self, workers: Workers) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Disparity and confidence (H, W)."""
        return self.disparity(), self.confidence()

    def disparity(self) -> NDArray[np.float32]:
        """Disparity (H, W)."""
        step = self.planes[0] - self.planes[1]
        disparity = self.planes[-1] + step * (self.count - np.float32(0.5))
        return np.asarray(np.clip(disparity, self.planes[-1], self.planes[0]), np.float32)

    def confidence(self) -> NDArray[np.float32]:
        """Fit of one sign step to the profile, as for `SignStep`."""
        return self._fit.confidence()


def accumulate(volume: NDArray[Any], planes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Disparity (H, W) from a smoothed volume (K, H, W) by accumulation of its binary maps."""
    return _decode(volume, Accumulate(planes, volume.shape[1:]))


def sign_step(
    volume: NDArray[Any], planes: NDArray[np.float64], *, subplane: bool = True
) -> NDArray[np.float32]:
    """Disparity (H, W) from a smoothed volume (K, H, W) by sign function approximation."""
    return _decode(volume, SignStep(planes, volume.shape[1:], subplane=subplane))


def decided(disparity: NDArray[np.float32], planes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Decided profiles `Ĉ`, (K, H, W): +1 where the surface is nearer than the plane, else −1."""
    return np.where(disparity > planes[:, None, None], np.float32(1), np.float32(-1))


def _decode(volume: NDArray[Any], decoder: Decoder) -> NDArray[np.float32]:
    with Workers(1) as workers:
        for index, smoothed in enumerate(volume):
            decoder.update(index, np.ascontiguousarray(smoothed, np.float32), workers)
        return decoder.decide(workers)[0]
