"""Disparity of every view, from a few estimates that are carried into all views and made to agree.

The method estimates the reference view and the outermost views of the grid, which between them see nearly
everything that any view sees. Each map is carried into every view by the splat. What the reference view
shows is taken from its map; where it shows nothing, or the others carry something else there, the colours of
all views that see the place decide (`Engine.support`), and where no map has anything, they decide between
planes over the whole range. Then the edges of each map are decided by its own view's colours, with what the
other maps say of who sees what, and every map is held against others (`Engine.agree`).
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.median import weighted_median
from lfdepth.blocks.photo import FEWEST_VIEWS, local_thresholds
from lfdepth.blocks.recentre import from_view
from lfdepth.engines import engine as start_engine
from lfdepth.engines import using
from lfdepth.engines.base import Engine
from lfdepth.engines.layout import VISIBILITY_MARGIN, surface_levels
from lfdepth.errors import LightFieldError
from lfdepth.estimation import estimate
from lfdepth.io.view_maps import (
    ABSENT,
    ViewMapsTarget,
    check_view_maps_writable,
    facts_of,
    writing_view_maps,
)
from lfdepth.lightfield import LightField, unit
from lfdepth.memory import available_memory, size_text
from lfdepth.methods import DEFAULT, Method
from lfdepth.methods import method as named_method
from lfdepth.probe.brightness import equalise as equalise_views
from lfdepth.result import Result, ViewMaps
from lfdepth.scale.scratch import Maps, Scratch
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
_KEPT = 34
"""Bytes per pixel and view of all that is kept until maps are done, in memory or on a disk: maps, thresholds,
surfaces, and what is disputed, which is a sixth of a scene that is easy and a third of one that is not."""
_AT_ONCE = 200
"""Bytes per pixel of maps that are in memory at once, of a view and of those that it is made from."""
_LEVEL = 2
"""Bytes of a pixel's surface, which all views are asked for."""
_BAND_BYTES, _LEAST_ROWS = 32_000_000, 16
"""Surfaces of a band of rows in all views, at most, unless it has so few rows."""


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
    if not force:
        check_memory(lf.name, lf.shape, lf.views.itemsize, views=False, held=True)
    arrays = _Arrays(lf.shape[:2])
    made = _make(
        lf,
        named_method(method, **options),
        nullcontext(arrays),
        None,
        range=range,
        engine=engine,
        threads=threads,
        progress=progress,
        force=force,
        equalise=equalise,
        check=check,
    )
    return ViewMaps(
        disparity=arrays.maps["disparity"],
        confidence=arrays.maps["confidence"],
        visible=arrays.maps["visible"],
        reference=made.reference,
        consistency=made.consistency,
        runtime=made.runtime,
    )


def estimate_views_to(
    lf: LightField,
    out: str | Path,
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
) -> WrittenViews:
    """Estimate the disparity map of every view, and write each when it is done.

    The same maps as `estimate_views`, to a bit. Only those of a few views are in memory; what is needed of
    the others meanwhile lies in files beside `out`, which have no name and are gone at the end.

    Parameters
    ----------
    lf
        Light field of two views at least.
    out
        `.npz`, `.zarr`, or a folder, as `lfdepth.write` makes of `ViewMaps`; complete or not at all.
    method, range, engine, threads, progress, force, equalise, check, **options
        As for `estimate_views`.

    Returns
    -------
    WrittenViews

    Raises
    ------
    LightFieldError
        As `lfdepth.estimate` does, if there is too little memory or disk, or `out` cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> path = f"{tempfile.mkdtemp()}/maps.npz"
    >>> lf = scenes.render("bars", size=64, views=3)
    >>> made = lfdepth.estimate_views_to(lf, path, "fbs-sfa", planes=10)
    >>> made.consistency > 0.98
    True
    """
    out = Path(out)
    check_view_maps_writable(out)
    if not force:
        check_memory(lf.name, lf.shape, lf.views.itemsize, views=False)
        check_disk(lf.name, lf.shape, out)
    return _make(
        lf,
        named_method(method, **options),
        writing_view_maps(out, lf.shape[:4], lf.available),
        out.resolve().parent,
        range=range,
        engine=engine,
        threads=threads,
        progress=progress,
        force=force,
        equalise=equalise,
        check=check,
    )


