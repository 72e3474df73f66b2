"""Does a disparity map hold? What the views say of it, and what may be wrong if they do not agree with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import using
from lfdepth.probe.agreement import disagreement, likeness, share_in_place
from lfdepth.probe.brightness import measure_brightness
from lfdepth.probe.geometry import (
    CHECKED_POINTS,
    NOTABLE_ASPECT,
    NOTABLE_POSITIONS,
    measure_aspect,
    off_grid_at,
    textured_points,
    with_aspect,
)
from lfdepth.probe.order import check_orientation, find_grid
from lfdepth.probe.ranges import margin

if TYPE_CHECKING:
    from lfdepth.engines.base import Engine
    from lfdepth.lightfield import LightField
    from lfdepth.probe.preparation import Prepared

# Bounds: on clean scenes of the suite at most 0.49 disagree and 0.03 lie at the ends, and at least 0.33 are
# in place (docs/research-log.md).
MOST_DISAGREEING = 0.53
MOST_AT_ENDS = 0.16
MOST_UNEVEN = 0.02
# Px by which most points move in the outermost view: of copies of one picture with 10 levels of noise 0.1.
LEAST_MOVED = 0.25
# On clean scenes at most 0.14 (noise-3), behind a path-traced mesh 0.26 to 0.31.
MOST_UNDECIDED = 0.2
LEAST_IN_PLACE, LEAST_BRIGHTEST = 0.25, 0.27

# How much more of the views have to agree with the best disparity than with others.
_STANDS_OUT = 0.1
# How far from a point the typical view shows something else, as a share of the contrast around it.
_DISAGREEING = 0.5
# Fewer textured points tell nothing: a defective pixel of the sensor makes as many.
_FEWEST = 200
# Of the samples of the reference view, the share that is not defective pixels and glints.
_ALL_BUT_GLINTS = 0.999
# Px per view step that belong to an end of the range; of it, at most.
_END, _END_SHARE = 0.05, 0.02
# Share of the points there that has to disagree, where the range was found in the views.
_END_DISAGREEING = 0.3
# Where more lie at the ends, the range is beside the scene.
_BESIDE = 0.5
# Confidence below which there is no evidence, and above which positions of views are measured.
_NO_EVIDENCE, _SURE = 0.2, 0.5
_COMPARED = 500
# Share of the textured points that move by less than is said to be the most.
_MOST_POINTS = 0.95
# Of clean scenes with little texture, fewer views may be in place; with more, none are on another grid.
_ALL_IN_PLACE = 0.9
# Only where fewer points disagree does a map tell where views stand.
_GOOD_MAP = 0.25


@dataclass(frozen=True)
class Checks:
    """What the views say of a disparity map.

    Attributes
    ----------
    disagreeing
        Share of the textured points at which the typical view shows something else than the reference view.
    at_ends
        Share of the pixels at the ends of the range that was searched.
    without_evidence
        Share of the pixels whose confidence is below 0.2.
    uneven
        Largest difference in brightness between views that was left, of full scale.
    aspect
        Vertical over horizontal steps, beside what the light field says of them; None if it is unknown.
    off_grid
        How far the typical view stands off its place, in steps.
    in_place
        Share of the views that show what the reference view shows; 0 where that repeats along the grid.
    brightest
        What 99.9 % of the samples of the reference view do not exceed, of full scale.
    order_wrong
        Whether the views are in another order; looked at where rows and columns share no disparities.
    grid
        (V, U), the grid that the views were taken on, if it is another one; looked for where the views
        contradict the map.
    aspect_helps
        Whether the views are in place if `aspect` is taken into account; looked at where it is not 1.
    suspected
        How far the brightness of views seems to differ, of their level, where they are too small to
        equalise; otherwise 0.
    undecided
        Share of the textured points at which views contradict the map, and no other disparity stands out
        either; 0 from methods that do not tell.
    moved
        By how many px 95 % of the textured points move at most in the outermost view; None where there are
        too few of them.
    warnings
        In plain words, the likeliest cause first; empty if nothing is beyond its bound.
    """

    disagreeing: float
    at_ends: float
    without_evidence: float
    uneven: float
    aspect: float | None
    off_grid: float
    in_place: float
    brightest: float
    order_wrong: bool = False
    grid: tuple[int, int] | None = None
    aspect_helps: bool = False
    suspected: float = 0.0
    undecided: float = 0.0
    moved: float | None = None
    warnings: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Plain dictionary that JSON can hold."""
        return asdict(self) | {"warnings": list(self.warnings)}


