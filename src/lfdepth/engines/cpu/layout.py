"""How the CPU engine keeps views: padded by repeating the border, so that kernels need no clamping in x."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.cpu.workers import Workers
from lfdepth.engines.layout import (
    COLOUR_UNIT,
    UNKNOWN_SURFACE,
    Shifts,
    check_within,
    colour_levels,
    grey_levels,
    shifts,
)
from lfdepth.lightfield import LightField

PAD = 16
"""Columns kept left and right of a row buffer: horizontal neighbours exist, and loops have round lengths."""


def round_width(width: int) -> int:
    """Width of a row buffer's interior: a multiple of 32, so that vector loops have no remainder."""
    return -(-width // 32) * 32


@dataclass(frozen=True, eq=False)
class GreyStack:
    """Grey views.

    `data` is flat, laid out (V, H, U, row_length): the rows that a row of votes reads lie side by side, which
    streams twice as fast from memory as whole views would. A row starts `margin` columns before the image.
    `reach` is the largest |D| that the stack was made for.
    """

    data: NDArray[np.uint16]
    size: tuple[int, int]
    margin: int
    row_length: int
    present: NDArray[np.bool_]
    offsets: NDArray[np.float64]
    reference: tuple[int, int]
    reach: float

    @property
    def grid(self) -> tuple[int, int]:
        """Number of views (V, U)."""
        return self.present.shape[0], self.present.shape[1]

    def shifts(self, disparity: float) -> Shifts:
        """How a plane samples the views; LightFieldError beyond `reach`."""
        check_within(disparity, self.reach)
        return shifts(self.offsets, disparity).limited(self.size)


@dataclass(frozen=True, eq=False)
class ColourStack:
    """Views of all channels.

    `data` is flat, laid out (V, U, H, C, row_length), so that views that do not vote cost nothing: uint8
    levels of 8-bit views, or uint16 ones (`layout.colour_levels`). A row starts `margin` columns before the
    image. `held` says which views the stack holds, `present` which of them vote.
    """

    data: NDArray[np.uint8] | NDArray[np.uint16]
    size: tuple[int, int]
    channels: int
    margin: int
    row_length: int
    present: NDArray[np.bool_]
    held: NDArray[np.bool_]
    offsets: NDArray[np.float64]
    reference: tuple[int, int]
    reach: float

    @property
    def grid(self) -> tuple[int, int]:
        """Number of views (V, U)."""
        return self.present.shape[0], self.present.shape[1]

    def shifts(self, disparity: float) -> Shifts:
        """How a plane samples the views; LightFieldError beyond `reach`."""
        check_within(disparity, self.reach)
        plane = shifts(self.offsets, disparity, COLOUR_UNIT)
        return Shifts(plane.down, self.inside(plane.across), plane.weights)

    def inside(self, across: NDArray[np.int64]) -> NDArray[np.int64]:
        """Shifts across that the margin holds: where it is narrower, all beyond is the repeated border."""
        return across.clip(2 - self.margin, self.margin - 2)


@dataclass(frozen=True, eq=False)
class NearestSurfaces:
    """Nearest disparity per view, and the map it comes from.

    `data` is flat int16 in 1/`DISPARITY_PARTS` px, laid out (V, U, H, row_length) with `margin` empty columns
    on either side; `UNKNOWN_SURFACE` where no surface is known. Surfaces that the reference view does not see
    are unknown. `rows` is the nearest of every row, (V, U, H), flat.
    """

    data: NDArray[np.int16]
    rows: NDArray[np.int16]
    grid: tuple[int, int]
    margin: int
    row_length: int
    disparity: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class ViewsAsTheyAre:
    """Views (V, U, H, W, C) as they were read, for kernels that look at scattered places."""

    views: NDArray[Any]
    to_bytes: float
    reference: NDArray[Any]
    present: NDArray[np.bool_]
    others: NDArray[np.bool_]
    offsets: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SplineViews:
    """Cubic B-spline coefficients (N, H + 2·PAD, W + 2·PAD) of the luma of N views, in 8-bit levels.

    `at` (N, 2) are their places in the grid, where they are `chosen` (V, U); `origin` (H, W) is the luma of
    the reference view.
    """

    data: NDArray[np.float32]
    at: NDArray[np.int64]
    chosen: NDArray[np.bool_]
    offsets: NDArray[np.float64]
    origin: NDArray[np.float32]

    @property
    def standing(self) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32]]:
        """Index of each view in the grid, and its view steps down and across from the reference view."""
        down, across = self.offsets[self.chosen].astype(np.float32).T.copy()
        return self.at[:, 0] * self.chosen.shape[1] + self.at[:, 1], down, across


