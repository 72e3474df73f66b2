"""What real cameras do to the views of a light field: brightness that differs, cameras off the grid.

Rigs have a gain and an offset per camera, plenoptic cameras darken towards the outer views and towards the
corners of every view. These functions put that into light fields that have none of it, so that what is done
about it can be measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lfdepth.lightfield import LightField


@dataclass(frozen=True, kw_only=True)
class Imperfections:
    """How much the brightness of the views differs.

    Attributes
    ----------
    gain
        Standard deviation of a factor per view.
    offset
        Standard deviation of a constant added per view, of full scale.
    white_balance
        Standard deviation of a factor per view and channel.
    falloff
        Brightness of the corner views relative to the reference view's; it falls with the square of the
        distance.
    vignetting
        Brightness of the corners of every view relative to its middle.
    wandering
        By how much of the picture's half diagonal the middle of the vignetting moves in the corner views, as
        behind a main lens.
    noise
        Standard deviation of the sensor's noise, of full scale. Without any, rounding a shaded even surface
        leaves contours that stand still in all views, which no real sensor shows.
    seed
        Of the random numbers.
    """

    gain: float = 0.0
    offset: float = 0.0
    white_balance: float = 0.0
    falloff: float = 1.0
    vignetting: float = 1.0
    wandering: float = 0.0
    noise: float = 0.0
    seed: int = 0


def spoil(lf: LightField, imperfections: Imperfections) -> LightField:
    """The same light field as cameras with these imperfections would have taken it, clipped at white."""
    some = imperfections
    rng = np.random.default_rng(some.seed)
    gain, offset = _per_view(lf, some, rng)
    views = np.empty_like(lf.views)
    for v, u in np.ndindex(*lf.shape[:2]):
        values = lf.views[v, u] * _factor(lf, some, gain[v, u], v, u) + offset[v, u]
        if some.noise:
            values += some.noise * lf.full_scale * rng.standard_normal(values.shape)
        clipped = np.clip(values, 0, lf.full_scale)
        views[v, u] = clipped if views.dtype == np.float32 else np.rint(clipped)
    return replace(lf, views=views)


def unspoil(lf: LightField, imperfections: Imperfections) -> LightField:
    """The light field with `spoil` undone exactly, in 16 bits; noise stays, and what was clipped."""
    some = imperfections
    gain, offset = _per_view(lf, some, np.random.default_rng(some.seed))
    views = np.empty(lf.shape, np.uint16)
    for v, u in np.ndindex(*lf.shape[:2]):
        values = (lf.views[v, u] - offset[v, u]) / _factor(lf, some, gain[v, u], v, u)
        views[v, u] = np.rint(np.clip(values / lf.full_scale, 0, 1) * 65535)
    return replace(lf, views=views)


def _per_view(
    lf: LightField, some: Imperfections, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gain (V, U, C) and offset (V, U) in the light field's own unit."""
    grid, channels = lf.shape[:2], lf.shape[4]
    gain = 1 + some.gain * rng.standard_normal((*grid, 1)) * np.ones(channels)
    gain *= 1 + some.white_balance * rng.standard_normal((*grid, channels))
    offset = some.offset * lf.full_scale * rng.standard_normal(grid)
    gain[lf.centre], offset[lf.centre] = 1, 0
    return gain, offset


def _factor(
    lf: LightField, some: Imperfections, gain: NDArray[np.float64], v: int, u: int
) -> NDArray[np.float64]:
    """What the levels of a view are multiplied by, (H, W, C)."""
    place = _place(lf, v, u)
    overall = gain * (1 - (1 - some.falloff) * float(place @ place) / 2)
    return np.asarray(overall * _vignette(lf, some, place)[..., None])


def _place(lf: LightField, v: int, u: int) -> NDArray[np.float64]:
    """Row and column of a view, -1 to 1 from one end of the grid to the other."""
    reach = [max(size // 2, 1) for size in lf.shape[:2]]
    return np.array([(v - lf.centre[0]) / reach[0], (u - lf.centre[1]) / reach[1]])


def _vignette(lf: LightField, some: Imperfections, place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Brightness (H, W) over a view."""
    y, x = np.meshgrid(np.linspace(-1, 1, lf.height), np.linspace(-1, 1, lf.width), indexing="ij")
    down, across = some.wandering * place
    squared = ((y - down) ** 2 + (x - across) ** 2) / 2
    return np.asarray(np.clip(1 - (1 - some.vignetting) * squared, 0.05, None))
