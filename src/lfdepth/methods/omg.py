"""OMG: views that an occluder of any shape leaves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks import occluders
from lfdepth.blocks.contours import canny
from lfdepth.lightfield import luma
from lfdepth.methods import labels
from lfdepth.methods.base import Maps, MethodInfo, Problem, Shape, Work
from lfdepth.methods.lf_occ import TwoGroups
from lfdepth.methods.parameters import Real, Whole

_ROUNDS = 10
"""Rounds of k-means at most."""


@dataclass(frozen=True, kw_only=True)
class Omg(TwoGroups):
    """What is occluded near an edge, and from which views, the picture around the pixel says.

    Zhu, Wang, Yu: Occlusion-model guided antiocclusion depth estimation in light field, IEEE JSTSP 11(7),
    2017, doi:10.1109/JSTSP.2017.2730818. Much of it is not known: docs/spo-lf-occ-omg.md says what
    stands in its place.
    """

    info: ClassVar = MethodInfo(
        name="omg",
        summary="Occlusion-model guided, several occluders (Zhu et al., JSTSP 2017).",
        reference="doi:10.1109/JSTSP.2017.2730818",
    )

    planes: labels.Labels = 100
    clusters: Annotated[int, Whole("Number of colour clusters around a pixel.", ge=2, le=10, symbol="k")] = 5
    alike: Annotated[
        float,
        Real("Clusters closer in colour than this are merged.", ge=0, le=2, unit="full scale"),
    ] = 0.05
    patch_scale: Annotated[
        float,
        Real(
            "Largest disparity jump for which the right views are chosen: this many px around a pixel "
            "correspond to one view step.",
            gt=0,
            le=10,
            unit="px per view step",
        ),
    ] = 2.0
    doubt: Annotated[
        float,
        Real(
            "How much lower the chosen views' cost must be than that of all views.",
            ge=0,
            le=1,
            unit="full scale",
        ),
    ] = 0.02
    occluded: Annotated[
        float,
        Real(
            "A pixel is occluded if the variance of all views exceeds that of the chosen ones by this "
            "factor.",
            gt=1,
        ),
    ] = 2.0

    def memory(self, shape: Shape, planes: NDArray[np.float64], sample_bytes: int) -> int:
        """Views in colour, two groups of them, the patches, and a volume, or three."""
        patches = shape[2] * shape[3] * int(self.patch_scale * max(shape[:2]) + 2) ** 2
        return patches + super().memory(shape, planes, sample_bytes)

    def halo(self) -> int:
        """The filter's window, the patch of a grid of 9×9 views, and edges; paths carry farther."""
        return super().halo() + math.ceil(4 * self.patch_scale)

    def run(self, problem: Problem, work: Work) -> Maps:
        """Choose views near edges, find the cheapest labels, look for occlusions, regularise."""
        lf, engine, trace = problem.lf, work.engine, work.trace
        trace.steps(len(problem.planes) + (self.regulariser == "paths"))
        with trace.block("edges"):
            candidates = _dilated(canny(luma(lf.reference)), self.edge_radius)
            groups = occluders.consistent_groups(
                lf,
                candidates,
                clusters=self.clusters,
                alike=self.alike,
                rounds=_ROUNDS,
                scale=self.patch_scale,
                engine=engine,
            )

        def occlusions(winners: occluders.Winners) -> NDArray[np.bool_]:
            chosen, everyone = winners.spreads**2
            return np.asarray(candidates & (everyone > self.occluded * chosen))

        return self.decide(problem, work, groups, occluders.choose_first(self.doubt), occlusions)


def _dilated(mask: NDArray[np.bool_], radius: int) -> NDArray[np.bool_]:
    """A mask, and what lies within a radius of it."""
    from scipy import ndimage

    if radius == 0 or not mask.any():
        return mask
    return np.asarray(ndimage.distance_transform_edt(~mask) <= radius)
