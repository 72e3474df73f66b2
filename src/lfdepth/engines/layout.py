"""What all engines agree on, so that their counts are the same to the last vote: rounding and shifting.

Grey levels are whole eighths of an 8-bit level (0...2040) and shifts are rounded to 1/32 px. Levels times
bilinear weights are then whole numbers of 16 bits: signs of differences, all that the vote looks at, are
exact, a uniform area has none, and a vector unit handles twice the pixels of 32-bit arithmetic. The three
extra bits matter where texture is weak: luma rounded to 8 bits loses what the colour channels still hold.

Colours are levels of 8 bits, or of 15 bits for all other views, and shifts are rounded to 1/128 px.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.errors import LightFieldError
from lfdepth.lightfield import FULL_SCALE, luma

GREY_UNIT = 32
"""Sum of the four bilinear weights of grey levels, and parts of a pixel that their shifts are rounded to."""

GREY_WHITE = 2040
"""Grey level of full scale; `GREY_WHITE * GREY_UNIT` just fits 16 bits."""

COLOUR_UNIT = 128
"""The same as `GREY_UNIT` for colours, and parts of an 8-bit level in which they are interpolated."""

COLOUR_WHITE = 255 * COLOUR_UNIT
"""Full scale of interpolated colours; fits 15 bits."""

DISPARITY_PARTS = 1000
"""Parts of a px per view step in which the disparities of nearest surfaces are kept."""

DISPARITY_LIMIT = 32000
"""Largest disparity that is told apart there, in these parts: beyond ±32 px per view step all are one."""

UNKNOWN_SURFACE = -32768
"""Where no surface is known."""

SURFACE_JUMP = 0.25
"""Difference of disparities, px per view step, from which on neighbouring pixels are of two surfaces.

A surface that is wider in a view than in the reference view would have gaps there: where neighbours of one
surface land two pixels apart, the farther one also lands between them.
"""

JUMP_SHARE = 0.7
"""Share of the change within 5 × 5 pixels that a jump makes within 3 × 3; a steep slope makes half of it."""

SHARE_LEVELS = 255
"""Shares of views in a volume are whole parts of this."""

ENERGY_SCALE = 2000
"""Whole energies per unit. Energies are cut at 2 above a pixel's least, so that four paths fit 16 bits."""

ENERGY_CUT = 2 * ENERGY_SCALE
"""Energies above a pixel's least are cut here."""

PATH_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Px down and across from a pixel to the next on a path, in the order of their weights."""

FEWEST_SEEING = 0.1
"""A share of visible views counts at least so many of all views, or single views would decide."""

LABELS_AT_ONCE = 32
"""Labels whose histograms are made in one pass over the samples: a few vectors, which fit the first cache."""

VISIBILITY_MARGIN = 0.2
"""Surfaces count as nearer than a plane only if they are by more than this, px per view step."""


@dataclass(frozen=True, eq=False)
class Shifts:
    """How one plane samples the views: whole pixels (V, U) down and across, and bilinear weights (V, U, 4).

    Weights belong to the neighbours (y, x), (y, x+1), (y+1, x), (y+1, x+1): whole numbers that sum to the
    unit.
    """

    down: NDArray[np.int64]
    across: NDArray[np.int64]
    weights: NDArray[np.int64]

    @property
    def reach(self) -> int:
        """Largest distance in px from a pixel to a neighbour that is sampled."""
        return int(max(max(-whole.min(), whole.max() + 1) for whole in (self.down, self.across)))

    def limited(self, size: tuple[int, int]) -> Shifts:
        """Shifts that sample an image of this size (H, W) alike and reach just beyond its repeated border."""
        height, width = size
        down, across = self.down.clip(-height - 1, height), self.across.clip(-width - 1, width)
        return Shifts(down, across, self.weights)


def shifts(offsets: NDArray[np.float64], disparity: float, unit: int = GREY_UNIT) -> Shifts:
    """Sampling shifts for a plane: the view at offset (v, u) is sampled at (x − u·D, y − v·D).

    Parameters
    ----------
    offsets
        (V, U, 2) view steps down and across from the reference view.
    disparity
        Plane in px per view step.
    unit
        Parts of a pixel that shifts are rounded to; also the sum of the weights.
    """
    fixed = np.rint(-offsets * disparity * unit).astype(np.int64)
    whole, part = fixed // unit, fixed % unit
    qy, qx = part[..., 0], part[..., 1]
    both = (qy * qx + unit // 2) // unit
    weights = np.empty((*qx.shape, 4), np.int64)
    for corner, weight in enumerate((unit - qx - qy + both, qx - both, qy - both, both)):
        weights[..., corner] = weight
    return Shifts(np.ascontiguousarray(whole[..., 0]), np.ascontiguousarray(whole[..., 1]), weights)


def nearest_pixels(
    offsets: NDArray[np.float64], disparity: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The same in whole pixels (V, U) down and across, halves to the right and down."""
    nearest = np.floor(-offsets * disparity + 0.5).astype(np.int64)
    return np.ascontiguousarray(nearest[..., 0]), np.ascontiguousarray(nearest[..., 1])


