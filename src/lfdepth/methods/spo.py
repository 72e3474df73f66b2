"""SPO: the spinning parallelogram operator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.labels import cheapest
from lfdepth.blocks.parallelogram import CROSS, Epi, SideRule, epis, joined_costs, smooth_slices
from lfdepth.blocks.smoothing import GuidedFilter, guide_image
from lfdepth.methods import common, labels
from lfdepth.methods.base import Maps, Method, MethodInfo, Problem, Shape, Work
from lfdepth.methods.parameters import Real, Whole

Alpha = Annotated[
    float,
    Real(
        "Squared distance from the line at which samples of an EPI weigh most.",
        gt=0,
        le=100,
        unit="px²",
        symbol="α",
    ),
]
Bins = Annotated[int, Whole("Histogram bins per channel.", ge=2, le=256)]
Sigma = Annotated[
    float,
    Real("How strongly a direction in which no label stands out is down-weighted.", gt=0, le=100, symbol="σ"),
]


@dataclass(frozen=True, kw_only=True)
class Spo(Method):
    """On the line that a point draws through an EPI the colours on both sides differ most.

    Zhang, Sheng, Li, Zhang, Xiong: Robust depth estimation for light field via spinning parallelogram
    operator, CVIU 145, 2016, doi:10.1016/j.cviu.2015.12.007. Uses the row and the column of views through the
    reference view.
    """

    info: ClassVar = MethodInfo(
        name="spo",
        summary="Spinning parallelogram operator (Zhang et al., CVIU 2016).",
        reference="doi:10.1016/j.cviu.2015.12.007",
    )

    planes: labels.Labels = 256
    alpha: Alpha = 0.8
    bins: Bins = 64
    sigma: Sigma = 0.26
    radius: labels.GuideRadius = 7
    epsilon: labels.GuideEpsilon = 1e-4
    subplane: labels.Subplane = False

    def check(self, shape: Shape) -> None:
        """The filter's windows have to fit the views."""
        common.check_windows(shape, self.radius)

    def memory(self, shape: Shape, planes: NDArray[np.float64], sample_bytes: int) -> int:
        """Two volumes, and a few labels at a time."""
        return labels.volume_bytes(shape, planes, 2, views=shape[0] + shape[1]) + 128 * shape[2] * shape[3]

    def halo(self) -> int:
        """Two windows of the filter, and the samples beside the line."""
        return 2 * self.radius + 5

    def run(self, problem: Problem, work: Work) -> Maps:
        """Compare sides, join rows and columns, smooth, keep the best label."""
        with work.trace.block("preparation"):
            directions = epis(problem.lf, CROSS, self.bins, work.engine)
        return self.compare(problem, work, directions)

    def compare(
        self,
        problem: Problem,
        work: Work,
        directions: Sequence[Epi],
        trust: Sequence[NDArray[np.float32]] | None = None,
    ) -> Maps:
        """Compare the sides in these directions, join them (`joined_costs`), smooth, keep the best label."""
        lf, planes, engine, trace = problem.lf, problem.planes, work.engine, work.trace
        with trace.block("preparation"):
            guide = guide_image(lf, "colour")
            smoothing = GuidedFilter(guide, self.radius, self.epsilon / 255**2, engine=engine)
        trace.steps(len(planes) * (len(directions) + 1))
        rule = SideRule(self.alpha, self.bins, self.sigma)
        costs = joined_costs(directions, planes, rule, trust=trust, engine=engine, trace=trace)
        trace.take("costs", costs)
        volume = smooth_slices(costs, smoothing, engine, trace)
        with trace.block("decoding"):
            return Maps(*cheapest(volume, planes, subplane=self.subplane, engine=engine))