def check_map(
    prepared: Prepared,
    disparity: NDArray[np.float32],
    confidence: NDArray[np.float32],
    *,
    as_read: LightField | None = None,
    standing_out: Callable[[NDArray[np.int64]], NDArray[np.float32]] | None = None,
    engine: Engine | None = None,
) -> Checks:
    """Check a map against the views that it was estimated from.

    Parameters
    ----------
    prepared
        The light field as the method saw it, and its range.
    disparity, confidence
        (H, W) maps.
    as_read
        The light field before anything was done to its views, which shows better on which grid they were
        taken; by default, the same.
    standing_out
        What the method says of that, `lfdepth.methods.base.Maps`.
    engine
        Engine to use instead of the default one.
    """
    lf, range = prepared.lf, prepared.range
    points, apart = disagreement(lf, disparity, engine=engine)
    equalised = prepared.equalisation
    shades = equalised or measure_brightness(lf, range=range, engine=engine)
    uneven = float(shades.effect.max()) if equalised is None and shades.needed else 0.0
    sure = textured_points(lf, np.where(confidence > _SURE, disparity, np.nan), CHECKED_POINTS)
    with using(engine) as used:
        off_grid, in_place = off_grid_at(lf, sure, used), _in_place(lf, disparity, sure, used)
    found = Checks(
        disagreeing=float((apart > _DISAGREEING).mean()) if apart.size >= _FEWEST else 0.0,
        at_ends=_at_ends(lf, disparity, prepared, engine),
        without_evidence=float((confidence < _NO_EVIDENCE).mean()),
        uneven=uneven,
        aspect=measure_aspect(lf, range, engine=engine),
        off_grid=off_grid,
        in_place=in_place,
        brightest=float(np.quantile(lf.reference, _ALL_BUT_GLINTS) / lf.full_scale),
        suspected=shades.suspected,
        undecided=_undecided(points[apart > _DISAGREEING], len(apart), standing_out),
        moved=_moved(lf, disparity, points),
    )
    with using(engine) as used:
        found = _with_order(found, lf, as_read or lf, range, used)
    return replace(found, warnings=tuple(_warnings(found, range, prepared.range_found)))


def _with_order(
    found: Checks, lf: LightField, as_read: LightField, range: tuple[float, float], engine: Engine
) -> Checks:
    """The same with what the order of the views and their grid say, where there is reason to ask."""
    uneven_steps = found.aspect is not None and abs(found.aspect - 1) > NOTABLE_ASPECT
    doubtful = found.in_place < _ALL_IN_PLACE or uneven_steps or _warnings(found, range, range_found=True)
    if doubtful and (other := find_grid(as_read, engine)):
        return replace(found, grid=other.grid)
    if uneven_steps and lf.positions is None:
        assert found.aspect is not None
        found = replace(found, aspect_helps=_is_in_order(with_aspect(lf, found.aspect), engine))
    elif uneven_steps:
        found = replace(found, aspect_helps=True)
    if min(lf.shape[:2]) > 1 and found.aspect is None:
        # Where the views are in order, their row and their column nearly always share their disparities.
        found = replace(found, order_wrong=check_orientation(lf, engine=engine).wrong)
    return found


def _is_in_order(lf: LightField, engine: Engine) -> bool:
    found = check_orientation(lf, engine=engine)
    return found.order_decided and not found.wrong


def _undecided(
    points: NDArray[np.int64],
    count: int,
    standing_out: Callable[[NDArray[np.int64]], NDArray[np.float32]] | None,
) -> float:
    """Share of `count` textured points at which views disagree and nothing stands out; `points` disagree."""
    if standing_out is None or count < _FEWEST or not len(points):
        return 0.0
    return float(np.count_nonzero(standing_out(points) < _STANDS_OUT)) / count


def _moved(lf: LightField, disparity: NDArray[np.float32], points: NDArray[np.int64]) -> float | None:
    """Px by which most of the points move in the outermost view; None where these are too few."""
    if len(points) < _FEWEST:
        return None
    far = float(np.abs(lf.offsets[lf.available]).max())
    return far * float(np.quantile(np.abs(disparity[points[:, 0], points[:, 1]]), _MOST_POINTS))


