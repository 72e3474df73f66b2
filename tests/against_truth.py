"""Maps of light fields whose truth is known, and what their errors and their confidence have to obey."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField
from lfdepth.result import Result
from lfdepth.scoring import metrics

Array = NDArray[Any]


class Scene:
    """A light field with truth, and the maps that methods with their defaults make of it, each made once."""

    def __init__(self, lf: LightField) -> None:
        assert lf.truth is not None
        self.lf, self.truth = lf, lf.truth
        self._maps: dict[str, Result] = {}

    def result(self, method: str) -> Result:
        if method not in self._maps:
            self._maps[method] = estimate(self.lf, method)
        return self._maps[method]

    def badpix(self, method: str, mask: Array | None = None, threshold: float = 0.07) -> float:
        return metrics.badpix(self.result(method).disparity, self.truth, threshold, mask)

    def mse(self, method: str) -> float:
        return metrics.mse(self.result(method).disparity, self.truth)


def check_confidence(scene: Scene, method: str) -> None:
    """Far better than chance, and BadPix falls as the least confident pixels are dropped."""
    result, truth = scene.result(method), scene.truth
    chance = np.random.default_rng(16).random(truth.shape)
    random = metrics.ause(result.disparity, truth, chance)
    curve = metrics.sparsification(result.disparity, truth, result.confidence)
    assert curve.area < 0.6 * random
    error = curve.error
    kept = [float(error[round(share * len(error))]) for share in (0.0, 0.1, 0.25, 0.5, 0.75)]
    slack = 0.03 * kept[0]
    assert all(later <= earlier + slack for earlier, later in pairwise(kept)), kept
    assert kept[3] < 0.75 * kept[0], kept
    assert kept[4] < 0.6 * kept[0], kept
