"""Where colours say something: local contrast against the level at which views differ for no reason."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.photo import local_thresholds
from lfdepth.engines import single
from lfdepth.engines.base import Engine
from lfdepth.engines.boxes import box_mean
from lfdepth.lightfield import LightField

_SAMPLES = 800
_WINDOW = 4  # px, radius
_GREY, _FEW = 1.4, 1.8  # by how much one channel's residual is too low, and more so in few views
_LOW, _HIGH, _HIGHEST = 0.003, 0.02, 0.1


def ramp(values: NDArray[Any], low: float, high: float) -> NDArray[np.float32]:
    """0 up to `low`, 1 from `high` on, linear between."""
    return np.asarray(np.clip((values - low) / (high - low), 0, 1), np.float32)


class Residual(NamedTuple):
    """How far views differ where a plane fits, mean absolute differences as fractions of full scale.

    `level` is that of typical surfaces, interpolation of their texture included; `noise` that of the evenest,
    little more than the sensor's noise and rounding. Both are 0 where no other view shows any pixel.
    """

    level: float
    noise: float


def residual(
    lf: LightField,
    planes: NDArray[np.float64],
    samples: int = _SAMPLES,
    *,
    engine: Engine | None = None,
) -> Residual:
    """Levels at which views differ even where a plane fits: sensor noise, rounding and interpolation.

    On a regular grid of pixels the mean absolute difference between the reference view and all others is
    taken at every other plane; its least over planes is the pixel's residual, and a low quantile over pixels
    passes over those that are occluded or finely textured.
    """
    height, width = lf.views.shape[2:4]
    spacing = max(int(np.sqrt(height * width / samples)), 1)
    grid = np.mgrid[spacing // 2 : height : spacing, spacing // 2 : width : spacing].reshape(2, -1)
    used = engine or single()
    least = used.residuals(used.views(lf), grid[0], grid[1], np.ascontiguousarray(planes[::2]))
    seen = least[np.isfinite(least)]
    if seen.size == 0:
        return Residual(0.0, 0.0)
    level, noise = np.quantile(seen, [0.25, 0.05]) / lf.full_scale
    return Residual(float(level), float(noise))


def threshold_bounds(noise: float) -> tuple[float, float]:
    """Bounds of `local_thresholds` for light fields of this noise, fractions of full scale.

    Sensors without much noise, up to 0.006, need no more than the lower bound that rounding and interpolation
    ask for: wider thresholds blunt the peaks.
    """
    low = min(max(_LOW, noise - _LOW), _HIGHEST)
    return low, max(_HIGH, low)


def texture_weight(lf: LightField, level: float) -> NDArray[np.float32]:
    """Weight (H, W) in [0, 1] of photo-consistency: 0 where contrast is no more than noise makes.

    Contrast is the mean over a window of the change that a shift by 0.2 px causes (`local_thresholds`
    unclipped); for pure noise it is about half of the residual `level`.
    """
    contrast = box_mean(local_thresholds(lf.reference, low=1e-6, high=0.5), _WINDOW)
    level = max(level, 1e-6)
    # One channel's residual scatters more than the mean of three, so its least over planes lies lower.
    if lf.views.shape[-1] == 1:
        level *= _GREY * (1 + _FEW / max(int(lf.available.sum()) - 1, 1))
    return ramp(contrast / level, 0.55, 0.8)
