"""The vote of the disparity signs (eq. 2-6)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.base import Array, Bool, Delta, Gradient
from lfdepth.engines.layout import GREY_UNIT, check_within, grey_levels, shifts, vote_tolerance
from lfdepth.engines.plain.sampling import Whole, shifted
from lfdepth.lightfield import LightField


@dataclass(frozen=True, eq=False)
class GreyLevels:
    """Grey views (V, U, H, W) in whole levels; `reach` is the largest |D| they were prepared for."""

    levels: Whole
    present: Bool
    offsets: NDArray[np.float64]
    reference: tuple[int, int]
    reach: float

    @property
    def size(self) -> tuple[int, int]:
        """(H, W)."""
        return self.levels.shape[2], self.levels.shape[3]


class ViewSigns(NamedTuple):
    """One view at one plane: its signs (H, W), its levels, and along how many axes it has neighbours."""

    view: tuple[int, int]
    along_x: Whole
    along_y: Whole
    level: Whole
    axes: int


def prepare(lf: LightField, reach: float) -> GreyLevels:
    """Grey views in whole levels."""
    return GreyLevels(grey_levels(lf.views).astype(np.int64), lf.available, lf.offsets, lf.centre, abs(reach))


def view_signs(views: GreyLevels, disparity: float, gradient: Gradient) -> Iterator[ViewSigns]:
    """Signs S_xu and S_yv of every view that is present (eq. 2 and 3)."""
    check_within(disparity, views.reach)
    levels = _at_plane(views.levels, views.present, views.offsets, disparity)
    for v, u in np.argwhere(views.present).tolist():
        before_u, after_u = _neighbours(views.present[v], u)
        before_v, after_v = _neighbours(views.present[:, u], v)
        slope_x, slope_y = _spatial(levels[v, u], gradient)
        along_u = np.sign(levels[v, after_u] - levels[v, before_u])
        along_v = np.sign(levels[after_v, u] - levels[before_v, u])
        axes = (before_u != after_u) + (before_v != after_v)
        yield ViewSigns((v, u), np.sign(slope_x) * along_u, np.sign(slope_y) * along_v, levels[v, u], axes)


def vote(
    views: GreyLevels,
    disparity: float,
    delta: Delta,
    threshold: float,
    gradient: Gradient,
    mask: tuple[Array, float] | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Sum of votes and number of those that count, as shares of all possible ones (eq. 4 and 5)."""
    signs = list(view_signs(views, disparity, gradient))
    centre = next(each.level for each in signs if each.view == views.reference)
    total, evidence = np.zeros(views.size, np.int64), np.zeros(views.size, np.int64)
    parts = _mask_parts(views, mask)
    for each in signs:
        counts = np.abs(each.level - centre) <= vote_tolerance(delta, threshold)
        if delta == "sign" and each.axes == 2:
            counts = each.along_x == each.along_y
        weight = counts * parts[each.view]
        total += weight * (each.along_x + each.along_y)
        evidence += weight * each.axes
    possible = max(sum(each.axes for each in signs), 1) * GREY_UNIT
    return (total / possible).astype(np.float32), (evidence / possible).astype(np.float32)


def _at_plane(levels: Whole, present: Bool, offsets: NDArray[np.float64], disparity: float) -> Whole:
    """All views' levels, times the unit, with a plane in register (eq. 1)."""
    height, width = levels.shape[2:]
    plane, out = shifts(offsets, disparity), np.zeros_like(levels)
    for v, u in np.argwhere(present).tolist():
        out[v, u] = shifted(levels[v, u], plane, (v, u), np.arange(height), np.arange(width))
    return out


def _neighbours(present: Bool, at: int) -> tuple[int, int]:
    """Views before and after one along an axis; the view itself in place of one that is not there."""
    before, after = at - 1, at + 1
    return (
        before if before >= 0 and present[before] else at,
        after if after < len(present) and present[after] else at,
    )


def _spatial(image: Whole, gradient: Gradient) -> tuple[Whole, Whole]:
    """Gradient along x and y, but for a factor; the border repeats."""
    around = np.pad(image, 1, "edge")
    along_x, along_y = around[:, 2:] - around[:, :-2], around[2:] - around[:-2]
    if gradient == "central":
        return along_x[1:-1], along_y[:, 1:-1]
    return (
        along_x[:-2] + 2 * along_x[1:-1] + along_x[2:],
        along_y[:, :-2] + 2 * along_y[:, 1:-1] + along_y[:, 2:],
    )


def _mask_parts(views: GreyLevels, mask: tuple[Array, float] | None) -> Any:
    """Weights (V, U, H, W) of the views' votes in 1/`GREY_UNIT`: how far each sees the pixel's own side."""
    if mask is None:
        return np.full((*views.present.shape, 1, 1), GREY_UNIT)
    foreground, offset = mask
    everywhere = np.broadcast_to(foreground.astype(np.int64), views.levels.shape)
    carried = _at_plane(everywhere, views.present, views.offsets, offset)
    return np.where(foreground, carried, GREY_UNIT - carried)