def grey_levels(views: NDArray[Any]) -> NDArray[np.uint16]:
    """Grey views in whole numbers from 0 to `GREY_WHITE`.

    Parameters
    ----------
    views
        (..., C) uint8, uint16 or float32 (full scale 255, 65535 or 1); C is 1 or 3 (Rec. 601 luma).

    Returns
    -------
    (...) uint16 array.
    """
    levels = luma(views) * np.float32(GREY_WHITE / FULL_SCALE[views.dtype.name])
    np.rint(levels, out=levels)
    np.clip(levels, 0, GREY_WHITE, out=levels)
    return levels.astype(np.uint16)


def colour_levels(view: NDArray[Any]) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """A view's samples as they are if of 8 bits, or else in whole numbers from 0 to `COLOUR_WHITE`."""
    if view.dtype == np.uint8:
        return view
    return np.asarray(np.rint(view * (COLOUR_WHITE / FULL_SCALE[view.dtype.name])), np.uint16)


def vote_tolerance(delta: str, threshold: float) -> int:
    """Largest difference of interpolated grey levels, in 1/`GREY_UNIT`, that counts for δ.

    Levels are whole numbers, so |difference| < τ is |difference| ≤ ceil(τ) − 1.
    """
    everything = GREY_WHITE * GREY_UNIT
    return int(np.ceil(threshold * everything)) - 1 if delta == "photo" else everything


def plane_horizon(plane: float) -> int:
    """Disparity, in `DISPARITY_PARTS`, beyond which a surface hides a plane."""
    level = round((plane + VISIBILITY_MARGIN) * DISPARITY_PARTS)
    return int(np.clip(level, -DISPARITY_LIMIT, DISPARITY_LIMIT))


def check_within(disparity: float, reach: float) -> None:
    """Raise LightFieldError where a plane lies beyond what views were prepared for."""
    if not abs(disparity) <= reach + 1e-9:
        raise LightFieldError(
            f"disparity: found a plane at {disparity:g}, expected |D| of at most {reach:g} px per view step, "
            "for which the views were prepared; prepare them for a larger range"
        )


def surface_levels(disparity: NDArray[np.float32]) -> NDArray[np.int16]:
    """A map in whole parts (`DISPARITY_PARTS`), as surfaces are kept; `UNKNOWN_SURFACE` where not finite."""
    levels = np.full(disparity.shape, UNKNOWN_SURFACE, np.int16)
    parts = disparity * np.float32(DISPARITY_PARTS)
    known = np.isfinite(parts)
    levels[known] = parts[known].clip(-DISPARITY_LIMIT, DISPARITY_LIMIT)
    return levels
