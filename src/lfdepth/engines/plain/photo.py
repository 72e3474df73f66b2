"""Photo-consistency votes, and which views see a plane."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.base import Array, Bool, Box, Float
from lfdepth.engines.layout import (
    COLOUR_UNIT,
    COLOUR_WHITE,
    DISPARITY_LIMIT,
    DISPARITY_PARTS,
    FEWEST_SEEING,
    UNKNOWN_SURFACE,
    VISIBILITY_MARGIN,
    check_within,
    colour_levels,
    nearest_pixels,
    plane_horizon,
    shifts,
)
from lfdepth.engines.plain.sampling import Whole, inside, repeated, shifted
from lfdepth.lightfield import LightField

_HIGH_PASS = 3
"""Radius in px of the mean that is subtracted."""

_MID_GREY = 128 * COLOUR_UNIT
"""Level that stands for no difference to the mean."""

_ALONG = 3
"""Radius in px of the mean along a probed row."""


@dataclass(frozen=True, eq=False)
class ColourLevels:
    """Views (V, U, H, W, C) in whole parts, `COLOUR_UNIT` to an 8-bit level.

    Of a box of the image they hold all columns; `columns` says which are the box's. `rounding` is what levels
    are rounded to: 8-bit views stay whole levels. `reach` is the largest |D| they were prepared for.
    """

    levels: NDArray[np.int32]
    columns: slice
    rounding: int
    present: Bool
    offsets: NDArray[np.float64]
    reference: tuple[int, int]
    reach: float

    @property
    def size(self) -> tuple[int, int]:
        """(H, W), of the box."""
        return self.levels.shape[2], self.columns.stop - self.columns.start


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Nearest disparity in every view (V, U, H, W), in 1/`DISPARITY_PARTS` px, and the map (H, W) it is from.

    As for `ColourLevels`, those of a box hold all columns, but the map is the box's.
    """

    nearest: NDArray[np.int32]
    columns: slice
    disparity: Float


def prepare(lf: LightField, reach: float, held: Bool | None) -> ColourLevels:
    """Views in whole parts."""
    wanted = lf.available if held is None else lf.available & held
    levels = colour_levels(lf.views).astype(np.int32)
    rounding = COLOUR_UNIT if lf.views.dtype == np.uint8 else 1
    columns = slice(0, lf.width)
    return ColourLevels(levels * rounding, columns, rounding, wanted, lf.offsets, lf.centre, abs(reach))


def subgrid(views: ColourLevels, rows: slice, columns: slice) -> ColourLevels:
    """Some rows and columns of the grid."""
    grid, part = views.present.shape, (rows, columns)
    v, u = (range(n)[each].index(at) for n, each, at in zip(grid, part, views.reference, strict=True))
    return replace(
        views,
        levels=views.levels[part],
        present=views.present[part],
        offsets=views.offsets[part],
        reference=(v, u),
    )


def high_passed(views: ColourLevels, box: Box) -> ColourLevels:
    """Levels less their mean over a window, plus mid-grey, for the rows of a box."""
    rows, _ = box
    rounding, levels = views.rounding, views.levels // views.rounding
    height, width = levels.shape[2:4]
    moves = range(-_HIGH_PASS, _HIGH_PASS + 1)
    down = sum(levels[:, :, repeated(rows.start + move, rows.stop + move, height)] for move in moves)
    total = sum(np.take(down, repeated(move, width + move, width), axis=3) for move in moves)
    area = (2 * _HIGH_PASS + 1) ** 2
    change = (2 * (area * levels[:, :, rows] - total) + area) // (2 * area)
    filtered = np.clip(change * rounding + _MID_GREY, 0, COLOUR_WHITE)
    return replace(views, levels=filtered.astype(np.int32), columns=box[1])


