"""FBSOCC-SFA: occlusion handling by successively excluding foregrounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.decode import SignStep
from lfdepth.blocks.occlusion import SkipMask
from lfdepth.blocks.smoothing import GuidedFilter, guide_image
from lfdepth.blocks.sweep import smoothed_votes
from lfdepth.blocks.voting import VoteRule
from lfdepth.methods import common
from lfdepth.methods.base import Maps, Method, MethodInfo, Problem, Shape, Work


@dataclass(frozen=True, kw_only=True)
class FbsoccSfa(Method):
    """As FBS-SFA, but a pixel behind an occluder is voted on by the views that do not see the occluder.

    Which views those are, the foreground found J planes in front says, carried to the plane at hand. Lee et
    al., IEEE Access 2021, doi:10.1109/ACCESS.2021.3098819: algorithms 1 and 2.
    """

    info: ClassVar = MethodInfo(
        name="fbsocc-sfa",
        summary="FBS-SFA that excludes the foreground found J planes in front (IEEE Access, 2021).",
        reference="doi:10.1109/ACCESS.2021.3098819",
    )

    step: common.Step = 0.05
    planes: common.Planes = None
    skip: common.Skip = 5
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
        """Grey views, a few slices, and the masks of J planes."""
        return common.sweep_bytes(shape, planes) + self.skip * shape[2] * shape[3]

    def halo(self) -> int:
        """Two windows of the filter."""
        return 2 * self.radius

    def run(self, problem: Problem, work: Work) -> Maps:
        """Vote in the views that see past the foreground, smooth, find the step."""
        lf, planes, engine, trace = problem.lf, problem.planes, work.engine, work.trace
        trace.steps(len(planes))
        rule = VoteRule(self.delta, self.threshold, self.gradient)
        with trace.block("preparation"):
            smoothing = GuidedFilter(guide_image(lf, self.guide), self.radius, self.epsilon, engine=engine)
            occlusion = SkipMask(self.skip, problem.step, engine=engine)
            decoder = SignStep(planes, problem.size, subplane=self.subplane, engine=engine)
        for index, smoothed in smoothed_votes(
            lf,
            planes,
            rule,
            smoothing,
            normalise=self.normalise,
            engine=engine,
            trace=trace,
            occlusion=occlusion,
        ):
            with trace.block("decoding"):
                decoder.update(index, smoothed)
            trace.step("plane")
        return Maps(decoder.disparity(), decoder.confidence())
