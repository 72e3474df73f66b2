"""SPO-MO: the spinning parallelogram in four directions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.contours import canny, orientations, spread
from lfdepth.blocks.parallelogram import STAR, Epi, epis
from lfdepth.lightfield import LightField, luma
from lfdepth.methods import labels
from lfdepth.methods.base import Maps, MethodInfo, Problem, Shape, Work
from lfdepth.methods.parameters import Real, Whole
from lfdepth.methods.spo import Spo


@dataclass(frozen=True, kw_only=True)
class SpoMo(Spo):
    """As SPO in rows, columns and both diagonals of views; at an edge, the direction along it counts most.

    Sheng, Zhao, Zhang, Zhang, Yang: Occlusion-aware depth estimation for light field using multi-orientation
    EPIs, Pattern Recognition 74, 2018, doi:10.1016/j.patcog.2017.09.010. How directions are weighed there is
    not known: docs/spo-lf-occ-omg.md says what stands in its place.
    """

    info: ClassVar = MethodInfo(
        name="spo-mo",
        summary="Spinning parallelogram in four directions (Sheng et al., Pattern Recognition 2018).",
        reference="doi:10.1016/j.patcog.2017.09.010",
    )

    edge_radius: Annotated[
        int, Whole("Distance from an edge within which its direction counts.", ge=0, le=100, unit="px")
    ] = 3
    edge_spread: Annotated[
        float, Real("Spread of a direction's weight, over the sine of its angle to the edge.", gt=0, le=100)
    ] = 0.3

    def memory(self, shape: Shape, planes: NDArray[np.float64], sample_bytes: int) -> int:
        """Two volumes, and a few labels at a time."""
        views = 2 * (shape[0] + shape[1])
        return labels.volume_bytes(shape, planes, 2, views=views) + 128 * shape[2] * shape[3]

    def halo(self) -> int:
        """Two windows of the filter, the samples beside the line, edges and what decides their angle."""
        return super().halo() + self.edge_radius + 8

    def run(self, problem: Problem, work: Work) -> Maps:
        """Compare sides, join the directions, smooth, keep the best label."""
        with work.trace.block("preparation"):
            directions = epis(problem.lf, STAR, self.bins, work.engine)
            trust = self._trust(problem.lf, directions)
        return self.compare(problem, work, directions, trust)

    def _trust(self, lf: LightField, directions: Sequence[Epi]) -> list[NDArray[np.float32]]:
        """How much each direction counts: as much as any away from edges, near them as it runs along them."""
        angles = spread(orientations(canny(luma(lf.reference))), self.edge_radius)
        found = []
        for epi in directions:
            down, across = epi.walk
            askew = np.sin(angles - math.atan2(-down, across))
            along = np.exp(-(askew**2) / (2 * self.edge_spread**2))
            found.append(np.nan_to_num(along, nan=1.0).astype(np.float32))
        return found
