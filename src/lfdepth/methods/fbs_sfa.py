"""FBS-SFA: foreground-background separation with sign function approximation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.decode import SignStep
from lfdepth.blocks.smoothing import GuidedFilter, guide_image
from lfdepth.blocks.sweep import smoothed_votes
from lfdepth.blocks.voting import VoteRule
from lfdepth.methods import common
from lfdepth.methods.base import Maps, Method, MethodInfo, Problem, Shape, Work


@dataclass(frozen=True, kw_only=True)
class FbsSfa(Method):
    """As FBS, but a pixel's disparity is where its votes fit one step from "behind" to "in front" best.

    Lee and Park, 2018, as Lee et al., IEEE Access 2021, doi:10.1109/ACCESS.2021.3098819, describe it: their
    reference 28.
    """

    info: ClassVar = MethodInfo(
        name="fbs-sfa",
        summary="FBS with sign function approximation along the planes (Lee and Park, 2018).",
        reference="doi:10.1109/ACCESS.2021.3098819",
    )

    step: common.Step = 0.05
    planes: common.Planes = None
    delta: common.Delta = "photo"
    threshold: common.Threshold = 0.03
    gradient: common.Gradient = "central"
    guide: common.Guide = "colour"
    radius: common.Radius = 4
    epsilon: common.Epsilon = 1e-4
    normalise: common.Normalise = True
    subplane: common.Subplane = True

    def check(self, shape: Shape) -> None:
        """Windows have to fit the views."""
        common.check_windows(shape, self.radius)

    def memory(self, shape: Shape, planes: NDArray[np.float64], sample_bytes: int) -> int:
        """Grey views and a few slices."""
        return common.sweep_bytes(shape, planes)

    def halo(self) -> int:
        """Two windows of the filter."""
        return 2 * self.radius

    def run(self, problem: Problem, work: Work) -> Maps:
        """Vote, smooth, find the step."""
        lf, planes, engine, trace = problem.lf, problem.planes, work.engine, work.trace
        trace.steps(len(planes))
        rule = VoteRule(self.delta, self.threshold, self.gradient)
        with trace.block("preparation"):
            smoothing = GuidedFilter(guide_image(lf, self.guide), self.radius, self.epsilon, engine=engine)
            decoder = SignStep(planes, problem.size, subplane=self.subplane, engine=engine)
        for index, smoothed in smoothed_votes(
            lf, planes, rule, smoothing, normalise=self.normalise, engine=engine, trace=trace
        ):
            with trace.block("decoding"):
                decoder.update(index, smoothed)
            trace.step("plane")
        return Maps(decoder.disparity(), decoder.confidence())