def estimate_view_among_all(
    lf: LightField, view: View, method: Method, scratch: Path, **settings: Any
) -> tuple[Result, WrittenViews]:
    """The map that a view has among those of all (`ViewMaps.of`), the others of which are not kept.

    `scratch` is a folder with room for what all views need meanwhile; `settings` as for `estimate_views`.
    """
    one = _One(view)
    made = _make(lf, method, nullcontext(one), scratch, **settings)
    result = replace(
        made.reference,
        disparity=one.maps["disparity"],
        confidence=one.maps["confidence"],
        runtime=made.runtime,
        sigma=None,
        checks=None,
    )
    return result, made


@dataclass(frozen=True, eq=False)
class WrittenViews:
    """What is known of maps that were written.

    Attributes
    ----------
    reference
        The reference view's own estimate, from which the maps were made.
    consistency
        Share of the pixels that hold: see `ViewMaps`.
    runtime
        Seconds for all of it.

    Examples
    --------
    >>> import tempfile
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("bars", size=64, views=3)
    >>> made = lfdepth.estimate_views_to(lf, f"{tempfile.mkdtemp()}/maps", "fbs-sfa", planes=10)
    >>> made.reference.disparity.shape
    (64, 64)
    """

    reference: Result
    consistency: float
    runtime: float


def _make(
    lf: LightField,
    method: Method,
    target: AbstractContextManager[ViewMapsTarget],
    folder: Path | None,
    *,
    range: tuple[float, float] | None = None,
    engine: str = "cpu",
    threads: int | None = None,
    progress: Progress | None = None,
    force: bool = False,
    equalise: bool = True,
    check: bool = True,
) -> WrittenViews:
    """Estimate a few views, and put the maps of all into a target; `folder` is for what is kept meanwhile."""
    started = time.perf_counter()
    method.check(lf.shape)
    places = outermost_views(lf)
    steps = _Steps(progress, 1 + len(places))
    settings: dict[str, Any] = {"engine": engine, "threads": threads, "force": force}
    first = estimate(lf, method, range=range, equalise=equalise, check=check, **settings)
    steps.done("reference view")
    if first.equalisation is not None:
        lf = equalise_views(lf, first.equalisation)
    anchors = [_Anchor.of(lf, lf.centre, first)]
    settings |= {"range": first.range, "equalise": False, "check": False}
    quick = _quick(method)
    for place in places:
        anchors.append(_Anchor.of(lf, place, estimate(from_view(lf, place), quick, **settings)))
        steps.done("outermost views")
    with (
        target as into,
        Scratch(folder) as scratch,
        start_engine(engine, threads=threads) as used,
    ):
        share = _Maps(lf, first.range, used, scratch, into, steps).finish(anchors)
        made = WrittenViews(first, share, time.perf_counter() - started)
        into.finish(facts_of(first, share, made.runtime))
    return made


class _Arrays:
    """Maps of all views that are kept in memory, each kind from its first map on."""

    def __init__(self, grid: View) -> None:
        self.grid = grid
        self.maps: dict[str, NDArray[Any]] = {}

    def put(self, name: str, view: View, values: NDArray[Any]) -> None:
        if name not in self.maps:
            self.maps[name] = np.full((*self.grid, *values.shape), ABSENT[name])
        self.maps[name][view] = values

    def finish(self, facts: Mapping[str, Any]) -> None:
        """Facts are known to the one who asked."""


