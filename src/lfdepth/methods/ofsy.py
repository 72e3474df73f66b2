"""OFSY: occlusion-aware focal stack symmetry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.labels import cheapest, neighbour_weights
from lfdepth.blocks.smoothing import guide_image
from lfdepth.blocks.variation import smooth_surface
from lfdepth.engines.base import Array, Bool, Engine
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField, reference_index
from lfdepth.methods import labels
from lfdepth.methods.base import Maps, Method, MethodInfo, Problem, Shape, Work
from lfdepth.methods.parameters import Real, Switch, Word

_BAND = 32
"""Rows between two reports of progress."""

_SAMPLE = 0.02
"""Px per view step between two distances at which stacks are compared; labels may be closer."""

_SLOPE, _JUMP, _SHARPNESS = 0.01, 0.1, 20.0
"""Penalties of paths, in mean costs, and how fast they fall with the change of colour."""

_TRUST = 0.1
"""Weight of a pixel of usual sharpness beside the surface's."""


@dataclass(frozen=True, kw_only=True)
class Ofsy(Method):
    """At the surface, a focal stack of the views on one side continues as that of the other side's views.

    Strecke, Alperovich, Goldluecke: Accurate Depth and Normal Maps from Occlusion-Aware Focal Stack Symmetry,
    CVPR 2017, doi:10.1109/CVPR.2017.271. Their joint optimisation of depth and normals is replaced by
    scanline paths and a smooth surface; docs/compared-methods.md says what is ours.
    """

    info: ClassVar = MethodInfo(
        name="ofsy",
        summary="Occlusion-aware focal stack symmetry (Strecke et al., CVPR 2017).",
        reference="doi:10.1109/CVPR.2017.271",
    )

    planes: labels.Labels = 330
    stacks: Annotated[
        Literal["partial", "whole"],
        Word(
            "Focal stacks to compare: those of the views on either side with each other (partial), or that "
            "of all views with itself (whole; Lin et al., ICCV 2015)."
        ),
    ] = "partial"
    sigma: Annotated[
        float,
        Real("Spread of the difference between stacks.", gt=0, le=1, unit="full scale", symbol="σ"),
    ] = 0.05
    reach: Annotated[
        float,
        Real(
            "How far in front of and behind a plane the stacks are compared.",
            gt=0,
            le=10,
            unit="px per view step",
            symbol="δmax",
        ),
    ] = 0.3
    regulariser: labels.Regulariser = "paths"
    surface: Annotated[
        bool, Switch("After the scanline paths, fit a smooth surface (total generalised variation).")
    ] = True
    subplane: labels.Subplane = False

    def check(self, shape: Shape) -> None:
        """There have to be views on two sides."""
        _check_sides(shape, np.ones(shape[:2], np.bool_), "views")

    def memory(self, shape: Shape, planes: NDArray[np.float64], sample_bytes: int) -> int:
        """Views in colour and the volume, or three of it while paths are looked for."""
        volumes = 3 if self.regulariser == "paths" else 1
        return labels.volume_bytes(shape, planes, volumes, sample_bytes=sample_bytes)

    def halo(self) -> int:
        """None beside the views' own; paths carry farther, ever more weakly."""
        return 1

    def run(self, problem: Problem, work: Work) -> Maps:
        """Compare stacks, look for paths, lay a surface."""
        lf, planes, engine, trace = problem.lf, problem.planes, work.engine, work.trace
        bands = range(0, lf.height, _BAND)
        trace.steps(len(bands) + 1)
        step = abs(problem.step)
        reach = max(round(self.reach / step), 1)
        stride = max(round(_SAMPLE / step), 1)
        wider = planes[0] - problem.step * np.arange(-reach, len(planes) + reach)
        stacks, pairs = self._stacks(lf)
        with trace.block("preparation"):
            views = engine.colour_views(lf, float(np.abs(wider).max()), np.asarray(stacks.any(axis=0)))
            volume = engine.empty((len(planes), *problem.size), np.float32)
        for first in bands:
            with trace.block("stacks"):
                rows = first, min(first + _BAND, lf.height)
                rule = (views, wider, stacks, pairs, reach, self.sigma)
                engine.focal_symmetry(*rule, volume, rows=rows, stride=stride)
            trace.step("stacks")
        del views
        trace.take("costs", lambda: engine.download(volume))
        if self.regulariser == "none":
            maps = cheapest(volume, planes, subplane=self.subplane, engine=engine)
        else:
            maps = self._regular(lf, planes, volume, work)
        trace.step("decision")
        return Maps(*maps)

    def _stacks(self, lf: LightField) -> tuple[Bool, NDArray[np.int64]]:
        """Which views (V, U) belong to each stack, and the pairs of stacks to be compared."""
        _check_sides(lf.shape, lf.available, lf.name)
        sides: Bool = np.asarray(_sides(lf.shape) & lf.available)
        if self.stacks == "whole":
            cross: Bool = np.asarray(sides.any(axis=0))
            cross[lf.centre] = True
            return cross[None], np.zeros((1, 2), np.int64)
        pairs = np.array([pair for pair in ((0, 1), (2, 3)) if sides[list(pair)].any(axis=(1, 2)).all()])
        kept = np.unique(pairs)
        return sides[kept], np.searchsorted(kept, pairs)

    def _regular(
        self, lf: LightField, planes: NDArray[np.float64], volume: Array, work: Work
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Map and confidence by paths, and the surface."""
        engine, trace = work.engine, work.trace
        guide = guide_image(lf, "colour")

        def alike(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
            return np.asarray(np.exp(-_SHARPNESS * np.abs(a - b).mean(axis=2)))

        with trace.block("paths"):
            weights = neighbour_weights(guide, alike)
            typical = float(np.mean([engine.download(each).mean() for each in volume]))
            sharpness = _curvature(volume, engine)
            table = np.array([0, _SLOPE * typical, _JUMP * typical], np.float32)
            engine.line_paths(volume, weights, table)
            smooth = self.subplane or self.surface
            disparity, confidence = cheapest(volume, planes, subplane=smooth, engine=engine)
        if self.surface:
            with trace.block("surface"):
                step = np.float32(planes[0] - planes[1])
                usual = max(float(np.median(sharpness)), 1e-9)
                trust = np.minimum(np.float32(_TRUST / usual) * sharpness, 1)
                surface = smooth_surface(disparity / step, trust, weights)
                disparity = np.asarray(surface * step, np.float32)
        return disparity, confidence


def _curvature(volume: Array, engine: Engine) -> NDArray[np.float32]:
    """How fast costs rise (H, W) beside the least one, per label; 0 at the ends of the range."""
    index, (least, before, after, _) = engine.minima(volume)
    inner = (index > 0) & (index < len(volume) - 1)
    return np.where(inner, before + after - 2 * least, np.float32(0))


def _sides(shape: tuple[int, ...]) -> Bool:
    """Views (4, V, U) left, right, above and below the reference view, in its row and column."""
    middle = reference_index((shape[0], shape[1]))
    v, u = np.arange(shape[0])[:, None] - middle[0], np.arange(shape[1]) - middle[1]
    return np.array([(v == 0) & (u < 0), (v == 0) & (u > 0), (u == 0) & (v < 0), (u == 0) & (v > 0)])


def _check_sides(shape: tuple[int, ...], present: Bool, what: str) -> None:
    """Raise LightFieldError unless there are views on opposite sides."""
    left, right, above, below = (bool((side & present).any()) for side in _sides(shape))
    if not ((left and right) or (above and below)):
        raise LightFieldError(
            f"{what}: found {shape[0]}×{shape[1]} views, none on opposite sides of the reference view in its "
            "row or column; expected at least one on either side for ofsy; choose another method"
        )
