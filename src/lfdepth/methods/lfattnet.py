"""LFAttNet (Tsai et al., AAAI 2020): features of all views in a volume, weighed by an attention."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from lfdepth.learned.lfattnet import CHANNELS, FEATURES, PLANES, SMALLEST, VIEWS
from lfdepth.learned.running import check_grid, confidence, grey_views, lfattnet_of, predict_views
from lfdepth.methods.base import Maps, Method, MethodInfo, Problem, Shape, Work
from lfdepth.methods.parameters import Text, Whole

_MARGIN = 32
"""Px of context around a tile; what lies farther hardly counts."""


@dataclass(frozen=True, kw_only=True)
class Lfattnet(Method):
    """Features of all 9x9 views, moved to nine planes, are a volume that three-dimensional convolutions read.

    An attention weighs the views; it looks at one tile at a time. Disparities beyond 4 px per view step are
    out of reach. Runs by onnxruntime (extra "onnx").
    """

    info: ClassVar = MethodInfo(
        name="lfattnet",
        summary="LFAttNet, attention over all views; needs weights (docs/learned.md).",
        reference="10.1609/aaai.v34i07.6888",
    )

    weights: Annotated[
        str | None,
        Text("File of weights, .npz as lfdepth train writes it or .onnx.", without="none"),
    ] = None
    tile: Annotated[
        int,
        Whole("Side of the tiles that are computed at a time.", ge=16, le=512, unit="px"),
    ] = 64

    def check(self, shape: Shape) -> None:
        """It takes nine views along either axis, and weights that fit."""
        check_grid(self.name, (shape[0], shape[1]), VIEWS)
        lfattnet_of(self.weights)

    def memory(self, shape: Shape, planes: NDArray[np.float64], sample_bytes: int) -> int:
        """Grey views, and of a tile the volume three times and its convolutions."""
        side = self.tile + 2 * _MARGIN + SMALLEST
        channels = 3 * VIEWS * VIEWS * FEATURES + 4 * CHANNELS
        return 4 * (VIEWS * VIEWS * shape[2] * shape[3] + len(PLANES) * channels * side * side)

    def halo(self) -> int:
        """Context of a tile."""
        return _MARGIN

    def run(self, problem: Problem, work: Work) -> Maps:
        """Views in tiles through the network."""
        lf, trace = problem.lf, work.trace
        trace.steps(1)
        with trace.block("preparation"):
            network = lfattnet_of(self.weights)
            grey = grey_views(lf, [(v, u) for v in range(-4, 5) for u in range(-4, 5)])
        with trace.block("network"):
            disparity = predict_views(network, grey, self.tile, _MARGIN, SMALLEST)
        trace.step("network")
        with trace.block("confidence"):
            sure = confidence(grey, disparity, VIEWS)
        return Maps(disparity, sure)