class _One:
    """The maps of one view."""

    def __init__(self, view: View) -> None:
        self.view = view
        self.maps: dict[str, NDArray[Any]] = {}

    def put(self, name: str, view: View, values: NDArray[Any]) -> None:
        if view == self.view:
            self.maps[name] = values

    def finish(self, facts: Mapping[str, Any]) -> None:
        """Facts are known to the one who asked."""


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
    """Tells how far the work is; `total` grows when it is known into how many bands maps are divided."""

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


class _Disputed:
    """Pixels of all views on which the anchors' maps differ, or of which none has anything, by bands."""

    def __init__(self, scratch: Scratch, bands: Sequence[tuple[int, int]]) -> None:
        self._differ, self._unknown = scratch.lists(), scratch.lists()
        self._ends = [last for _, last in bands]
        self._cuts: dict[tuple[int, bool], list[int]] = {}

    def put(self, index: int, where: NDArray[np.bool_], maps: Map, trust: Map) -> None:
        """Note what maps (N, H, W) say of a view's pixels, and how far they are to be trusted."""
        count = len(maps)
        kind = [("place", np.int32, 2), ("disparity", np.float32, count), ("trust", np.float32, count)]
        records = np.empty(np.count_nonzero(where), np.dtype(kind))
        records["place"] = np.argwhere(where)
        records["disparity"], records["trust"] = maps[:, where].T, trust[:, where].T
        self._note(index, False, records["place"])
        self._differ.put(index, records)

    def put_unknown(self, index: int, where: NDArray[np.bool_]) -> None:
        """Note the pixels of a view of which no map has anything."""
        records = np.empty(np.count_nonzero(where), np.dtype([("place", np.int32, 2)]))
        records["place"] = np.argwhere(where)
        self._note(index, True, records["place"])
        self._unknown.put(index, records)

    def of(self, index: int, band: int, planes: Map) -> Iterator[tuple[NDArray[np.int64], Map, Map | None]]:
        """Places (N, 2) in a band, what they may be (N, K), and the confidence of each; None: 0."""
        some = self._differ.get(index, *self._cuts[index, False][band : band + 2])
        if len(some):
            disparity, trust = (np.ascontiguousarray(some[name]) for name in ("disparity", "trust"))
            yield some["place"].astype(np.int64), disparity, trust
        none = self._unknown.get(index, *self._cuts[index, True][band : band + 2])
        if len(none):
            yield none["place"].astype(np.int64), np.tile(planes, (len(none), 1)), None

    def close(self) -> None:
        """Forget them."""
        self._differ.close()
        self._unknown.close()

    def _note(self, index: int, unknown: bool, places: NDArray[np.int32]) -> None:
        cuts = np.searchsorted(places[:, 0], self._ends).tolist()
        self._cuts[index, unknown] = [0, *cuts]


