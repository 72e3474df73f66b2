"""Why a pixel has its disparity: what every block of the default method says there.

The blocks are run again on a window around the pixel, wide enough that the pixel's own profiles are those of
the whole picture; only what neighbours pass on along paths stops at the window's border.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.edge_net import decide_sides
from lfdepth.blocks.edges import DepthEdges, EdgeRule
from lfdepth.blocks.energy import JointEnergy
from lfdepth.blocks.noise import residual, threshold_bounds
from lfdepth.blocks.photo import local_thresholds, thinned
from lfdepth.blocks.refine import refine_map
from lfdepth.blocks.smoothing import GuidedFilter, guide_image
from lfdepth.blocks.sweep import smoothed_votes
from lfdepth.engines import single
from lfdepth.engines.layout import VISIBILITY_MARGIN
from lfdepth.errors import LightFieldError
from lfdepth.io.record import Record, as_record, check_size
from lfdepth.lightfield import LightField, check_range
from lfdepth.methods.fbs_vis import FbsVis
from lfdepth.pictures import span
from lfdepth.probe.brightness import equalise
from lfdepth.trace import Trace

if TYPE_CHECKING:
    from lfdepth.result import Result

Float = NDArray[np.float32]

ABSENT, SEEN, HIDDEN, OUTSIDE = 0, 1, 2, 3
"""What a view says of a pixel: no such view; it shows it; something nearer hides it; outside of the frame."""

_PATHS = 8
"""Px around what a pixel's profiles need, so that paths from the sides have somewhere to come from."""

_GLOSS = 8
"""Px around the pixel where high-passed views are asked."""

_EPI = 32
"""Px on either side of the pixel in its epipolar-plane images."""

_LATER = {
    "refinement": "refinement between planes",
    "faint surfaces": "signs on faint surfaces",
    "edge net": "network at depth edges",
}
"""Blocks after the edges that a method may leave out, and what their stages are called."""

_KEPT = ("smoothed", "sign energies", "shares", "joint energies", "paths", "decisions")


@dataclass(frozen=True)
class Stage:
    """Disparity that one block leaves at the pixel, px per view step."""

    name: str
    disparity: float


@dataclass(frozen=True, eq=False)
class Evidence:
    """What speaks for the disparity of one pixel.

    Profiles are (K,) arrays along the planes, front to back. Grids are (V, U), as the views are.

    Attributes
    ----------
    x, y
        The pixel of the reference view.
    planes
        Disparities of the planes, px per view step.
    signs
        Smoothed votes of the signs in [−1, 1]: positive where the surface is nearer than the plane.
    photo, photo_visible
        Smoothed shares of the views that agree in colour, in [0, 1]: of all that vote, and of those that see
        the pixel by the map.
    sign_energy, energy
        Energy of the signs alone, and of signs and photo votes together; the least is best.
    disparity, sigma, confidence, truth, depth
        The map at the pixel, px per view step, and metres; None where it is not known.
    colours
        (V, U, C) what each view shows of the pixel at its disparity, in the views' own samples; 0 where it
        shows nothing of it.
    states
        For each view `ABSENT`, `SEEN`, `HIDDEN` or `OUTSIDE`, uint8.
    votes, agrees
        Which views take part in the photo votes, and which of all agree with the reference view in colour.
    epi_horizontal, epi_vertical
        (U, n, C) and (V, n, C): epipolar-plane images around the pixel.
    epi_start
        (x, y) of their first pixels.
    stages
        What each block leaves, in the order of the method.
    decided_by
        Name of the stage that decided: the last that moved the disparity by more than half a plane.
    decision
        The same in a sentence.
    glossy
        Whether photo votes of high-passed views took the place of the pixel's own.
    window
        (x, y, width, height) of what was computed again.
    remarks
        What else there is to say, a sentence each.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("bars", size=64, views=5)
    >>> evidence = lfdepth.explain(lf, lf.truth, x=30, y=20)
    >>> bool(abs(evidence.disparity - lf.truth[20, 30]) < 1e-6)
    True
    >>> evidence.states.shape  # which views see the pixel
    (5, 5)
    """

    x: int
    y: int
    planes: NDArray[np.float64]
    signs: Float
    photo: Float
    photo_visible: Float
    sign_energy: Float
    energy: Float
    disparity: float
    sigma: float | None
    confidence: float | None
    truth: float | None
    depth: float | None
    colours: NDArray[Any]
    states: NDArray[np.uint8]
    votes: NDArray[np.bool_]
    agrees: NDArray[np.bool_]
    epi_horizontal: NDArray[Any]
    epi_vertical: NDArray[Any]
    epi_start: tuple[int, int]
    stages: tuple[Stage, ...]
    decided_by: str
    decision: str
    glossy: bool
    window: tuple[int, int, int, int]
    remarks: tuple[str, ...] = field(default=())