def _margin(lf: LightField, reach: float) -> int:
    """Columns that planes up to |D| = `reach` look at beyond the image, and two more."""
    farthest = float(np.abs(lf.offsets[..., 1]).max())
    # Samples farther away are the border's, see `Shifts.limited`.
    return int(min(np.ceil(farthest * reach), lf.width + 1)) + 2


def grey_stack(workers: Workers, lf: LightField, reach: float) -> GreyStack:
    """Prepare grey views for planes up to |D| = `reach` px per view step."""
    rows, columns, height, width, _ = lf.shape
    margin = _margin(lf, abs(reach)) + PAD
    row_length = round_width(width) + 2 * margin
    data = np.empty((rows, height, columns, row_length), np.uint16)

    def fill(view: tuple[int, int]) -> None:
        v, u = view
        _fill(data[v, :, u], grey_levels(lf.views[v, u]), margin)

    workers.each(fill, np.argwhere(lf.available))
    return GreyStack(
        data=data.reshape(-1),
        size=(height, width),
        margin=margin,
        row_length=row_length,
        present=lf.available,
        offsets=lf.offsets,
        reference=lf.centre,
        reach=abs(reach),
    )


def colour_stack(
    workers: Workers, lf: LightField, reach: float, held: NDArray[np.bool_] | None = None
) -> ColourStack:
    """Prepare views of all channels for planes up to |D| = `reach` px per view step.

    Only views that exist and are `held` take memory; by default all.
    """
    rows, columns, height, width, channels = lf.shape
    margin = _margin(lf, abs(reach))
    row_length = round_width(width) + 2 * margin
    wanted = lf.available if held is None else lf.available & held
    kind = np.uint8 if lf.views.dtype == np.uint8 else np.uint16
    data: NDArray[Any] = np.empty((rows, columns, height, channels, row_length), kind)

    def fill(view: tuple[int, int]) -> None:
        v, u = view
        _fill(data[v, u], np.moveaxis(colour_levels(lf.views[v, u]), 2, 1), margin)

    workers.each(fill, np.argwhere(wanted))  # pages of the others are never touched
    return ColourStack(
        data=data.reshape(-1),
        size=(height, width),
        channels=channels,
        margin=margin,
        row_length=row_length,
        present=wanted,
        held=wanted,
        offsets=lf.offsets,
        reference=lf.centre,
        reach=abs(reach),
    )


def _fill(padded: NDArray[Any], rows: NDArray[Any], margin: int) -> None:
    """Put an image's rows `margin` columns into longer ones; beyond its ends it repeats."""
    end = margin + rows.shape[-1]
    padded[..., margin:end] = rows
    padded[..., :margin] = padded[..., margin, None]
    padded[..., end:] = padded[..., end - 1, None]


def views_as_they_are(lf: LightField) -> ViewsAsTheyAre:
    """The views themselves, with what kernels have to know of them."""
    others = lf.available.copy()
    others[lf.centre] = False
    return ViewsAsTheyAre(lf.views, 255 / lf.full_scale, lf.reference, lf.available, others, lf.offsets)


def surfaces_in(nearest: NearestSurfaces, box: tuple[slice, slice], width: int) -> NearestSurfaces:
    """Nearest surfaces for a box of the image, laid out like a `ColourStack` of that `width`."""
    rows, columns = box
    height = nearest.disparity.shape[0]
    source = nearest.data.reshape(*nearest.grid, height, nearest.row_length)
    length = round_width(width) + 2 * nearest.margin
    data = np.full((*nearest.grid, rows.stop - rows.start, length), UNKNOWN_SURFACE, np.int16)
    part = source[:, :, rows, columns.start : columns.start + length]
    data[..., : part.shape[-1]] = part
    return NearestSurfaces(
        data=data.reshape(-1),
        rows=nearest.rows.reshape(source.shape[:3])[:, :, rows].reshape(-1),
        grid=nearest.grid,
        margin=nearest.margin,
        row_length=length,
        disparity=np.ascontiguousarray(nearest.disparity[box]),
    )
