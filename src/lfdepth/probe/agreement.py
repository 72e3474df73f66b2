"""Whether the views agree with a disparity map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import using
from lfdepth.engines.boxes import box_mean
from lfdepth.lightfield import LightField, luma
from lfdepth.probe.samples import sample

if TYPE_CHECKING:
    from lfdepth.engines.base import Engine

Array = NDArray[np.float64]

_POINTS = 1500
# Radius of the windows, and how far off a window shows something else, px; least contrast, of full scale.
_REACH, _ELSEWHERE, _CONTRAST = 2, 5, 0.015
_EDGE = _REACH + _ELSEWHERE + 1
# From how many differences on a view tells; how far away, px, the surroundings are.
_FEWEST, _NEAR = 40, 2
# How alike views are that show the same; differences in likeness that are none; what part of them is a rise
# or a fall, and how many there may be along a line of views: it rises to the reference view, and falls.
# How much more or less alike every second row is in serpentine order: clean scenes stay below 0.1.
_ALIKE, _STEADY, _SWING, _SWINGS, _ALTERNATING = 0.5, 0.1, 0.4, 4.5, 0.13


def disagreement(
    lf: LightField, disparity: NDArray[Any], *, engine: Engine | None = None
) -> tuple[NDArray[np.int64], Array]:
    """How far views differ from the reference view at a disparity, as a share of the contrast around.

    Of textured points only. Near 0 where the typical view shows what the reference view shows, near 1 where
    it shows something else near by.

    Returns
    -------
    points, (N, 2) pixels; (N,) array, one value for each.
    """
    grey = box_mean(luma(lf.reference) / np.float32(lf.full_scale), _REACH, np.float32)
    contrast = np.zeros_like(grey)
    for axis in (0, 1):
        for step in (-_ELSEWHERE, _ELSEWHERE):
            contrast += np.abs(np.roll(grey, step, axis) - grey) / 4
    edge = _REACH + _ELSEWHERE
    inner = np.zeros(grey.shape, np.bool_)
    inner[edge:-edge, edge:-edge] = True
    chosen = np.argwhere(inner & (contrast > _CONTRAST) & np.isfinite(disparity))
    chosen = chosen[:: max(1, -(-len(chosen) // _POINTS))].astype(np.int64)
    if not len(chosen):
        return np.zeros((0, 2), np.int64), np.zeros(0)
    at = chosen[:, 0], chosen[:, 1]
    with using(engine) as used:
        found = sample(lf, chosen, disparity[at].astype(np.float64), _REACH, used)
    seen = found.seen
    change = np.abs(luma(found.levels) - grey[at])
    change = np.sort(np.where(seen, change, np.inf), axis=0)
    count = seen.sum(axis=0)
    typical = change[np.minimum(count // 2, len(change) - 1), np.arange(len(chosen))]
    told = count > 4
    return chosen[told], np.asarray((typical / contrast[at])[told], np.float64)


def likeness(
    lf: LightField, points: NDArray[np.int64], disparity: Array, engine: Engine
) -> NDArray[np.float64]:
    """How far views show at points, moved by their disparity, what the reference view shows there.

    Correlated are differences to the surroundings of the points, which brightness does not change.

    Parameters
    ----------
    points, disparity
        (N, 2) pixels of the reference view, (N,) px per view step.

    Returns
    -------
    (V, U) array, up to 1 for views that do, about 0 for foreign ones, NaN where too few points are seen.
    """
    inner = ((points >= _EDGE) & (points < np.array(lf.shape[2:4]) - _EDGE)).all(axis=1)
    points, disparity = points[inner], disparity[inner]
    around = np.array([(0, 0), (0, _NEAR), (0, -_NEAR), (_NEAR, 0), (-_NEAR, 0)])
    places = (points + around[:, None]).reshape(-1, 2)
    found = sample(lf, places, np.tile(disparity, len(around)), 1, engine)
    grey = luma(found.levels).reshape(len(found.levels), len(around), -1)
    seen = found.seen.reshape(grey.shape)
    contrast, both = grey[:, 1:] - grey[:, :1], seen[:, 1:] & seen[:, :1]
    centre = lf.centre[0] * lf.shape[1] + lf.centre[1]
    strong = np.abs(contrast[centre]) > _CONTRAST
    result = np.full(len(grey), np.nan)
    for view in range(len(grey)):
        used = both[view] & both[centre] & strong
        if lf.available.flat[view] and np.count_nonzero(used) >= _FEWEST:
            result[view] = _correlation(contrast[view][used], contrast[centre][used])
    return result.reshape(lf.shape[:2])


def share_in_place(alike: Array) -> float:
    """Share of the views (V, U) that show what the reference view shows; 1 where too little can tell.

    0 where likeness repeats along the grid: then that is not the one that the views were taken on.
    """
    known = alike[np.isfinite(alike)]
    if not known.size:
        return 1.0
    return 0.0 if _ripples(alike) or _alternates(alike) else float((known > _ALIKE).mean())


def _ripples(alike: Array) -> bool:
    """Whether likeness (V, U) rises and falls along rows or columns of views more than once.

    It falls towards the ends of the grid. In a grid with another number of columns than the views were taken
    on, it repeats with their true rows.
    """
    known = alike[np.isfinite(alike)]
    extent = float(np.quantile(known, 0.95) - np.quantile(known, 0.05))
    if extent < _STEADY:
        return False
    swings = [np.mean([_swings(line, _SWING * extent) for line in lines]) for lines in (alike, alike.T)]
    return bool(max(swings) > _SWINGS)


def _alternates(alike: Array) -> bool:
    """Whether every second row or column of views shows something else."""
    for lines in (alike, alike.T):
        sides = np.delete(lines, lines.shape[1] // 2, axis=1)
        if len(lines) < 3 or not sides.size:
            continue
        beside = sides[1:-1] - (sides[:-2] + sides[2:]) / 2
        sign = (-1.0) ** np.arange(len(beside))[:, None]
        differing = beside * sign
        # of three rows the middle one, which the reference view stands in, is always more alike
        most = _ALTERNATING if len(lines) > 4 else _ALIKE
        if np.isfinite(differing).any() and abs(float(np.nanmean(differing))) > most:
            return True
    return False


def _swings(line: Array, least: float) -> int:
    """How often values rise or fall in turn by at least so much."""
    count, direction = 0, 0
    values = line[np.isfinite(line)]
    low = high = values[0] if values.size else 0.0
    for value in values:
        low, high = min(low, value), max(high, value)
        turn = 1 if value - low > least else -1 if high - value > least else 0
        if turn not in (0, direction):
            count, direction = count + 1, turn
        if turn:
            low = high = value
    return count


def _correlation(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Cosine of the angle between two lists of numbers."""
    scale = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / scale if scale else 0.0