def explain(lf: LightField, disparity_map: Result | NDArray[Any], x: int, y: int) -> Evidence:
    """Why a pixel has its disparity.

    Parameters
    ----------
    lf
        Light field.
    disparity_map
        (H, W) disparity of the reference view from any source, or the result of `estimate`. It says which
        views see the pixel.
    x, y
        The pixel.

    Returns
    -------
    Evidence
        Profiles of `fbs-vis`, with the parameters of the result where that is its method.

    Raises
    ------
    LightFieldError
        If the map is not finite or of another size than the views, or the pixel lies outside of them.

    Notes
    -----
    To ask about many pixels, make an `Explainer` once: it measures the noise of the views only then.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("demo", size=64, views=5)
    >>> evidence = lfdepth.explain(lf, lf.truth, x=20, y=25)
    >>> evidence.decision
    "The pixel's own votes: signs and photo votes agree."
    >>> best = evidence.planes[evidence.energy.argmin()]
    >>> bool(abs(best - evidence.truth) < 0.1)
    True
    """
    return Explainer(lf, disparity_map).at(x, y)


class Explainer:
    """Explains pixels of one map of one light field; see `explain`."""

    def __init__(self, lf: LightField, disparity_map: Result | Record | NDArray[Any]) -> None:
        self._record = record = as_record(disparity_map)
        self._map = record.values
        check_size(self._map, lf, "disparity_map")
        own = _own_method(record)
        self._method, self._elsewhere = own or FbsVis(), own is None
        self._range = record.range or lf.disparity_range or span(self._map)
        measured = None if isinstance(disparity_map, Record | np.ndarray) else disparity_map.equalisation
        self._lf = lf if measured is None else equalise(lf, measured)
        self.planes = self._method.planes_for(check_range(self._range))
        self._noise = residual(self._lf, self.planes, engine=single())
        low, high = threshold_bounds(self._noise.noise)
        self._thresholds = local_thresholds(self._lf.reference, low=low, high=high)
        self._reach = int(np.ceil(np.abs(self.planes).max() * np.abs(lf.offsets).max())) + 1

    def at(self, x: int, y: int) -> Evidence:
        """The evidence of pixel (x, y)."""
        lf = self._lf
        if not (0 <= x < lf.width and 0 <= y < lf.height):
            raise LightFieldError(
                f"pixel: found ({x}, {y}), expected x from 0 to {lf.width - 1} and y from 0 to "
                f"{lf.height - 1}; choose one inside the views of {lf.name}"
            )
        window = self._window(x, y)
        column, row = x - window[0], y - window[1]
        blocks = self._run_blocks(window, (row, column))

        def profile(name: str, which: int = 0) -> Float:
            return np.ascontiguousarray(blocks.kept[name][which][:, row, column])

        signs = np.array([each[row, column] for each in blocks.kept["smoothed"]], np.float32)
        disparity = float(self._map[y, x])
        stages = self._stages(blocks, (row, column), disparity)
        step = float(self.planes[0] - self.planes[1])
        decided_by, decision = _decision(stages, step, self._elsewhere)
        colours, states = self._patch(window, (row, column), disparity)
        known = self._record
        truth = None if lf.truth is None else float(lf.truth[y, x])
        return Evidence(
            x=x,
            y=y,
            planes=self.planes,
            signs=signs,
            photo=profile("shares"),
            photo_visible=profile("shares", 1),
            sign_energy=profile("sign energies"),
            energy=profile("joint energies", 1),
            disparity=disparity,
            sigma=None if known.sigma is None else float(known.sigma[y, x]),
            confidence=None if known.confidence is None else float(known.confidence[y, x]),
            truth=truth if truth is not None and np.isfinite(truth) else None,
            depth=None if lf.camera is None else float(lf.camera.disparity_to_depth(disparity)),
            colours=colours,
            states=states,
            votes=thinned(lf.available, sparse=False),
            agrees=self._agrees(colours, states, x, y),
            epi_horizontal=lf.epi_horizontal(y)[:, max(x - _EPI, 0) : x + _EPI + 1],
            epi_vertical=lf.epi_vertical(x)[:, max(y - _EPI, 0) : y + _EPI + 1],
            epi_start=(max(x - _EPI, 0), max(y - _EPI, 0)),
            stages=stages,
            decided_by=decided_by,
            decision=decision,
            glossy=self._method.gloss and not profile("sign energies", 1).any() and bool(signs.any()),
            window=window,
            remarks=self._remarks(stages, step),
        )

    def _window(self, x: int, y: int) -> tuple[int, int, int, int]:
        """What has to be computed again for the pixel: filters, and views that move past each other."""
        around = self._method.halo() + 2 * self._reach + _PATHS
        left, top = max(x - around, 0), max(y - around, 0)
        right, bottom = min(x + around + 1, self._lf.width), min(y + around + 1, self._lf.height)
        return left, top, right - left, bottom - top

    def _piece(self, window: tuple[int, int, int, int], values: Float) -> Float:
        left, top, width, height = window
        return np.ascontiguousarray(values[top : top + height, left : left + width])

    def _run_blocks(self, window: tuple[int, int, int, int], at: tuple[int, int]) -> Trace:
        """The method's blocks in a window; the map says which views see what in the second count."""
        lf, method, engine, trace = self._lf.crop(*window), self._method, single(), Trace(keep=_KEPT)
        guide = guide_image(lf, method.guide)
        energy = JointEnergy(
            lf,
            self.planes,
            GuidedFilter(guide, method.photo_radius, method.epsilon, engine=engine),
            method.joint_rule,
            engine=engine,
            trace=trace,
            noise=self._noise,
        )
        smoothing = GuidedFilter(guide, method.radius, method.epsilon, engine=engine)
        for index, smoothed in smoothed_votes(
            lf,
            self.planes,
            method.vote_rule,
            smoothing,
            normalise=method.normalise,
            engine=engine,
            trace=trace,
        ):
            energy.update(index, smoothed)
        energy.decide()
        for _ in energy.recount(self._piece(window, self._map)):
            pass
        if method.gloss:
            rows, columns = (slice(max(each - _GLOSS, 0), each + _GLOSS + 1) for each in at)
            energy.replace_glossy((rows, columns))
        energy.decide()
        edges = DepthEdges(lf, EdgeRule(passes=method.edge_passes), engine=engine)
        before = trace.kept["decisions"][1]
        surface = edges.decide(before)
        trace.kept["edges"] = [surface]
        rule = method.refine_rule
        if rule is not None:
            surface = refine_map(lf, surface, rule, engine).disparity
            trace.kept["refinement"] = [surface]
            if method.faint:
                signs = refine_map(lf, trace.kept["edges"][0], rule, engine, energy.ask_signs)
                surface = signs.disparity
                trace.kept["faint surfaces"] = [surface]
        if method.edge_net:
            trace.kept["edge net"] = [decide_sides(lf, surface, before, engine=engine)]
        return trace

    def _stages(self, blocks: Trace, at: tuple[int, int], shown: float) -> tuple[Stage, ...]:
        def lowest(name: str, which: int, sign: float = 1.0) -> float:
            return least(self.planes, sign * blocks.kept[name][which][:, *at])

        return (
            Stage("signs alone", lowest("sign energies", 0)),
            Stage("photo votes alone", lowest("shares", 1, -1.0)),
            Stage("energy of both", lowest("joint energies", 1)),
            Stage("paths from the neighbours", float(blocks.kept["paths"][1][at])),
            Stage("planes fitted between planes", float(blocks.kept["decisions"][1][at])),
            Stage("depth edges", float(blocks.kept["edges"][0][at])),
            *(
                Stage(name, float(blocks.kept[kept][0][at]))
                for kept, name in _LATER.items()
                if kept in blocks.kept
            ),
            Stage("the map", shown),
        )

    def _patch(
        self, window: tuple[int, int, int, int], at: tuple[int, int], disparity: float
    ) -> tuple[NDArray[Any], NDArray[np.uint8]]:
        """What each view shows of the pixel, and whether it sees it."""
        lf, surface = self._lf, self._piece(window, self._map)
        x, y = at[1] + window[0], at[0] + window[1]
        colours = np.zeros((*lf.shape[:2], lf.shape[4]), lf.views.dtype)
        states = np.zeros(lf.shape[:2], np.uint8)
        for index in map(tuple, np.argwhere(lf.available).tolist()):
            v, u = lf.offsets[index].tolist()
            down, across = y - v * disparity, x - u * disparity
            if not (0 <= down <= lf.height - 1 and 0 <= across <= lf.width - 1):
                states[index] = OUTSIDE
                continue
            colours[index] = _sample(lf.views[index], down, across)
            front = single().seen(surface, (v, u))
            landing = int(np.floor(at[0] - v * disparity + 0.5)), int(np.floor(at[1] - u * disparity + 0.5))
            inside = 0 <= landing[0] < front.shape[0] and 0 <= landing[1] < front.shape[1]
            hidden = inside and front[landing] > disparity + VISIBILITY_MARGIN
            states[index] = HIDDEN if hidden else SEEN
        return colours, states

    def _agrees(self, colours: NDArray[Any], states: NDArray[np.uint8], x: int, y: int) -> NDArray[np.bool_]:
        """Which views show the reference view's colour, by the pixel's own threshold."""
        lf = self._lf
        threshold = self._thresholds[y, x] * lf.full_scale
        apart = np.abs(colours.astype(np.float64) - lf.reference[y, x]).mean(axis=2)
        return np.asarray((apart < threshold) & ((states == SEEN) | (states == HIDDEN)))

    def _remarks(self, stages: tuple[Stage, ...], step: float) -> tuple[str, ...]:
        before, shown = stages[-2].disparity, stages[-1].disparity
        if abs(shown - before) <= step:
            return ()
        cause = (
            "the map comes from elsewhere"
            if self._elsewhere
            else "neighbours beyond the window decided otherwise"
        )
        return (f"In this window the blocks end at {before:.3f} px, the map says {shown:.3f}: {cause}.",)


