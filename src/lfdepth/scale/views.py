"""Disparity of every view, from a few estimates that are carried into all views and made to agree.

The method estimates the reference view and the outermost views of the grid, which between them see nearly
everything that any view sees. Each map is carried into every view by the splat. What the reference view
shows is taken from its map; where it shows nothing, or the others carry something else there, the colours of
all views that see the place decide (`Engine.support`), and where no map has anything, they decide between
planes over the whole range. Then the edges of each map are decided by its own view's colours, with what the
other maps say of who sees what, and every map is held against others (`Engine.agree`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.median import weighted_median
from lfdepth.blocks.photo import FEWEST_VIEWS, local_thresholds
from lfdepth.blocks.recentre import from_view
from lfdepth.engines import engine as start_engine
from lfdepth.engines import using
from lfdepth.engines.base import Engine
from lfdepth.engines.layout import VISIBILITY_MARGIN
from lfdepth.errors import LightFieldError
from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField
from lfdepth.memory import available_memory, size_text
from lfdepth.methods import DEFAULT, Method
from lfdepth.methods import method as named_method
from lfdepth.probe.brightness import equalise as equalise_views
from lfdepth.result import Result, ViewMaps
from lfdepth.trace import Progress

View = tuple[int, int]
Map = NDArray[np.float32]

_APART = 0.1
"""Px per view step from which on two maps say something different, and a pixel does not hold."""
_PREFERENCE = 0.2
"""By how much the colours must speak for another map before the reference view's is given up."""
_PLANES = 0.1
"""Px per view step between the planes that are tried where no map has anything."""
_MEDIAN_RADIUS, _MEDIAN_COLOUR, _MEDIAN_SPACE = 1, 0.05, 2.0
_JUMP, _SPREAD, _INERTIA = 0.15, 0.3, 1.0
"""As `blocks.edges.EdgeRule` has them, but that edges which a splat placed have less of a say."""
_SPARE = 4
"""Bytes per pixel and view beside the maps: surfaces of all views, and what is disputed."""


def estimate_views(
    lf: LightField,
    method: str | Method = DEFAULT,
    *,
    range: tuple[float, float] | None = None,
    engine: str = "cpu",
    threads: int | None = None,
    progress: Progress | None = None,
    force: bool = False,
    equalise: bool = True,
    check: bool = True,
    **options: Any,
) -> ViewMaps:
    """Estimate the disparity map of every view.

    Parameters
    ----------
    lf
        Light field of two views at least.
    method, range, engine, threads, progress, force, equalise, check, **options
        As for `lfdepth.estimate`, which estimates the reference view and the outermost ones.

    Returns
    -------
    ViewMaps

    Raises
    ------
    LightFieldError
        As `lfdepth.estimate` does, or if the maps would not fit in memory.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> maps = lfdepth.estimate_views(scenes.render("bars", size=64, views=3), "fbs-sfa", planes=10)
    >>> maps.disparity.shape
    (3, 3, 64, 64)
    """
    started = time.perf_counter()
    chosen = named_method(method, **options)
    chosen.check(lf.shape)
    if not force:
        check_memory(lf.name, lf.shape, lf.views.itemsize, views=False)
    places = outermost_views(lf)
    steps = _Steps(progress, 1 + len(places) + 4 * int(lf.available.sum()))
    settings: dict[str, Any] = {"engine": engine, "threads": threads, "force": force}
    first = estimate(lf, chosen, range=range, equalise=equalise, check=check, **settings)
    steps.done("reference view")
    if first.equalisation is not None:
        lf = equalise_views(lf, first.equalisation)
    anchors = [_Anchor.of(lf, lf.centre, first)]
    settings |= {"range": first.range, "equalise": False, "check": False}
    quick = _quick(chosen)
    for place in places:
        anchors.append(_Anchor.of(lf, place, estimate(from_view(lf, place), quick, **settings)))
        steps.done("outermost views")
    with start_engine(engine, threads=threads) as used:
        maps = _Maps(lf, first.range, used, steps)
        maps.carry(anchors)
        del anchors[1:]
        maps.choose()
        maps.decide_edges()
        share = maps.agree()
    return ViewMaps(
        disparity=maps.disparity.reshape(lf.shape[:4]),
        confidence=maps.confidence.reshape(lf.shape[:4]),
        visible=maps.visible.reshape(lf.shape[:4]),
        reference=first,
        consistency=share,
        runtime=time.perf_counter() - started,
    )


def outermost_views(lf: LightField) -> list[View]:
    """The views that stand farthest out in the four diagonal directions, the reference view aside."""
    there = np.argwhere(lf.available)
    offsets = lf.offsets[tuple(there.T)]
    found = []
    for direction in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        v, u = there[int(np.argmax(offsets @ np.array(direction)))].tolist()
        if (v, u) != lf.centre and (v, u) not in found:
            found.append((v, u))
    return found