def _in_place(
    lf: LightField,
    disparity: NDArray[np.float32],
    sure: tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]],
    engine: Engine,
) -> float:
    points, d, _ = sure
    if len(d) < _COMPARED // 4:  # a map that is wrong everywhere may be sure of nothing
        points, d, _ = textured_points(lf, disparity, _COMPARED)
    every = slice(None, None, max(1, -(-len(d) // _COMPARED)))
    return share_in_place(likeness(lf, points[every], d[every], engine))


def _at_ends(
    lf: LightField, disparity: NDArray[np.float32], prepared: Prepared, engine: Engine | None
) -> float:
    """Share of the pixels at the ends of the range; 0 where that was found, and the views agree there."""
    low, high = prepared.range
    near = min(_END, _END_SHARE * (high - low))
    if prepared.range_found:  # surfaces at the ends of what was found lie a small margin inside
        near = min(near, margin(lf) / 5)
    there = (disparity < low + near) | (disparity > high - near)
    share = float(there.mean())
    if prepared.range_found and share > MOST_AT_ENDS:
        _, apart = disagreement(lf, np.where(there, disparity, np.nan), engine=engine)
        if apart.size and (apart > _DISAGREEING).mean() < _END_DISAGREEING:
            return 0.0
    return share


def _warnings(found: Checks, range: tuple[float, float], range_found: bool) -> list[str]:
    """What is beyond its bound, first that which the rest may follow from."""
    ends = (
        f"{100 * found.at_ends:.0f} % of the pixels lie at the ends of the range {range[0]:g} to "
        f"{range[1]:g}; the scene may reach beyond it; give a wider one with --range MIN MAX"
    )
    words = []
    if found.brightest < LEAST_BRIGHTEST:
        words.append(
            f"99.9 % of the samples lie below {100 * found.brightest:.2g} % of white; where samples fill "
            "only part of their type, say so with --white-level N (white_level=N in Python)"
        )
    if found.grid is not None:
        return [*words, _grid_words(found.grid)]  # all else may follow from it
    if found.at_ends > _BESIDE:
        words.append(ends)
    if range_found and found.moved is not None and found.moved < LEAST_MOVED:
        words.append(
            f"hardly anything moves between the views, by {found.moved:.2f} px at most; unless the scene all "
            "lies at the focus distance, these are copies of one picture; use views from different places"
        )
    if found.order_wrong:
        words.append(
            "views are not in the expected order, top to bottom and left to right; run lfdepth info "
            "(lfdepth.check_orientation in Python) to see which options fix it"
        )
    elif found.in_place < LEAST_IN_PLACE:
        words.append(
            "many views contradict the map; check the order of the views, whether every second row runs "
            "backwards (--serpentine), and the number of rows and columns (lfdepth info)"
        )
    words += _measured(found)
    if MOST_AT_ENDS < found.at_ends <= _BESIDE:
        words.append(ends)
    if found.undecided > MOST_UNDECIDED and not words:
        words.append(
            f"no disparity explains the views at {100 * found.undecided:.0f} % of the textured points; views "
            "may not be rectified, equally sharp or free of strong compression, or what is there be hidden "
            "in most of them, as behind a mesh, or repeat itself; do not use pixels of low confidence"
        )
    if found.disagreeing > MOST_DISAGREEING:
        causes = "" if range_found else "the range, "
        words.append(
            f"most views contradict the map at {100 * found.disagreeing:.0f} % of the textured points; check "
            f"{causes}the order of the views, the number of rows and columns (lfdepth info), brightness and "
            "white level"
        )
    return words


def _grid_words(grid: tuple[int, int]) -> str:
    return (
        f"views were taken on another grid than they are read with, of {grid[1]} columns and {grid[0]} rows; "
        "run lfdepth info (lfdepth.check_orientation in Python) to see which options fix it"
    )


def _measured(found: Checks) -> list[str]:
    """What was measured in the views, and what makes up for it."""
    words = []
    if found.uneven > MOST_UNEVEN:
        words.append(
            f"brightness differs between views by {100 * found.uneven:.0f} % of full scale; leave out "
            "--equalise off (equalise=False in Python)"
        )
    if found.suspected:
        words.append(
            f"brightness seems to differ between views by {100 * found.suspected:.0f} %, which are too small "
            "to equalise (under 64 px); use larger views, or equalise them beforehand"
        )
    if found.aspect_helps:
        words.append(
            f"the vertical step between views is {found.aspect:.2f} of the horizontal step; use "
            f"--aspect {found.aspect:.2f} (lfdepth.with_aspect in Python)"
        )
    if found.off_grid > NOTABLE_POSITIONS and found.disagreeing < _GOOD_MAP:
        words.append(
            f"views are off the regular grid by {100 * found.off_grid:.0f} % of a step; use "
            "--refine-positions (lfdepth.refine_positions in Python)"
        )
    return words
