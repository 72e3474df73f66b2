"""LF_OCC: views on one side of an edge see past the occluder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks import occluders
from lfdepth.blocks.contours import colour_edges, orientations, spread_largest
from lfdepth.blocks.smoothing import guide_image
from lfdepth.methods import common, labels
from lfdepth.methods.base import Maps, Method, MethodInfo, Problem, Shape, Work
from lfdepth.methods.parameters import Real, Whole

EdgeRadius = Annotated[
    int, Whole("Distance from an edge within which views are selected.", ge=0, le=100, unit="px")
]
Window = Annotated[
    int, Whole("Radius of the bilateral filter that smooths the costs.", ge=1, le=20, unit="px")
]
SigmaColour = Annotated[
    float, Real("Spread of the bilateral filter in colour.", gt=0, le=10, unit="full scale", symbol="σ")
]


@dataclass(frozen=True, kw_only=True)
class TwoGroups(Method):
    """What methods share that split the views of each pixel into two groups, for an occluder spares one."""

    edge_radius: EdgeRadius = 4
    window: Window = 2
    sigma_colour: SigmaColour = 0.01
    regulariser: labels.Regulariser = "paths"
    subplane: labels.Subplane = False

    def check(self, shape: Shape) -> None:
        """The filter's windows have to fit the views."""
        common.check_windows(shape, self.window)

    def memory(self, shape: Shape, planes: NDArray[np.float64], sample_bytes: int) -> int:
        """Views in colour, two groups of them, and one volume, or three where paths are followed."""
        v, u, height, width, _ = shape
        count = 3 if self.regulariser == "paths" else 1
        return (
            labels.volume_bytes(shape, planes, count, sample_bytes=sample_bytes) + 2 * v * u * height * width
        )

    def halo(self) -> int:
        """The filter's window, edges and what decides their angle; paths carry farther."""
        return self.window + self.edge_radius + 8

    def decide(
        self,
        problem: Problem,
        work: Work,
        groups: occluders.Groups,
        choose: occluders.Choose,
        occlusions: Callable[[occluders.Winners], NDArray[np.bool_]],
    ) -> Maps:
        """Find the cheapest labels, and unless told otherwise look for occlusions there and regularise."""
        lf, planes, engine, trace = problem.lf, problem.planes, work.engine, work.trace
        winners = occluders.find_winners(
            lf,
            planes,
            groups,
            choose,
            window=self.window,
            sigma_colour=self.sigma_colour,
            subplane=self.subplane,
            engine=engine,
            trace=trace,
        )
        if self.regulariser == "none":
            return Maps(winners.disparity, winners.confidence)
        with trace.block("paths"):
            disparity = occluders.regularise(
                lf, winners, occlusions(winners), planes, subplane=self.subplane, engine=engine
            )
        trace.step("paths")
        return Maps(disparity, winners.confidence)


@dataclass(frozen=True, kw_only=True)
class LfOcc(TwoGroups):
    """At edges of the picture the views fall into two halves, of which an occluder leaves one as it is.

    Wang, Efros, Ramamoorthi: Occlusion-aware depth estimation using light-field cameras, ICCV 2015; Depth
    estimation with occlusion modeling using light-field cameras, TPAMI 38(11), 2016,
    doi:10.1109/TPAMI.2016.2515615.
    """

    info: ClassVar = MethodInfo(
        name="lf-occ",
        summary="Occlusion-aware by halves of the views (Wang et al., TPAMI 2016).",
        reference="doi:10.1109/TPAMI.2016.2515615",
    )

    planes: labels.Labels = 256

    def run(self, problem: Problem, work: Work) -> Maps:
        """Split the views at edges, find the cheapest labels, look for occlusions, regularise."""
        lf, trace = problem.lf, work.trace
        trace.steps(len(problem.planes) + (self.regulariser == "paths"))
        with trace.block("edges"):
            picture = guide_image(lf, "colour")
            edges = colour_edges(picture)
            angles = spread_largest(orientations(edges), self.edge_radius)
            groups = occluders.halves(lf, angles)
            choose = occluders.choose_half(occluders.side_contrast(lf, angles), picture)
        return self.decide(
            problem,
            work,
            groups,
            choose,
            lambda winners: occluders.occlusion_chains(winners, ~np.isnan(angles), edges),
        )