def _own_method(record: Record) -> FbsVis | None:
    """The method with the parameters that made a map; None where another made it, or nobody knows."""
    options = dict(json.loads(record.parameters)) if record.parameters else {}
    if options.pop("name", None) != FbsVis.info.name:
        return None
    try:
        return FbsVis(**options)
    except (LightFieldError, TypeError):  # a file of another version
        return None


def least(planes: NDArray[np.float64], costs: NDArray[Any]) -> float:
    """Disparity of the least of costs (K,) along the planes, by a parabola through it and its neighbours."""
    k = int(np.argmin(costs))
    if not 0 < k < len(costs) - 1:
        return float(planes[k])
    before, here, after = (float(costs[k + i]) for i in (-1, 0, 1))
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / bend if bend > 0 else 0.0
    return float(planes[k] - shift * (planes[0] - planes[1]))


def _sample(view: NDArray[Any], y: float, x: float) -> NDArray[Any]:
    """Bilinear sample (C,) of a view at a place inside it."""
    top, left = int(y), int(x)
    bottom, right = int(np.ceil(y)), int(np.ceil(x))
    below, beside = y - top, x - left
    upper = (1 - beside) * view[top, left].astype(np.float64) + beside * view[top, right]
    lower = (1 - beside) * view[bottom, left].astype(np.float64) + beside * view[bottom, right]
    value = (1 - below) * upper + below * lower
    return np.asarray(value if view.dtype == np.float32 else np.rint(value)).astype(view.dtype)


def _decision(stages: tuple[Stage, ...], step: float, elsewhere: bool) -> tuple[str, str]:
    """Which stage brought the disparity to where it is: its name, and a sentence."""
    signs, photo, *chain = stages
    for before, after in zip(chain[-2::-1], chain[:0:-1], strict=True):
        if abs(after.disparity - before.disparity) > step / 2:
            what = "What lies beyond this window"
            what = "Whoever made the map: these blocks end elsewhere" if elsewhere else what
            return after.name, f"{what if after is chain[-1] else after.name.capitalize()}."
    own = chain[0]
    near = [each for each in (signs, photo) if abs(each.disparity - own.disparity) <= step]
    agree = {0: "together", 1: near[0].name if near else "", 2: "signs and photo votes agree"}
    return own.name, f"The pixel's own votes: {agree[len(near)]}."
