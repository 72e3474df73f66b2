"""CAE: constrained angular entropy, or constrained adaptive defocus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.defocus import Defocus
from lfdepth.blocks.labels import cheapest, neighbour_weights, truncated_linear
from lfdepth.blocks.smoothing import GuidedFilter, guide_image
from lfdepth.engines.base import Array, Engine
from lfdepth.methods import common, labels
from lfdepth.methods.base import Maps, Method, MethodInfo, Problem, Shape, Work
from lfdepth.methods.parameters import Real, Whole, Word

_STEPS = 225
"""Steps in which costs and colour distances are counted."""

_DATA = np.float32(5)
"""Weight of a step of the cost."""

_NEAR = 0.005
"""Weight between neighbours for each step that their colours are closer than the two farthest."""

_LITTLE = np.float32(1e-6)
"""A range of costs or colours is at least so wide."""


@dataclass(frozen=True, kw_only=True)
class Cae(Method):
    """Where a plane holds the surface, the views show few levels near the reference view's: low entropy.

    Williem, Park, Lee: Robust Light Field Depth Estimation Using Occlusion-Noise Aware Data Costs, PAMI
    40(10), 2018, doi:10.1109/TPAMI.2017.2746858.
    """

    info: ClassVar = MethodInfo(
        name="cae",
        summary="Constrained angular entropy (Williem et al., PAMI 2018).",
        reference="doi:10.1109/TPAMI.2017.2746858",
    )

    planes: labels.Labels = 75
    cost: Annotated[
        Literal["entropy", "defocus"],
        Word(
            "Cost of a label: constrained angular entropy, or the paper's other one, constrained adaptive "
            "defocus."
        ),
    ] = "entropy"
    sigma: Annotated[
        float,
        Real(
            "Spread of the weight that a level gets by its distance to the reference view's level.",
            gt=0,
            le=20,
            unit="8-bit levels",
            symbol="σ",
        ),
    ] = 10.0
    radius: labels.GuideRadius = 15
    epsilon: labels.GuideEpsilon = 1e-4
    regulariser: labels.Regulariser = "paths"
    smoothness: Annotated[
        float, Real("Cost of a change by one label between neighbours of the same colour.", ge=0, le=100)
    ] = 2.0
    cut: Annotated[
        int, Whole("Largest change that is charged; larger ones cost the same.", ge=1, le=1000, unit="labels")
    ] = 10
    subplane: labels.Subplane = False

    def planes_for(self, searched: tuple[float, float], *, force: bool = False) -> NDArray[np.float64]:
        """Labels over ±max|D|."""
        return super().planes_for(labels.symmetric(searched), force=force)

    def check(self, shape: Shape) -> None:
        """The filter's windows have to fit the views."""
        common.check_windows(shape, self.radius)

    def memory(self, shape: Shape, planes: NDArray[np.float64], sample_bytes: int) -> int:
        """Views in colour and the volume, or three of it while paths are looked for."""
        return labels.volume_bytes(shape, planes, 3, sample_bytes=sample_bytes)

    def halo(self) -> int:
        """Two windows of the filter; paths carry farther, ever more weakly."""
        return 2 * self.radius

    def run(self, problem: Problem, work: Work) -> Maps:
        """Entropies, smoothed, and the labels of least energy."""
        lf, planes, engine, trace = problem.lf, problem.planes, work.engine, work.trace
        trace.steps(2 * len(planes) + 1)
        volume = engine.empty((len(planes), *problem.size), np.float32)
        if self.cost == "entropy":
            self._entropies(volume, problem, work)
        else:
            _defocus(volume, problem, work)
        trace.take("costs", lambda: engine.download(volume))
        guide = guide_image(lf, "colour")
        with trace.block("smoothing"):
            low, high = _extremes(volume, engine)
            smoothing = GuidedFilter(guide, self.radius, self.epsilon / 255**2, engine=engine)
        for index in range(len(planes)):
            with trace.block("smoothing"):
                found = engine.download(volume[index])
                scaled = engine.upload((found - low) / max(high - low, _LITTLE))
                smoothing.smooth(scaled, volume[index])
            trace.step("smoothing")
        if self.regulariser == "paths":
            with trace.block("paths"):
                volume = self._paths(volume, guide, engine)
        with trace.block("decoding"):
            disparity, confidence = cheapest(volume, planes, subplane=self.subplane, engine=engine)
        trace.step("decision")
        return Maps(disparity, confidence)

    def _entropies(self, volume: Array, problem: Problem, work: Work) -> None:
        """Costs of all labels by constrained angular entropy."""
        with work.trace.block("preparation"):
            views = work.engine.colour_views(problem.lf, float(np.abs(problem.planes).max()))
        for index, plane in enumerate(problem.planes):
            with work.trace.block("entropy"):
                work.engine.angular_entropy(views, float(plane), self.sigma, volume[index])
            work.trace.step("plane")

    def _paths(self, volume: Array, guide: NDArray[np.float32], engine: Engine) -> Array:
        """Energies summed over scanline paths."""
        low, high = _extremes(volume, engine)
        counted = engine.empty(volume.shape, np.float32)
        for index in range(len(volume)):
            counted[index] = engine.upload(_DATA * _steps(engine.download(volume[index]) - low, high - low))

        def apart(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
            return np.asarray(np.sqrt(((a - b) ** 2).sum(axis=2)))

        distances = neighbour_weights(guide, apart)
        steps = np.stack([_steps(each, each.max()) for each in distances])
        weights = np.float32(_NEAR) * (np.float32(_STEPS) - steps)
        engine.line_paths(counted, weights, truncated_linear(self.smoothness, self.cut))
        return counted


def _defocus(volume: Array, problem: Problem, work: Work) -> None:
    """Costs of all labels by constrained adaptive defocus."""
    defocus = Defocus(problem.lf, work.engine)
    for index, plane in enumerate(problem.planes):
        with work.trace.block("defocus"):
            volume[index] = work.engine.upload(defocus.mean(float(plane)))
        work.trace.step("plane")
    with work.trace.block("defocus"):
        defocus.lend(volume)


def _extremes(volume: Array, engine: Engine) -> tuple[np.float32, np.float32]:
    """Least and largest cost of all."""
    slices = [engine.download(volume[index]) for index in range(len(volume))]
    return np.float32(min(each.min() for each in slices)), np.float32(max(each.max() for each in slices))


def _steps(values: NDArray[np.float32], largest: np.float32) -> NDArray[np.float32]:
    """Values from 0 to the largest, in whole steps of it."""
    return np.asarray(np.rint(values * (np.float32(_STEPS) / max(largest, _LITTLE))), np.float32)
