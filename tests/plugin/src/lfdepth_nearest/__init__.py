"""A method for lfdepth: the plane on which most views agree with the reference view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from lfdepth.blocks.photo import local_thresholds
from lfdepth.blocks.smoothing import GuidedFilter, check_window, guide_image
from lfdepth.methods import Maps, Method, MethodInfo, Problem, Real, Shape, Whole, Work


@dataclass(frozen=True, kw_only=True)
class Nearest(Method):
    """Count on every plane the views that show the reference view's colour; the fullest plane wins."""

    info: ClassVar = MethodInfo(
        name="nearest",
        summary="The plane on which most views agree in colour (an example).",
        reference="docs/write-a-method.md",
    )

    step: Annotated[
        float,
        Real("Distance between planes.", gt=0, unit="px per view step", symbol="d_step"),
    ] = 0.1
    radius: Annotated[int, Whole("Radius of the guided filter.", ge=1, le=100, unit="px")] = 3

    def check(self, shape: Shape) -> None:
        """The filter's windows have to fit the views."""
        check_window(self.radius, (shape[2], shape[3]))

    def halo(self) -> int:
        """Two windows of the filter."""
        return 2 * self.radius

    def run(self, problem: Problem, work: Work) -> Maps:
        """Count, smooth, keep the best."""
        lf, planes, engine, trace = problem.lf, problem.planes, work.engine, work.trace
        trace.steps(len(planes))
        with trace.block("preparation"):
            views = engine.colour_views(lf, float(np.abs(planes).max()))
            thresholds = engine.upload(local_thresholds(lf.reference))
            smoothing = GuidedFilter(guide_image(lf, "colour"), self.radius, 1e-4, engine=engine)
            share, smoothed = (engine.empty(problem.size, np.float32) for _ in range(2))
        best = np.full(problem.size, -np.inf, np.float32)
        disparity = np.zeros(problem.size, np.float32)
        for plane in planes:
            with trace.block("voting"):
                engine.photo(views, float(plane), thresholds, share)
            with trace.block("smoothing"):
                smoothing.smooth(share, smoothed)
            found = engine.download(smoothed)
            better = found > best
            best[better], disparity[better] = found[better], plane
            trace.take("shares", found)
            trace.step("plane")
        return Maps(disparity, np.clip(best, 0, 1))
