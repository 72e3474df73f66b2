"""From a pixel's profile along the planes to its disparity and confidence.

The ideal profile is one step: −1 while the plane lies in front of the surface, +1 once it lies behind. Both
decoders stream: they keep a few maps and never the volume.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import single
from lfdepth.engines.base import Array, Engine


class Decoder(Protocol):
    """Takes smoothed slices front to back, then gives disparity and confidence."""

    def update(self, index: int, smoothed: Array) -> None:
        """Take the slice of plane `index`."""

    def disparity(self) -> NDArray[np.float32]:
        """Disparity (H, W) in px per view step; at the ends of the range, the end."""

    def confidence(self) -> NDArray[np.float32]:
        """Confidence (H, W) in [0, 1]."""


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
    engine
        Engine; by default the processor's, on one thread.
    """

    def __init__(
        self,
        planes: NDArray[np.float64],
        size: tuple[int, int],
        *,
        subplane: bool = True,
        engine: Engine | None = None,
    ) -> None:
        self.planes = planes
        self.subplane = subplane
        self._engine = engine or single()
        total, lowest, before, after = (self._engine.zeros(size, np.float32) for _ in "1234")
        # The last plane in front of the surface; −1: none.
        at = self._engine.upload(np.full(size, -1, np.int32))
        self._state = (total, lowest, at, before, after)

    def update(self, index: int, smoothed: Array) -> None:
        """Take the slice of plane `index`."""
        self._engine.sign_step(index, smoothed, self._state)

    def disparity(self) -> NDArray[np.float32]:
        """Disparity (H, W); at the ends of the range, the end."""
        _, _, at, before, after = map(self._engine.download, self._state)
        step = self.planes[0] - self.planes[1]
        part = np.full(at.shape, 0.5, np.float32)
        if self.subplane:
            rise = after - before
            np.divide(-before, rise, out=part, where=rise > 0)
        disparity = self.planes[0] - step * (at + part)
        return np.asarray(np.clip(disparity, self.planes[-1], self.planes[0]), np.float32)

    def confidence(self) -> NDArray[np.float32]:
        """Fit of the step, `(Σ C̃ − 2·min running sum)/K`: 1 for a perfect step, 0 without evidence."""
        total, lowest = (self._engine.download(each) for each in self._state[:2])
        fit = (total - 2 * lowest) / np.float32(len(self.planes))
        return np.asarray(np.clip(fit, 0, 1), np.float32)


class Accumulate:
    """Accumulation of the binary maps (FBS): `D = D_min + step·(Σ_k BW_k − ½)`.

    Parameters as for `SignStep`, which it uses for the confidence.
    """

    def __init__(
        self, planes: NDArray[np.float64], size: tuple[int, int], *, engine: Engine | None = None
    ) -> None:
        self.planes = planes
        self._engine = engine or single()
        self._count = self._engine.zeros(size, np.int32)
        self._fit = SignStep(planes, size, subplane=False, engine=self._engine)

    def update(self, index: int, smoothed: Array) -> None:
        """Take the slice of plane `index`."""
        self._engine.accumulate(smoothed, self._count)
        self._fit.update(index, smoothed)

    def disparity(self) -> NDArray[np.float32]:
        """Disparity (H, W)."""
        step = self.planes[0] - self.planes[1]
        disparity = self.planes[-1] + step * (self._engine.download(self._count) - np.float32(0.5))
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
    for index, smoothed in enumerate(volume):
        decoder.update(index, single().upload(np.asarray(smoothed, np.float32)))
    return decoder.disparity()