def consistency(disparity: NDArray[np.float32], lf: LightField, *, threads: int | None = None) -> float:
    """Share of the pixels of the maps (V, U, H, W) of all views that hold: `ViewMaps.consistency`.

    Every view is compared with its four neighbours, the ends of its row and its column, and the reference
    view.
    """
    maps = disparity.reshape(-1, lf.height, lf.width)
    with using(None, threads=threads) as used:
        counts = _Counts()
        for index in np.flatnonzero(lf.available):
            _, agreeing, against = _held(used, lf, maps, int(index))
            counts.add(agreeing, against)
    return counts.share


def _quick(method: Method) -> Method:
    """The method with the least effort, where it has a choice: the outermost views only fill in."""
    parameters = method.parameters()
    return type(method)(**parameters | {"effort": "fast"}) if "effort" in parameters else method


@dataclass
class _Steps:
    """Tells how far the work is."""

    progress: Progress | None
    total: int
    count: int = 0

    def done(self, what: str) -> None:
        self.count += 1
        if self.progress is not None:
            self.progress(self.count, self.total, what)


@dataclass
class _Counts:
    """Pixels that hold, and that do not."""

    agreeing: int = 0
    against: int = 0

    def add(self, agreeing: NDArray[np.int32], against: NDArray[np.int32]) -> None:
        self.agreeing += int(agreeing.sum(dtype=np.int64))
        self.against += int(against.sum(dtype=np.int64))

    @property
    def share(self) -> float:
        return self.agreeing / max(self.agreeing + self.against, 1)


@dataclass(frozen=True, eq=False)
class _Anchor:
    """A map that was estimated, and where its view stands."""

    offset: NDArray[np.float64]
    disparity: Map
    confidence: Map

    @staticmethod
    def of(lf: LightField, view: View, result: Result) -> _Anchor:
        return _Anchor(lf.offsets[view], result.disparity, result.confidence)


@dataclass(frozen=True, eq=False)
class _Disputed:
    """Pixels (N, 2) of a view, what they may be, (N, K), and the confidence of each."""

    places: NDArray[np.int64]
    candidates: Map
    confidence: Map


class _Maps:
    """The maps of all views (V·U, H, W), from the first splat to the last comparison."""

    def __init__(self, lf: LightField, range: tuple[float, float], engine: Engine, steps: _Steps) -> None:
        self.lf, self.engine, self.steps = lf, engine, steps
        count = max(2, round((range[1] - range[0]) / _PLANES) + 1)
        self.planes = np.linspace(*range, count).astype(np.float32)  # of equals, the farthest is taken
        shape = lf.shape[0] * lf.shape[1], lf.height, lf.width
        self.disparity = np.full(shape, np.nan, np.float32)
        self.confidence = np.zeros(shape, np.float32)
        self.visible = np.zeros(shape, np.bool_)
        self.indices = [int(index) for index in np.flatnonzero(lf.available)]
        self.views = engine.views(lf)
        self.halves = [engine.views(replace(lf, present=_half(lf, parity))) for parity in (0, 1)]
        self._disputed: dict[int, list[_Disputed]] = {}

    def view_of(self, index: int) -> View:
        """Row and column of a view in the grid."""
        return divmod(index, self.lf.shape[1])

    def carry(self, anchors: Sequence[_Anchor]) -> None:
        """Carry the anchors' maps into every view; the first one's is taken where there is any."""
        for index in self.indices:
            offset = self.lf.offsets[self.view_of(index)]
            carried = [
                self.engine.carry(each.disparity, each.confidence, tuple(offset - each.offset))
                for each in anchors
            ]
            maps, trust = (np.stack(each) for each in zip(*carried, strict=True))
            self._take(index, maps, trust)
            self.steps.done("carried")

    def _take(self, index: int, maps: Map, trust: Map) -> None:
        """The map of a view as the first anchor has it, and what the others hold against it."""
        known = np.isfinite(maps)
        nearest = maps.argmax(axis=0)
        source = np.where(known[0], 0, nearest)
        picked = (np.take_along_axis(each, source[None], 0)[0] for each in (maps, trust))
        self.disparity[index], self.confidence[index] = picked
        self.visible[index] = known[0]
        lowest = np.where(known, maps, np.inf).min(axis=0)
        disputed = maps.max(axis=0) - lowest > _APART  # never where nothing is known
        unknown = ~known.any(axis=0)
        self.disparity[index][unknown] = np.nan
        self._disputed[index] = [_Disputed(np.argwhere(disputed), maps[:, disputed].T, trust[:, disputed].T)]
        if unknown.any():
            planes = np.broadcast_to(self.planes, (int(unknown.sum()), len(self.planes)))
            self._disputed[index].append(_Disputed(np.argwhere(unknown), planes, np.zeros_like(planes)))

    def choose(self) -> None:
        """Let the colours of all views decide what is disputed; remove isolated values."""
        surfaces = self.engine.known_surfaces(self.disparity.reshape(self.lf.shape[:4]), self.views)
        for index in self.indices:
            at = self.view_of(index)
            _, thresholds = self._seen_from(at)
            seen = self.engine.from_view(self.halves[sum(at) % 2], at)  # neighbours say much the same
            for each in self._disputed.pop(index):
                support = self.engine.support(
                    seen, surfaces, each.places, each.candidates, thresholds, margin=VISIBILITY_MARGIN
                )
                support[:, 0] += np.where(support[:, 0] >= 0, _PREFERENCE, 0)
                best, rows = support.argmax(axis=1), np.arange(len(support))
                where = tuple(each.places.T)
                self.disparity[index][where] = each.candidates[rows, best]
                self.confidence[index][where] = each.confidence[rows, best]
            self.disparity[index] = self._without_isolated(index)
            self.steps.done("disputed")

    def _without_isolated(self, index: int) -> Map:
        view = self.lf.views[self.view_of(index)]
        guide = np.ascontiguousarray(view.astype(np.float32) / np.float32(self.lf.full_scale))
        return weighted_median(
            self.disparity[index],
            guide,
            radius=_MEDIAN_RADIUS,
            sigma_colour=_MEDIAN_COLOUR,
            sigma_space=_MEDIAN_SPACE,
            engine=self.engine,
        )

    def decide_edges(self) -> None:
        """Decide the edges of every map by its view's colours."""
        surfaces = self.engine.known_surfaces(self.disparity.reshape(self.lf.shape[:4]), self.views)
        found = np.zeros((self.lf.height, self.lf.width), np.bool_)
        for index in self.indices:
            seen, thresholds = self._seen_from(self.view_of(index))
            self.disparity[index] = self.engine.decide_edges(
                seen,
                self.disparity[index],
                surfaces,
                thresholds,
                found,
                jump=_JUMP,
                spread=_SPREAD,
                inertia=_INERTIA,
            )
            self.steps.done("edges")

    def agree(self) -> float:
        """Hold every map against others, once; the share of pixels that hold."""
        before, counts = self.disparity.copy(), _Counts()
        for index in self.indices:
            settled, agreeing, against = _held(self.engine, self.lf, before, index)
            self.disparity[index] = settled
            self.confidence[index] *= (agreeing + 1) / (agreeing + against + np.float32(1))
            counts.add(agreeing, against)
            self.steps.done("agreement")
        return counts.share

    def _seen_from(self, at: View) -> tuple[Any, Map]:
        """The views with one of them as the reference view, and its thresholds in 8-bit levels."""
        thresholds = local_thresholds(self.lf.views[at]) * np.float32(255)
        return self.engine.from_view(self.views, at), thresholds


