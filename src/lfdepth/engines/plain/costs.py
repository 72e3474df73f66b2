"""What planes cost: how far views differ from the reference view."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.base import Array, Bool
from lfdepth.engines.layout import COLOUR_UNIT, COLOUR_WHITE, check_within, shifts
from lfdepth.engines.plain.photo import ColourLevels
from lfdepth.engines.plain.sampling import shifted

Exact = NDArray[np.float64]


def moved_views(views: ColourLevels, disparity: float, itself: bool = False) -> Iterator[NDArray[np.int64]]:
    """Whole levels (H, W, C) of every view that votes, or with `itself` of the reference view, at a plane."""
    check_within(disparity, views.reach)
    plane = shifts(views.offsets, disparity, COLOUR_UNIT)
    rows, columns = np.arange(views.size[0]), np.arange(views.size[1])
    for v, u in np.argwhere(views.present).tolist():
        source = views.levels[views.reference if itself else (v, u)]
        yield (shifted(source, plane, (v, u), rows, columns) + COLOUR_UNIT // 2) // COLOUR_UNIT


def differences(views: ColourLevels, disparity: float, limits: Array, beyond: float, itself: bool) -> Exact:
    """Mean of truncated differences over the views that vote, in parts of full scale."""
    own = views.levels[views.reference]
    total = np.zeros(views.size)
    for levels in moved_views(views, disparity, itself):
        difference = np.abs(levels - own).sum(axis=2)
        white = own.shape[2] * COLOUR_WHITE
        total += np.where(difference < limits * np.float64(white), difference / white, beyond)
    return np.asarray(total / np.count_nonzero(views.present))


def angular_entropy(views: ColourLevels, disparity: float, sigma: float) -> Exact:
    """Mean over channels of the entropy of the weighed shares of whole levels."""
    own = _whole(views.levels[views.reference])
    shown = np.array([_whole(levels) for levels in moved_views(views, disparity)])
    entropy, inside = np.zeros(own.shape), np.zeros(own.shape)
    for level in np.unique(shown):
        share = (shown == level).mean(axis=0) * np.exp(-((level - own) ** 2) / (2 * sigma**2))
        entropy -= share * np.log(np.where(share > 0, share, 1))
        inside += share
    return np.asarray((entropy / inside).mean(axis=2))


def focal_symmetry(
    views: ColourLevels,
    planes: NDArray[np.float64],
    stacks: Bool,
    pairs: NDArray[np.int64],
    distances: tuple[int, int],
    sigma: float,
    rows: slice,
) -> Exact:
    """Costs (K, rows, W) of planes by how unlike pairs of focal stacks are before and behind them."""
    focused = np.array([[_focus(views, plane, stack)[rows] for plane in planes] for stack in stacks])
    reach, stride = distances
    count = len(planes) - 2 * reach
    total = np.zeros((count, *focused.shape[2:4]))
    for d in range(0, reach + 1, stride):
        before, behind = slice(reach - d, reach - d + count), slice(reach + d, reach + d + count)
        squares = [((focused[i, before] - focused[j, behind]) ** 2).mean(axis=3) for i, j in pairs.tolist()]
        total += 1 - np.exp(-np.min(squares, axis=0) / (2 * sigma**2))
    return np.asarray(total / (reach // stride + 1))


def _focus(views: ColourLevels, plane: float, stack: Bool) -> Exact:
    """Mean of some views (H, W, C) at a plane, in parts of full scale."""
    some = replace(views, present=views.present & stack)
    return np.asarray(np.mean(list(moved_views(some, float(plane))), axis=0) / COLOUR_WHITE)


def _whole(levels: NDArray[Any]) -> NDArray[np.int64]:
    """Whole 8-bit levels, halves up."""
    return np.asarray((levels + COLOUR_UNIT // 2) // COLOUR_UNIT, np.int64)