class _Maps:
    """The maps of all views (V·U, H, W), from the first splat to the last comparison.

    What one step leaves to the next lies in `scratch`. Steps that ask all views of a place do so in bands of
    rows, band by band for all views, so that what they look at is near together.
    """

    def __init__(
        self,
        lf: LightField,
        range: tuple[float, float],
        engine: Engine,
        scratch: Scratch,
        target: ViewMapsTarget,
        steps: _Steps,
    ) -> None:
        self.lf, self.engine, self.steps, self.scratch, self.target = lf, engine, steps, scratch, target
        count = max(2, round((range[1] - range[0]) / _PLANES) + 1)
        self.planes = np.linspace(*range, count).astype(np.float32)  # of equals, the farthest is taken
        self.shape = lf.shape[0] * lf.shape[1], lf.height, lf.width
        self.indices = [int(index) for index in np.flatnonzero(lf.available)]
        self.views = engine.views(lf)
        self.halves = [engine.views(replace(lf, present=_half(lf, parity))) for parity in (0, 1)]
        self.bands = _bands(lf) if scratch.in_files else [(0, lf.height)]
        steps.total += len(self.indices) * (3 + 2 * len(self.bands))
        self.disparity, self.confidence = (scratch.maps(self.shape, np.float32) for _ in "dc")
        self.thresholds = scratch.maps(self.shape, np.float32)
        self.levels = scratch.maps(self.shape, np.int16)

    def view_of(self, index: int) -> View:
        """Row and column of a view in the grid."""
        row, column = divmod(index, self.lf.shape[1])
        return row, column

    def finish(self, anchors: list[_Anchor]) -> float:
        """Every step, one after the other, which leaves the anchors' list empty; the share that holds."""
        disputed = self.carry(anchors)
        anchors.clear()
        self.choose(disputed)
        self.remove_isolated()
        return self.agree(self.decide_edges())

    def carry(self, anchors: Sequence[_Anchor]) -> _Disputed:
        """Carry the anchors' maps into every view; the first one's is taken where there is any."""
        disputed = _Disputed(self.scratch, self.bands)
        for index in self.indices:
            at = self.view_of(index)
            offset = self.lf.offsets[at]
            carried = [
                self.engine.carry(each.disparity, each.confidence, tuple(offset - each.offset))
                for each in anchors
            ]
            maps, trust = (np.stack(each) for each in zip(*carried, strict=True))
            self._take(index, maps, trust, disputed)
            self.thresholds.put(index, local_thresholds(self.lf.views[at]) * np.float32(255))
            self.steps.done("carried")
        return disputed

    def _take(self, index: int, maps: Map, trust: Map, disputed: _Disputed) -> None:
        """The map of a view as the first anchor has it, and what the others hold against it."""
        known = np.isfinite(maps)
        nearest = maps.argmax(axis=0)
        source = np.where(known[0], 0, nearest)
        disparity, confidence = (np.take_along_axis(each, source[None], 0)[0] for each in (maps, trust))
        lowest = np.where(known, maps, np.inf).min(axis=0)
        differ = maps.max(axis=0) - lowest > _APART  # never where nothing is known
        unknown = np.asarray(~known.any(axis=0))
        disparity[unknown] = np.nan
        disputed.put(index, differ, maps, trust)
        disputed.put_unknown(index, unknown)
        self.disparity.put(index, disparity)
        self.levels.put(index, surface_levels(disparity))
        self.confidence.put(index, confidence)
        self.target.put("visible", self.view_of(index), known[0])

    def choose(self, disputed: _Disputed) -> None:
        """Let the colours of all views decide what is disputed."""
        surfaces, thresholds = self._surfaces(), self.thresholds.whole()
        for band, (first, last) in enumerate(self.bands):
            for index in self.indices:
                at = self.view_of(index)
                seen = self.engine.from_view(self.halves[sum(at) % 2], at)  # neighbours say much the same
                disparity, confidence = (
                    each.get(index, first, last) for each in (self.disparity, self.confidence)
                )
                for places, candidates, trust in disputed.of(index, band, self.planes):
                    support = self.engine.support(
                        seen, surfaces, places, candidates, thresholds[index], margin=VISIBILITY_MARGIN
                    )
                    support[:, 0] += np.where(support[:, 0] >= 0, _PREFERENCE, 0)
                    best, numbers = support.argmax(axis=1), np.arange(len(support))
                    where = places[:, 0] - first, places[:, 1]
                    disparity[where] = candidates[numbers, best]
                    confidence[where] = 0 if trust is None else trust[numbers, best]
                self.disparity.put(index, disparity, first)
                self.confidence.put(index, confidence, first)
                self.thresholds.let_go()
                self.steps.done("disputed")
            self.levels.let_go()
        disputed.close()

    def remove_isolated(self) -> None:
        """Remove isolated values."""
        for index in self.indices:
            view = self.lf.views[self.view_of(index)]
            guide = np.ascontiguousarray(unit(view, self.lf.full_scale))
            disparity = weighted_median(
                self.disparity.get(index),
                guide,
                radius=_MEDIAN_RADIUS,
                sigma_colour=_MEDIAN_COLOUR,
                sigma_space=_MEDIAN_SPACE,
                engine=self.engine,
            )
            self.disparity.put(index, disparity)
            self.levels.put(index, surface_levels(disparity))
            self.steps.done("isolated")

    def decide_edges(self) -> Maps:
        """Decide the edges of every map by its view's colours."""
        decided = self.scratch.maps(self.shape, np.float32)
        surfaces, thresholds, disparity = (
            self._surfaces(),
            self.thresholds.whole(),
            self.disparity.whole(),
        )
        found = np.zeros(self.shape[1:], np.bool_)
        for rows in self.bands:
            for index in self.indices:
                seen = self.engine.from_view(self.views, self.view_of(index))
                rule = {"jump": _JUMP, "spread": _SPREAD, "inertia": _INERTIA}
                part = self.engine.decide_edges(
                    seen, disparity[index], surfaces, thresholds[index], found, rows=rows, **rule
                )
                decided.put(index, part, rows[0])
                self.thresholds.let_go()
                self.disparity.let_go()
                self.steps.done("edges")
            self.levels.let_go()
        for each in (self.levels, self.thresholds, self.disparity):
            each.close()
        return decided

    def agree(self, decided: Maps) -> float:
        """Hold every map against others, once; the share of pixels that hold."""
        before, counts = decided.whole(), _Counts()
        for index in self.indices:
            at = self.view_of(index)
            settled, agreeing, against = _held(self.engine, self.lf, before, index)
            confidence = self.confidence.get(index)
            confidence *= (agreeing + 1) / (agreeing + against + np.float32(1))
            self.target.put("disparity", at, settled)
            self.target.put("confidence", at, confidence)
            counts.add(agreeing, against)
            decided.let_go()
            self.steps.done("agreement")
        return counts.share

    def _surfaces(self) -> Any:
        """What all views show by the maps as they are."""
        return self.engine.known_surfaces(self.levels.whole().reshape(self.lf.shape[:4]), self.views)