def _half(lf: LightField, parity: int) -> NDArray[np.bool_]:
    """Every second view (V, U), as on a chessboard, and the reference view; all of a small grid."""
    chosen = lf.available & (np.indices(lf.shape[:2]).sum(axis=0) % 2 == parity)
    chosen[lf.centre] = True
    return chosen if np.count_nonzero(chosen) >= FEWEST_VIEWS else lf.available


def _held(
    engine: Engine, lf: LightField, maps: Map, index: int
) -> tuple[Map, NDArray[np.int32], NDArray[np.int32]]:
    """One of the maps (V·U, H, W) held against those of its neighbours, its row's and column's ends."""
    rows, columns = lf.shape[:2]
    v, u = divmod(index, columns)
    near = [(v - 1, u), (v + 1, u), (v, u - 1), (v, u + 1)]
    far = [(v, 0), (v, columns - 1), (0, u), (rows - 1, u), lf.centre]
    partners = sorted(
        {
            (row, column)
            for row, column in near + far
            if 0 <= row < rows and 0 <= column < columns and lf.available[row, column]
        }
        - {(v, u)}
    )
    steps = np.array([lf.offsets[each] - lf.offsets[v, u] for each in partners]).reshape(-1, 2)
    numbers = np.array([row * columns + column for row, column in partners], np.int64)
    return engine.agree(maps, index, numbers, steps, tolerance=_APART)


def check_memory(name: str, shape: tuple[int, ...], itemsize: int, *, views: bool) -> None:
    """Raise LightFieldError where the maps of all views do not fit in what is free.

    Parameters
    ----------
    name
        What the light field is called.
    shape
        (V, U, H, W, C).
    itemsize
        Bytes of a sample.
    views
        Whether the views have to be read as well.
    """
    free = available_memory()
    v, u, height, width, channels = shape
    # Disparity twice, confidence, visibility; and the views once more, around the outermost one.
    samples = channels * itemsize * (2 if views else 1)
    needed = v * u * height * width * (13 + _SPARE + samples)
    if free is not None and needed > free:
        raise LightFieldError(
            f"{name}: maps of all {v * u} views need {size_text(needed)}, {size_text(free)} are free; "
            "expected enough memory; use --crop, --scale or --views, or --force (force=True in Python) to "
            "try anyway"
        )