def splat(disparity: Float, present: Bool, offsets: NDArray[np.float64]) -> Surfaces:
    """Nearest surface at every pixel of every view that is present, of the points of a map (H, W)."""
    height, width = disparity.shape
    parts = np.clip(disparity * np.float32(DISPARITY_PARTS), -DISPARITY_LIMIT, DISPARITY_LIMIT)
    nearest = np.full((*present.shape, height, width), UNKNOWN_SURFACE, np.int32)
    y, x = np.arange(height, dtype=np.float32)[:, None], np.arange(width, dtype=np.float32)
    half = np.float32(0.5)
    for v, u in np.argwhere(present):
        down, across = offsets[v, u].astype(np.float32)
        to_y = np.floor(y - down * disparity + half).astype(np.int64)
        to_x = np.floor(x - across * disparity + half).astype(np.int64)
        lands = (to_y >= 0) & (to_y < height) & (to_x >= 0) & (to_x < width)
        np.maximum.at(nearest[v, u], (to_y[lands], to_x[lands]), parts[lands].astype(np.int32))
    return Surfaces(nearest, slice(0, width), disparity)


def surfaces_in(surfaces: Surfaces, box: Box) -> Surfaces:
    """Those in a box of the image."""
    return Surfaces(surfaces.nearest[:, :, box[0]], box[1], surfaces.disparity[box])


def share(
    views: ColourLevels, disparity: float, thresholds: Array, rows: Whole, surfaces: Surfaces | None
) -> Float:
    """Share of the views that show the reference view's colour at a plane, in some rows, (rows, W)."""
    check_within(disparity, views.reach)
    plane = shifts(views.offsets, disparity, COLOUR_UNIT)
    columns = np.arange(views.columns.start, views.columns.stop)
    own = views.levels[views.reference][rows][:, columns]
    limit = thresholds[rows].astype(np.float64) * (own.shape[2] * COLOUR_WHITE)
    agreeing = np.zeros(limit.shape, np.int64)
    seeing = np.zeros_like(agreeing)
    for v, u in np.argwhere(views.present).tolist():
        total = shifted(views.levels[v, u], plane, (v, u), rows, columns)
        level = (total + COLOUR_UNIT // 2) // COLOUR_UNIT
        sees = _sees(surfaces, (v, u), views.offsets[v, u], disparity, rows)
        agreeing += (np.abs(level - own).sum(axis=2) < limit) & sees
        seeing += sees
    # A few of all views at least, or single views would decide.
    least = np.float32(FEWEST_SEEING) * np.float32(views.present.sum())
    return np.asarray(agreeing.astype(np.float32) / np.maximum(seeing.astype(np.float32), least), np.float32)


def peaks(views: ColourLevels, planes: NDArray[np.float64], thresholds: Array, rows: Whole) -> Float:
    """Largest share over planes in some rows, each the mean over a few px along them."""
    width = views.size[1]
    highest = np.zeros((len(rows), width), np.float32)
    for plane in planes:
        found = share(views, float(plane), thresholds, rows, None).astype(np.float64)
        along = sum(found[:, repeated(move, width + move, width)] for move in range(-_ALONG, _ALONG + 1))
        np.maximum(highest, along / (2 * _ALONG + 1), out=highest, casting="same_kind")
    return highest


def _sees(
    surfaces: Surfaces | None,
    view: tuple[int, int],
    offset: NDArray[np.float64],
    disparity: float,
    rows: Whole,
) -> Bool:
    """Whether a view counts at a plane: it sees it, or the pixel itself is in front of it.

    Beside a view nothing is known that hides the plane.
    """
    if surfaces is None:
        return np.ones((1, 1), np.bool_)
    down, across = (each.item() for each in nearest_pixels(offset[None, None], disparity))
    columns = np.arange(surfaces.columns.start, surfaces.columns.stop)
    y, x = np.meshgrid(rows + down, columns + across, indexing="ij")
    nearest = surfaces.nearest[view]
    known = inside(y, x, nearest.shape)
    hidden = known & (nearest[np.where(known, y, 0), np.where(known, x, 0)] > plane_horizon(disparity))
    in_front = surfaces.disparity[rows] > disparity + VISIBILITY_MARGIN
    return np.asarray(~hidden | in_front)
