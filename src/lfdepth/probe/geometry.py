"""Where the views stand: the ratio of vertical to horizontal steps, and cameras off the regular grid.

The ratio: disparities that the row and the column of views through the reference view show, each on its own,
are compared. Positions: where a view shows a point of the reference view is known up to a fraction of a
pixel; what is left, times the gradient, is a change of level, and least squares over many points tell how far
each view lies off its place, together with a correction of each point's disparity.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import using
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField, grid_offsets, luma
from lfdepth.probe.brightness import first_map
from lfdepth.probe.matching import Probe, make_probe, match, plane_range, shrink_to
from lfdepth.probe.samples import sample

if TYPE_CHECKING:
    from lfdepth.engines.base import Engine

Array = NDArray[np.float64]

NOTABLE_ASPECT, NOTABLE_POSITIONS = 0.05, 0.03
"""From what deviation on a ratio of steps, and positions (root mean square, in steps), are worth a word."""

_SIDE = 256
# By how many px the move of an outer view may be wrong in the typical point.
_ERROR = 0.3
_POINTS, _FEWEST = 3000, 200
_ROUNDS, _TURNS = 3, 4
# A check after every estimate has to be quick, and tells one thing, not two for each view.
CHECKED_POINTS, _CHECKED_TURNS = 1000, 2
# How well two halves of the picture have to agree on where cameras stand: 0.97 where they stray by 5 %, at
# most 0.55 on a regular grid where they say more than 2 %.
_LIKENESS = 0.8
# Median of the squares of normally distributed numbers.
_MEDIAN_OF_SQUARES = 0.455
# Radius of the windows, px; least gradient of a point, of full scale per px; least |D| that can tell.
_REACH, _GRADIENT, _MOVING = 2, 0.004, 0.15


def with_aspect(lf: LightField, aspect: float) -> LightField:
    """The light field with a given ratio of the vertical to the horizontal step between views.

    Raises
    ------
    LightFieldError
        If the ratio is not positive, or positions of the views are known already.

    Examples
    --------
    Rows of cameras 8 mm apart, columns 10 mm apart:

    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = lfdepth.with_aspect(scenes.render("bars", size=64, views=5), 8 / 10)
    >>> lf.offsets[:, 0, 0]
    array([-1.6, -0.8,  0. ,  0.8,  1.6])
    """
    if not 0.05 <= aspect <= 20:
        raise LightFieldError(
            f"aspect: found {aspect:g}, expected the vertical step divided by the horizontal one, 0.05 to 20"
        )
    if lf.positions is not None:
        raise LightFieldError(
            f"{lf.name}: the positions of the views are known; expected a regular grid for an aspect; "
            "leave out --aspect"
        )
    positions = np.zeros((*lf.shape[:2], 2))
    regular = grid_offsets((lf.shape[0], lf.shape[1]))
    positions[..., 0] = (aspect - 1) * regular[..., 0]
    return replace(lf, positions=positions)


def measure_aspect(
    lf: LightField, range: tuple[float, float], *, threads: int | None = None, engine: Engine | None = None
) -> float | None:
    """Vertical steps over horizontal ones, as the views show them; None if they do not tell.

    1 where that cannot be told from 1, views moving too little.

    Parameters
    ----------
    lf
        Light field, of equal brightness.
    range
        (min, max) disparity along rows of views, px per view step.
    threads
        Number of threads; None uses all processors.
    engine
        Engine to use instead of the default one.
    """
    if min(lf.shape[:2]) == 1:
        return None
    shrink = shrink_to(lf, _SIDE)
    wide = max(-range[0], range[1]) * 1.5 + 0.5
    probe = make_probe(lf, wide, shrink, (1.0, 1 / 2), contrast=True, engine=engine)
    along_rows, along_columns = probe.offsets[:, 0] == 0, probe.offsets[:, 1] == 0
    if lf.positions is not None:
        along_rows, along_columns = (np.abs(probe.offsets[:, axis]) < 0.5 for axis in (0, 1))
    if not (along_rows.any() and along_columns.any()):
        return None
    with using(engine, threads=threads) as used:
        across, down = (_seen(probe, which, wide, used) for which in (along_rows, along_columns))
    known = np.isfinite(across) & np.isfinite(down) & (np.abs(across) > 2 * probe.unit)
    if np.count_nonzero(known) < _FEWEST:
        return None
    ratio, weight = (down[known] / across[known]).astype(float), np.abs(across[known]).astype(float)
    order = np.argsort(ratio)
    half = np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)
    aspect = float(ratio[order][half])
    near = np.abs(ratio - aspect) < 0.1 * abs(aspect)
    if near.mean() < 1 / 3 or not 0.1 < aspect < 10:
        return None
    moves = float(np.median(weight)) / probe.unit
    return 1.0 if abs(aspect - 1) < _ERROR / moves else aspect


def _seen(probe: Probe, which: NDArray[np.bool_], limit: float, engine: Engine) -> NDArray[np.float32]:
    """Disparity (H, W) by some of the views alone, NaN where it is not certain."""
    part = replace(probe, views=np.ascontiguousarray(probe.views[which]), offsets=probe.offsets[which])
    found = match(part, plane_range(-limit, limit, part.unit / 2), engine)
    sure = found.coherent(0.5 * part.unit, 4)
    return np.where(sure, found.disparity, np.float32(np.nan))


def measure_positions(
    lf: LightField,
    disparity: NDArray[Any],
    *,
    threads: int | None = None,
    engine: Engine | None = None,
) -> Array | None:
    """How far views lie off where `lf` says that they stand.

    Parameters
    ----------
    lf
        Light field, of equal brightness.
    disparity
        (H, W) disparity of the reference view, px per view step, NaN where it is unknown.
    threads
        Number of threads; None uses all processors.
    engine
        Engine to use instead of the default one.

    Returns
    -------
    ndarray, shape (V, U, 2), or None
        Down and right, in steps; a scale of all steps apart, which disparity takes up. None where the views
        do not tell.
    """
    points, d, gradient = textured_points(lf, disparity, _POINTS)
    if len(d) < _FEWEST:
        return None
    with using(engine, threads=threads) as used:
        return _moved(lf, points, d, gradient, _TURNS, used)


def measure_off_grid(
    lf: LightField,
    disparity: NDArray[Any],
    *,
    threads: int | None = None,
    engine: Engine | None = None,
) -> float:
    """How far the typical view lies off where `lf` says that it stands; parameters as `measure_positions`.

    Returns
    -------
    float
        Robust standard deviation in steps; a ratio of vertical to horizontal steps and the reference view's
        own place apart. 0 where the views do not tell.
    """
    with using(engine, threads=threads) as used:
        return off_grid_at(lf, textured_points(lf, disparity, CHECKED_POINTS), used)


def off_grid_at(lf: LightField, textured: tuple[NDArray[np.int64], Array, Array], engine: Engine) -> float:
    """`measure_off_grid` by `textured_points`."""
    points, d, gradient = textured
    if len(d) < _FEWEST:
        return 0.0
    left = points[:, 1] < np.median(points[:, 1])
    halves = [
        _moved(lf, points[half], d[half], gradient[half], _CHECKED_TURNS, engine) for half in (left, ~left)
    ]
    # what is true of the cameras, both halves of the picture say; errors, each its own
    there = lf.available.copy()
    there[lf.centre] = False
    one, other = (_irregular(half, lf.offsets)[there] for half in halves)
    likeness = float((one * other).sum() / np.sqrt((one**2).sum() * (other**2).sum() + 1e-12))
    if likeness < _LIKENESS:
        return 0.0
    return float(np.sqrt(max(float(np.median(one * other)) / _MEDIAN_OF_SQUARES, 0.0)))


def stray(
    lf: LightField, range: tuple[float, float], *, threads: int | None = None, engine: Engine | None = None
) -> float:
    """`measure_off_grid` by a coarse map, before any estimate.

    Parameters
    ----------
    lf
        Light field, of equal brightness.
    range
        (min, max) disparity, px per view step.
    threads
        Number of threads; None uses all processors.
    engine
        Engine to use instead of the default one.
    """
    with using(engine, threads=threads) as used:
        coarse = first_map(lf, range, used)
        if coarse is None:
            return 0.0
        rows, columns = (
            np.arange(size) * part // size for size, part in zip(lf.shape[2:4], coarse.shape, strict=True)
        )
        return measure_off_grid(lf, coarse[rows[:, None], columns], engine=used)


def refine_positions(
    lf: LightField,
    disparity: NDArray[Any],
    *,
    threads: int | None = None,
    engine: Engine | None = None,
) -> LightField:
    """The light field with its views where a first map shows that they are.

    Parameters
    ----------
    lf
        Light field, of equal brightness.
    disparity
        (H, W) disparity of the reference view, px per view step, NaN where it is unknown.
    threads
        Number of threads; None uses all processors.
    engine
        Engine to use instead of the default one.

    Raises
    ------
    LightFieldError
        If the views do not show where they are.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("leaves", size=96, views=5)
    >>> refined = lfdepth.refine_positions(lf, lf.truth)
    >>> refined.positions.shape, bool(abs(refined.positions).max() < 0.1)  # these stand on a grid
    ((5, 5, 2), True)
    """
    moved = measure_positions(lf, disparity, threads=threads, engine=engine)
    if moved is None:
        raise LightFieldError(
            f"{lf.name}: too little texture with parallax; expected some to locate the cameras; leave out "
            "--refine-positions"
        )
    moved[lf.centre] = 0
    known = np.zeros_like(moved) if lf.positions is None else lf.positions
    return replace(lf, positions=known + moved)


def _moved(
    lf: LightField, points: NDArray[np.int64], d: Array, gradient: Array, turns: int, engine: Engine
) -> Array:
    """How far views lie off their places (V, U, 2), a common scale of all steps apart."""
    moved = np.zeros((*lf.shape[:2], 2))
    for _ in range(turns):
        there = replace(lf, positions=lf.offsets + moved - grid_offsets((lf.shape[0], lf.shape[1])))
        found = sample(there, points, d, _REACH, engine)
        step, correction = _solved(there, points, d, gradient, luma(found.levels), found.seen)
        moved, d = moved + step, d + correction
    return _without_scale(moved, lf.offsets)


def textured_points(
    lf: LightField, disparity: NDArray[Any], most: int
) -> tuple[NDArray[np.int64], Array, Array]:
    """Pixels (N, 2) with texture that moves, their disparity, and gradient (N, 2) of full scale per px."""
    from lfdepth.engines.boxes import box_mean

    grey = box_mean(luma(lf.reference) / np.float32(lf.full_scale), _REACH, np.float32)
    slope: Array = np.stack([np.gradient(grey, axis=axis) for axis in (0, 1)], axis=-1)
    known = np.isfinite(disparity) & (np.abs(disparity) > _MOVING)
    known &= np.hypot(slope[..., 0], slope[..., 1]) > _GRADIENT
    edge = _REACH + 1
    inner = np.zeros_like(known)
    inner[edge:-edge, edge:-edge] = True
    chosen = np.argwhere(known & inner)
    chosen = chosen[:: max(1, -(-len(chosen) // most))]
    at = chosen[:, 0], chosen[:, 1]
    return chosen.astype(np.int64), disparity[at].astype(np.float64), slope[at]


def _solved(
    lf: LightField,
    points: NDArray[np.int64],
    d: Array,
    gradient: Array,
    levels: NDArray[np.float32],
    valid: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Steps of the views (V, U, 2) and corrections of the disparities (N,) that explain the levels."""
    steps = lf.offsets.reshape(-1, 2)
    centre = lf.centre[0] * lf.shape[1] + lf.centre[1]
    place = points - d[:, None] * steps[:, None]
    off = np.rint(place) - place
    change = levels - levels[centre] - np.einsum("nk,vnk->vn", gradient, off)
    along = steps @ gradient.T  # what a change of disparity does
    known = valid & valid[centre]
    weight = known.astype(np.float64)
    moved, correction = np.zeros_like(steps), np.zeros_like(d)
    if not known.any():
        return moved.reshape(*lf.shape[:2], 2), correction
    for _ in range(_ROUNDS):
        rest = change - np.einsum("nk,vk->vn", gradient, moved) * d
        correction = (weight * along * rest).sum(axis=0) / ((weight * along**2).sum(axis=0) + 1e-6)
        correction = np.clip(correction, -0.2, 0.2)
        rest = change - along * correction
        design = gradient * d[:, None]
        left = np.einsum("vn,nj,nk->vjk", weight, design, design, optimize=True) + 1e-6 * np.eye(2)
        right = np.einsum("vn,nj,vn->vj", weight, design, rest, optimize=True)
        moved = np.linalg.solve(left, right[..., None])[..., 0]
        moved[centre] = 0
        moved = np.clip(moved, -1, 1)
        error = np.abs(rest - np.einsum("nk,vk->vn", design, moved))
        scale = max(1.5 * float(np.median(error[valid])), 5e-4)
        weight = known / (1 + (error / (2 * scale)) ** 2) ** 2
    return moved.reshape(*lf.shape[:2], 2), correction


def _without_scale(moved: Array, steps: Array) -> Array:
    """Steps (V, U, 2) without what a common factor of all disparities would do; rows give the scale.

    Nor with a tilt, where all views stand in one line: a disparity of its own for each point makes up for
    that, too, so that the views do not tell it.
    """
    axis = 1 if steps[..., 1].any() else 0
    line = steps[..., axis]
    along = np.einsum("vuk,vu->k", moved, line) / max(float((line**2).sum()), 1e-9)
    if not steps[..., 1 - axis].any():
        moved = moved.copy()
        moved[..., 1 - axis] -= along[1 - axis] * line
    return np.asarray((moved - along[axis] * steps) / (1 + along[axis]))


def _irregular(moved: Array, steps: Array) -> Array:
    """The same without a ratio of vertical to horizontal steps, and the reference view's own place."""
    rest, down = moved - np.median(moved, axis=(0, 1)), steps[..., 0]
    if down.any():
        rest[..., 0] -= float((rest[..., 0] * down).sum() / (down**2).sum()) * down
    return np.asarray(rest, np.float64)
