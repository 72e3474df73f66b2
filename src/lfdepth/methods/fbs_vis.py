"""FBS-VIS, the default: signs and photo-consistency in one energy, with exact visibility."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.edge_net import decide_sides, mixed_deviations, straightest
from lfdepth.blocks.edges import DepthEdges, EdgeRule
from lfdepth.blocks.energy import JointEnergy, JointRule
from lfdepth.blocks.refine import RefineRule, refine_map
from lfdepth.blocks.smoothing import GuidedFilter, guide_image
from lfdepth.blocks.sweep import smoothed_votes
from lfdepth.blocks.voting import VoteRule
from lfdepth.methods import common
from lfdepth.methods.base import Maps, Measured, Method, MethodInfo, Problem, Shape, Work
from lfdepth.methods.parameters import Real, Switch, Whole, Word

_ROUNDS = {"fast": 0, "normal": 1, "best": 2}
"""Rounds of refinement by effort."""


@dataclass(frozen=True, eq=False)
class _Refined:
    """Maps but for the edge net; the map (H, W) before edges were decided; and `Measured.typical`."""

    maps: Maps
    before: NDArray[np.float32]
    typical: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class FbsVis(Method):
    """Signs say where a surface is between planes, shares of views that agree in colour say at which.

    Both go into one energy, smoothed along scanlines. A first map says which views see each pixel; its depth
    edges are decided by what those views show, and the shares are counted again in them alone.
    docs/fbs-vis.md explains every block.
    """

    info: ClassVar = MethodInfo(
        name="fbs-vis",
        summary="Signs and photo-consistency in one energy, with exact visibility (the default).",
        reference="docs/fbs-vis.md",
    )

    step: common.Step = 0.07
    planes: common.Planes = None
    delta: common.Delta = "photo"
    threshold: common.Threshold = 0.03
    gradient: common.Gradient = "central"
    guide: common.Guide = "colour"
    radius: common.Radius = 3
    photo_radius: Annotated[
        int, Whole("Radius of the guided filter that smooths the photo votes.", ge=1, le=1000, unit="px")
    ] = 2
    epsilon: common.Epsilon = 2e-6
    normalise: common.Normalise = True
    photo_weight: Annotated[
        float,
        Real("Weight of the photo votes.", ge=0, le=100, unit="px per view step", symbol="λ"),
    ] = 1.0
    slope_penalty: Annotated[
        float, Real("Cost of a change by one plane between neighbouring pixels.", ge=0, le=100, symbol="P1")
    ] = 0.3
    jump_penalty: Annotated[
        float, Real("Cost of any larger change between neighbouring pixels.", ge=0, le=2, symbol="P2")
    ] = 2.0
    fit_radius: Annotated[
        int,
        Whole(
            "Radius of the surface planes fitted to place disparities between sweep planes; 0: no fit.",
            ge=0,
            le=50,
            even=True,
            unit="px",
        ),
    ] = 8
    visibility: Annotated[
        bool,
        Switch(
            "Take the photo votes a second time, only in the views that see each pixel, and decide depth "
            "edges; off keeps the first map, from all views."
        ),
    ] = True
    gloss: Annotated[
        bool, Switch("Where highlights move over a surface, use high-pass filtered views instead.")
    ] = True
    faint: Annotated[
        bool,
        Switch("Where colours say little, let the signs have a say in the refinement, too."),
    ] = True
    edge_passes: Annotated[
        int, Whole("Passes over the depth edges; each moves them by at most one pixel.", ge=0, le=100)
    ] = 3
    edge_net: Annotated[
        bool,
        Switch("Let a small network decide, last of all, to which surface pixels beside depth edges belong."),
    ] = True
    effort: Annotated[
        Literal["fast", "normal", "best"],
        Word("Speed against precision: fast skips the refinement between planes, best refines twice."),
    ] = "normal"

    def check(self, shape: Shape) -> None:
        """Windows have to fit the views."""
        common.check_windows(shape, self.radius, self.photo_radius)

    def memory(self, shape: Shape, planes: NDArray[np.float64], sample_bytes: int) -> int:
        """Half of the views in colour, grey views, surfaces, splines, and 9 bytes per plane and pixel."""
        v, u, height, width, channels = shape
        padded = width + 31 + 2 * (min(float(np.abs(planes).max()) * (u // 2), width) + 3)
        held = min(v * u, max(v * u // 2 + 9, 25))
        colours = held * height * padded * channels * min(sample_bytes, 2)
        surfaces = 2 * v * u * height * padded
        splines = 4 * 0.75 * v * u * height * width if _ROUNDS[self.effort] else 0
        volumes = 9 * len(planes) * height * width
        return int(colours + surfaces + splines + volumes + common.sweep_bytes(shape, planes))

    def halo(self) -> int:
        """Two windows of the filters, and a fit; paths carry farther, ever more weakly."""
        return max(2 * self.radius, 2 * self.photo_radius, self.fit_radius + 1)

    def run(self, problem: Problem, work: Work) -> Maps:
        """A first map, its visibility and edges, the second count, gloss, and the map."""
        planes, refines = len(problem.planes), self.refine_rule is not None
        work.trace.steps(planes + 1 + self.visibility * (planes + self.gloss + refines + self.edge_net + 2))
        found = self._refined(problem, work)
        if not (self.visibility and self.edge_net):
            return found.maps
        with work.trace.block("edges"):
            exponent = problem.measured.exponent if problem.measured else None
            disparity = decide_sides(
                problem.lf, found.maps.disparity, found.before, exponent=exponent, engine=work.engine
            )
        work.trace.step("edge net")
        return replace(found.maps, disparity=disparity)

    def measure(self, samples: Iterable[Problem], work: Work) -> Measured | None:
        """Whether mixed pixels lie straighter in light, and views' typical difference, of all samples."""
        if not self.visibility:
            return None
        mixed, typical = [], []
        for sample in samples:
            found = self._refined(sample, work)
            mixed.append(mixed_deviations(sample.lf, found.maps.disparity, engine=work.engine))
            typical.append(found.typical)
        return Measured(straightest(mixed), tuple(np.median(typical, axis=0).tolist()))

    def _refined(self, problem: Problem, work: Work) -> _Refined:
        """All but the edge net."""
        lf, planes, engine, trace = problem.lf, problem.planes, work.engine, work.trace
        rule, typical = self.vote_rule, tuple[float, ...]()
        with trace.block("preparation"):
            guide = guide_image(lf, self.guide)
            smoothing = GuidedFilter(guide, self.radius, self.epsilon, engine=engine)
            energy = self._energy(problem, guide, work)
            edges = DepthEdges(lf, EdgeRule(passes=self.edge_passes), engine=engine, trace=trace)

        for index, smoothed in smoothed_votes(
            lf, planes, rule, smoothing, normalise=self.normalise, engine=engine, trace=trace
        ):
            energy.update(index, smoothed)
            trace.step("plane")
        disparity, confidence = energy.decide()
        if not self.visibility:
            trace.step("decision")
            return _Refined(Maps(disparity, confidence), disparity)
        with trace.block("edges"):
            # One pass will do for a map that only says which views see what.
            first = edges.decide(disparity, passes=1)
        trace.take("first map", lambda: first)
        trace.step("first map")

        for _ in energy.recount(first):
            trace.step("second count")
        if self.gloss:
            with trace.block("gloss"):
                energy.replace_glossy()
            trace.step("gloss")
        before, confidence = energy.decide()
        trace.step("decision")
        with trace.block("edges"):
            disparity, sigma = edges.decide(before), None
            confidence = edges.lower_confidence(confidence, disparity)
        trace.take("edges", disparity)
        trace.step("edges")
        if (refining := self.refine_rule) is not None:
            with trace.block("refinement"):
                second = energy.ask_signs if self.faint else None
                known = problem.measured.typical if problem.measured else ()
                refined = refine_map(lf, disparity, refining, engine, second, known)
                disparity, sigma, typical = refined.disparity, refined.sigma, refined.typical
            trace.take("refined", disparity)
            trace.step("refinement")
        return _Refined(Maps(disparity, confidence, sigma, energy.standing_out), before, typical)

    def _energy(self, problem: Problem, guide: NDArray[np.float32], work: Work) -> JointEnergy:
        """The energy, on every second plane until the first map, where there is a second count."""
        smoothing = GuidedFilter(guide, self.photo_radius, self.epsilon, engine=work.engine)
        stride = 2 if self.visibility else 1
        return JointEnergy(
            problem.lf,
            problem.planes,
            smoothing,
            self.joint_rule,
            stride=stride,
            engine=work.engine,
            trace=work.trace,
            noise=problem.noise,
            borders=problem.borders,
        )

    @property
    def refine_rule(self) -> RefineRule | None:
        """Rounds of the refinement; None if there is none."""
        rounds = _ROUNDS[self.effort]
        return RefineRule(rounds=rounds) if rounds else None

    @property
    def joint_rule(self) -> JointRule:
        """Weights of the energy."""
        return JointRule(
            photo_weight=self.photo_weight,
            slope_penalty=self.slope_penalty,
            jump_penalty=self.jump_penalty,
            fit_radius=self.fit_radius,
        )

    @property
    def vote_rule(self) -> VoteRule:
        """Which votes of the signs count."""
        return VoteRule(self.delta, self.threshold, self.gradient)