def _bands(lf: LightField) -> list[tuple[int, int]]:
    """Rows [first, last) that are looked at together in all views."""
    row = lf.shape[0] * lf.shape[1] * lf.width * _LEVEL
    height = max(_LEAST_ROWS, _BAND_BYTES // row)
    return [(first, min(first + height, lf.height)) for first in range(0, lf.height, height)]


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


def check_memory(
    name: str, shape: tuple[int, ...], itemsize: int, *, views: bool, held: bool = False
) -> None:
    """Raise LightFieldError where what all views take does not fit in what is free.

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
    held
        Whether all maps are kept in memory, and not written one by one.
    """
    free = available_memory()
    v, u, height, width, channels = shape
    views_of, pixels = v * u, height * width
    # The views once more, around the outermost one.
    samples = views_of * pixels * channels * itemsize * (2 if views else 1)
    maps = views_of * pixels * _KEPT if held else min(_BAND_BYTES, views_of * pixels * _LEVEL)
    needed = samples + maps + pixels * _AT_ONCE
    if free is not None and needed > free:
        what = f"maps of all {views_of} views" if held else f"{views_of} views, and the maps of a few,"
        other = "write them one by one (estimate_views_to), " if held else ""
        raise LightFieldError(
            f"{name}: {what} need {size_text(needed)}, {size_text(free)} are free; expected enough memory; "
            f"{other}use --crop, --scale or --views, or --force (force=True in Python) to try anyway"
        )


def check_disk(name: str, shape: tuple[int, ...], out: Path) -> None:
    """Raise LightFieldError where what all views need meanwhile, and their maps, do not fit on a disk."""
    v, u, height, width = shape[:4]
    needed = v * u * height * width * _KEPT
    free = shutil.disk_usage(out.resolve().parent).free
    if needed > free:
        raise LightFieldError(
            f"{out}: maps of all {v * u} views of {name} need {size_text(needed)} of disk while they are "
            f"made, {size_text(free)} are free; expected enough room; choose another folder, use --crop, "
            "--scale or --views, or --force (force=True in Python) to try anyway"
        )
