"""OAVC: the occlusion-aware vote cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.bilateral import bilateral_weights
from lfdepth.blocks.costs import drift_thresholds
from lfdepth.blocks.labels import cheapest
from lfdepth.blocks.median import weighted_median
from lfdepth.blocks.smoothing import guide_image
from lfdepth.methods import common, labels
from lfdepth.methods.base import Maps, Method, MethodInfo, Problem, Shape, Work
from lfdepth.methods.parameters import Real, Whole

_EVERYWHERE = 1e6
"""Spread in px of a filter that does not look at distance."""


@dataclass(frozen=True, kw_only=True)
class Oavc(Method):
    """On every plane views vote that show nearly the reference view's colour; those that do not cost 1.

    Han, Xiang, Yue, Shi: A Novel Occlusion-Aware Vote Cost for Light Field Depth Estimation, TPAMI 2022,
    doi:10.1109/TPAMI.2021.3105523.
    """

    info: ClassVar = MethodInfo(
        name="oavc",
        summary="Occlusion-aware vote cost (Han et al., TPAMI 2022).",
        reference="doi:10.1109/TPAMI.2021.3105523",
    )

    planes: labels.Labels = 101
    misplaced: Annotated[
        float,
        Real(
            "A view's threshold is the change in the reference view when shifted by this times the view's "
            "offset.",
            gt=0,
            le=10,
            unit="px per view step",
        ),
    ] = 0.1
    least_threshold: Annotated[
        float, Real("Lower bound of the threshold.", gt=0, le=1, unit="full scale")
    ] = 0.002
    largest_threshold: Annotated[
        float, Real("Upper bound of the threshold.", gt=0, le=1, unit="full scale")
    ] = 0.005
    radius: Annotated[
        int, Whole("Radius of the bilateral filter that smooths the costs.", ge=1, le=20, unit="px")
    ] = 3
    sigma_colour: Annotated[
        float, Real("Spread of the bilateral filter in colour.", gt=0, unit="full scale")
    ] = 0.1
    sigma_space: Annotated[float, Real("Spread of the bilateral filter in distance.", gt=0, unit="px")] = 3.0
    median_radius: Annotated[int, Whole("Radius of the first weighted median.", ge=1, le=15, unit="px")] = 5
    second_radius: Annotated[int, Whole("Radius of the second weighted median.", ge=1, le=15, unit="px")] = 3
    median_sigma: Annotated[
        float, Real("Spread of the weighted medians in colour.", gt=0, unit="8-bit levels", symbol="σ")
    ] = 25.5
    subplane: labels.Subplane = False

    def planes_for(self, searched: tuple[float, float], *, force: bool = False) -> NDArray[np.float64]:
        """Labels over ±max|D|."""
        return super().planes_for(labels.symmetric(searched), force=force)

    def check(self, shape: Shape) -> None:
        """The filter's windows have to fit the views."""
        common.check_windows(shape, self.radius)

    def memory(self, shape: Shape, planes: NDArray[np.float64], sample_bytes: int) -> int:
        """Views in colour, the volume before and after the filter, and the filter's weights."""
        weights = 4 * (2 * self.radius + 1) ** 2 * shape[2] * shape[3]
        return labels.volume_bytes(shape, planes, 2, sample_bytes=sample_bytes) + weights

    def halo(self) -> int:
        """The filter's window and the medians'."""
        return self.radius + self.median_radius + self.second_radius

    def run(self, problem: Problem, work: Work) -> Maps:
        """Vote, smooth, keep the cheapest label, clean up."""
        lf, planes, engine, trace = problem.lf, problem.planes, work.engine, work.trace
        trace.steps(len(planes) + 2)
        shape = len(planes), *problem.size
        with trace.block("preparation"):
            views = engine.colour_views(lf, float(np.abs(planes).max()))
            low, high = sorted((self.least_threshold, self.largest_threshold))
            thresholds = drift_thresholds(lf, self.misplaced, low, high, engine=engine)
            volume = engine.empty(shape, np.float32)
        for index, plane in enumerate(planes):
            with trace.block("voting"):
                engine.differences(views, float(plane), thresholds, volume[index], beyond=1.0)
            trace.step("plane")
        del views
        trace.take("costs", lambda: engine.download(volume))
        with trace.block("smoothing"):
            guide = guide_image(lf, "colour")
            smoothed = engine.empty(shape, np.float32)
            weights = bilateral_weights(
                guide,
                self.radius,
                sigma_colour=self.sigma_colour,
                sigma_space=self.sigma_space,
                colours="sum",
                window="disc",
            )
            engine.local_means(volume, *weights, smoothed)
        trace.step("smoothing")
        with trace.block("decoding"):
            disparity, confidence = cheapest(smoothed, planes, subplane=self.subplane, engine=engine)
            trace.take("winners", lambda: disparity)
        with trace.block("median"):
            for radius in (self.median_radius, self.second_radius):
                disparity = weighted_median(
                    disparity,
                    guide,
                    radius=radius,
                    sigma_colour=self.median_sigma / 255,
                    sigma_space=_EVERYWHERE,
                    engine=engine,
                )
        trace.step("median")
        return Maps(disparity, confidence)
