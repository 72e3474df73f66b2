"""Photo-consistency votes: how many views show the reference view's colour at one disparity plane.

The share peaks at the surface's plane. Views that an occluder covers lower the peak but do not move it; the
disparity sign's profile, for its part, is smooth and precise between planes. What counts as the same colour
adapts to the local contrast, as a shift by a part of a plane's distance changes a textured pixel more than an
even one; an idea of the occlusion-aware vote cost of Han et al., TPAMI 2022, doi:10.1109/TPAMI.2021.3105523.

All channels take part, in 1/128 of an 8-bit level, and shifts are rounded to 1/128 px. Levels of 8-bit views
times bilinear weights are then whole numbers of 15 bits, and every count is exact. Views of 16 bits or floats
are rounded to 1/128 of a level, and so are their interpolated levels; the same levels give the same votes in
either form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.reparam import Shifts, round_width
from lfdepth.blocks.visibility import NearestSurfaces
from lfdepth.engines.cpu.photo import UNIT, WHITE, photo_kernel
from lfdepth.engines.cpu.workers import Workers
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import FULL_SCALE, LightField

FEWEST_VIEWS = 25
"""Views that thinning leaves."""

LARGEST_THRESHOLD = 0.5
"""Of full scale. A bound on the sum over three channels then fits 16 bits."""


@dataclass(frozen=True, eq=False)
class ColourStack:
    """Views of all channels, padded by repeating the border so that kernels need no clamping in x.

    `data` is flat, laid out (V, U, H, C, row_length), so that views that do not vote cost nothing: uint8
    levels of 8-bit views, or uint16 from 0 to `WHITE` for all others. A row starts `margin` columns before
    the image. Neighbours in the grid are `stride` view steps apart, down and across.
    """

    data: NDArray[np.uint8] | NDArray[np.uint16]
    grid: tuple[int, int]
    size: tuple[int, int]
    channels: int
    margin: int
    row_length: int
    present: NDArray[np.bool_]
    stride: tuple[int, int] = (1, 1)


def thinned(present: NDArray[np.bool_], *, sparse: bool) -> NDArray[np.bool_]:
    """Views (V, U) enough to count photo-consistency: neighbouring views say much the same.

    Half of them, as the white squares of a chessboard whose reference view is white; with `sparse`, every
    other row and column of them. No fewer than `FEWEST_VIEWS` remain, or else the denser choice is made.
    """
    v, u = (abs(np.arange(count) - count // 2) % 2 for count in present.shape)
    chessboard = np.asarray(present & (v[:, None] == u))
    lattice = np.asarray(present & (v[:, None] == 0) & (u == 0))
    for choice in (lattice, chessboard) if sparse else (chessboard,):
        if np.count_nonzero(choice) >= FEWEST_VIEWS:
            return choice
    return present


def prepare_colours(lf: LightField, max_disparity: float) -> ColourStack:
    """Prepare the views of a light field for planes up to |D| = `max_disparity` px per view step."""
    rows, columns, height, width, channels = lf.shape
    margin = int(np.ceil((columns // 2) * abs(max_disparity))) + 2
    row_length = round_width(width) + 2 * margin
    kind = np.uint8 if lf.views.dtype == np.uint8 else np.uint16
    data: NDArray[Any] = np.empty((rows, columns, height, channels, row_length), kind)
    for v, u in np.ndindex(rows, columns):
        padded = data[v, u]
        padded[..., margin : margin + width] = np.moveaxis(_levels(lf.views[v, u]), 2, 1)
        padded[..., :margin] = padded[..., margin, None]
        padded[..., margin + width :] = padded[..., margin + width - 1, None]
    return ColourStack(
        data=data.reshape(-1),
        grid=(rows, columns),
        size=(height, width),
        channels=channels,
        margin=margin,
        row_length=row_length,
        present=np.ones((rows, columns), np.bool_) if lf.present is None else lf.present,
    )


def _levels(view: NDArray[Any]) -> NDArray[Any]:
    if view.dtype == np.uint8:
        return view
    levels = np.rint(view * (WHITE / FULL_SCALE[view.dtype.name]))
    return np.asarray(levels, np.uint16)


def local_thresholds(
    reference: NDArray[Any], slope: float = 0.2, low: float = 0.003, high: float = 0.02
) -> NDArray[np.float32]:
    """Colour difference per pixel below which two views agree.

    The change that a misregistration by `slope` px causes: `slope` times the largest absolute difference to
    the left, right, upper and lower neighbour, the mean over channels, clipped to [`low`, `high`]; after Han
    et al., TPAMI 2022, doi:10.1109/TPAMI.2021.3105523.

    Parameters
    ----------
    reference
        (H, W, C) reference view, uint8, uint16 or float32 (full scale 255, 65535 or 1).
    slope
        Tolerated misregistration in px, not negative.
    low, high
        Bounds as fractions of full scale, 0 < low ≤ high ≤ 0.5; `low` allows for noise.

    Returns
    -------
    (H, W) float32, fractions of full scale.

    Raises
    ------
    LightFieldError
        For another shape or sample type of the view, or values outside the ranges above.
    """
    if reference.ndim != 3 or reference.dtype.name not in FULL_SCALE:
        raise LightFieldError(
            f"reference: found {reference.dtype} of shape {reference.shape}, "
            "expected a uint8, uint16 or float32 view (H, W, C); convert it"
        )
    if not (0 <= slope < np.inf and 0 < low <= high <= LARGEST_THRESHOLD):
        raise LightFieldError(
            f"thresholds: found slope {slope}, low {low}, high {high}, expected slope ≥ 0 "
            f"and 0 < low ≤ high ≤ {LARGEST_THRESHOLD}; correct them"
        )
    image = reference.astype(np.float64)
    contrast = np.zeros_like(image)
    for axis in (0, 1):
        change = np.abs(np.diff(image, axis=axis))
        for side in (slice(1, None), slice(None, -1)):
            part = contrast[side] if axis == 0 else contrast[:, side]
            np.maximum(part, change, out=part)
    scale = slope / (FULL_SCALE[reference.dtype.name] * image.shape[2])
    return np.asarray(np.clip(contrast.sum(axis=2) * scale, low, high), np.float32)


def photo_consistency(
    lf: LightField,
    disparity: float,
    *,
    thresholds: NDArray[Any] | None = None,
    threads: int | None = 1,
) -> NDArray[np.float32]:
    """Share of the views that show the reference view's colour at one plane.

    A view counts where the mean over channels of its absolute difference to the reference view's pixel, after
    reparameterisation (eq. 1), is below the pixel's threshold.

    Parameters
    ----------
    lf
        Light field.
    disparity
        Plane in px per view step.
    thresholds
        (H, W) fractions of full scale, in (0, 0.5]; default `local_thresholds` of the reference view.
    threads
        Number of threads; None takes every processor.

    Returns
    -------
    (H, W) float32 in (0, 1]: counted views over present ones, the reference view among both.

    Raises
    ------
    LightFieldError
        For thresholds of another shape or outside their range, or a disparity that is not finite.
    """
    if not np.isfinite(disparity):
        raise LightFieldError(f"disparity: found {disparity}, expected a finite number of px per view step")
    if thresholds is None:
        thresholds = local_thresholds(lf.reference)
    if thresholds.shape != lf.shape[2:4]:
        raise LightFieldError(
            f"thresholds: found shape {thresholds.shape}, expected {lf.shape[2:4]} like the views; "
            "resize them"
        )
    lowest, highest = float(thresholds.min()), float(thresholds.max())
    if not (lowest > 0 and highest <= LARGEST_THRESHOLD):
        raise LightFieldError(
            f"thresholds: found values from {lowest:g} to {highest:g}, "
            f"expected fractions of full scale in (0, {LARGEST_THRESHOLD}]; clip them"
        )
    stack = prepare_colours(lf, disparity)
    out = np.empty(stack.size, np.float32)
    with Workers(threads) as workers:
        photo_plane(stack, disparity, thresholds.astype(np.float32), workers, out)
    return out


def photo_plane(
    stack: ColourStack,
    disparity: float,
    thresholds: NDArray[np.float32],
    workers: Workers,
    out: NDArray[np.float32],
    nearest: NearestSurfaces | None = None,
    *,
    rows: tuple[int, int] | None = None,
) -> None:
    """Share of the views that count at one plane, into `out` (H, W); with `nearest`, of those that see it.

    `thresholds` (H, W) lie in (0, 0.5], |disparity| within what the stack was prepared for. With `rows`, only
    rows [first, last) are written. This is what an engine for other hardware replaces.
    """
    first, last = (0, stack.size[0]) if rows is None else rows
    arguments = photo_arguments(stack, disparity, thresholds, nearest)
    workers.rows(last, photo_kernel, out, *arguments, first=first)


def photo_arguments(
    stack: ColourStack,
    disparity: float,
    thresholds: NDArray[np.float32],
    nearest: NearestSurfaces | None = None,
) -> tuple[Any, ...]:
    """Arguments of `photo_kernel` after its output.

    Sums of differences are whole numbers, so `sum / (C·WHITE) < threshold` is
    `sum < ceil(threshold·C·WHITE)`; the product is exact in double precision.
    """
    plane = _shifts(stack.grid, disparity, stack.stride)
    return (
        thresholds,
        stack.data,
        (*stack.grid, stack.size[0], stack.channels, stack.row_length, stack.margin),
        plane.down,
        plane.across,
        plane.weights.astype(np.int16),
        stack.present,
        _placed_visibility(stack, disparity, nearest),
        nearest is not None,
    )


def _placed_visibility(
    stack: ColourStack, disparity: float, nearest: NearestSurfaces | None
) -> tuple[Any, ...]:
    """The kernel's arguments that say where a plane samples the nearest surfaces: at the nearest pixel."""
    if nearest is None:
        none = np.empty(0, np.int16)
        return none, none, np.empty(0, np.int64), np.empty(0, np.int64), none.reshape(0, 0), 0
    down, across = (
        np.floor(-(np.arange(count) - count // 2) * disparity + 0.5).astype(np.int64) for count in stack.grid
    )
    return (nearest.data, nearest.rows, down, across, *nearest.in_front(disparity))


def _shifts(grid: tuple[int, int], disparity: float, stride: tuple[int, int]) -> Shifts:
    """As `reparam.shifts`, in parts of this module's finer `UNIT`, for every `stride`-th view."""
    down, across = (
        np.rint(-(np.arange(count) - count // 2) * steps * disparity * UNIT).astype(np.int64)
        for count, steps in zip(grid, stride, strict=True)
    )
    qy, qx = down[:, None] % UNIT, across % UNIT
    both = (qy * qx + UNIT // 2) // UNIT
    weights = np.stack([UNIT - qx - qy + both, qx - both, qy - both, both], axis=-1)
    return Shifts(down // UNIT, across // UNIT, weights)
