"""From a cost volume to a map: the cheapest label, paths that keep neighbours alike, and how sure it is.

Costs are (K, H, W) float32, one label for each plane front to back; less is better.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import single
from lfdepth.engines.base import Array, Engine
from lfdepth.engines.layout import PATH_STEPS

Regulariser = Literal["paths", "none"]


def cheapest(
    volume: Array, planes: NDArray[np.float64], *, subplane: bool = False, engine: Engine | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Winner takes all.

    Parameters
    ----------
    volume
        (K, H, W) float32 costs, the engine's; of costs of which more is better, the negative.
    planes
        (K,) disparities front to back, evenly spaced, px per view step.
    subplane
        Place the disparity at the vertex of the parabola through the least cost and those beside it.
    engine
        Engine; by default the processor's, on one thread.

    Returns
    -------
    Disparity (H, W), px per view step, and confidence (H, W) in [0, 1]: how much better the least cost is
    than the next local minimum, as a part of the larger magnitude of the two. Where there is one minimum
    only, it is compared with the largest cost.
    """
    index, (least, before, after, other) = (engine or single()).minima(volume)
    disparity = planes[index]
    if subplane:
        step = float(planes[1] - planes[0])
        inner = (index > 0) & (index < len(planes) - 1)
        disparity = disparity + step * _vertex(before - least, after - least, inner)
    scale = np.maximum(np.abs(least), np.abs(other))
    better = np.divide(other - least, scale, out=np.zeros_like(least), where=scale > 0)
    return disparity.astype(np.float32), np.clip(better, 0, 1)


def _vertex(
    left: NDArray[np.float32], right: NDArray[np.float32], inner: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Places of parabolas' minima between labels, in labels, by how far the neighbours lie above."""
    total = left + right
    half = np.float32(0.5) * (left - right)
    return np.asarray(np.divide(half, total, out=np.zeros_like(total), where=inner & (total > 0)))


def neighbour_weights(guide: NDArray[Any], weigh: Any, *, sides: Literal[4, 8] = 4) -> NDArray[np.float32]:
    """Weights between neighbours for `Engine.line_paths`.

    Parameters
    ----------
    guide
        (H, W, C) that weights follow.
    weigh
        Gives weights (h, w) for two parts (h, w, C) of the guide, pixels and their neighbours.
    sides
        From how many sides paths come.

    Returns
    -------
    (N, H, W) float32, N = 2 or 4; 0 where there is no neighbour.
    """
    height, width = guide.shape[:2]
    weights = np.zeros((sides // 2, height, width), np.float32)
    for out, (down, across) in zip(weights, PATH_STEPS, strict=False):
        rows = slice(0, height - down), slice(down, height)
        columns = (
            slice(max(-across, 0), width - max(across, 0)),
            slice(max(across, 0), width - max(-across, 0)),
        )
        out[rows[0], columns[0]] = weigh(guide[rows[0], columns[0]], guide[rows[1], columns[1]])
    return weights


def truncated_linear(slope: float, cut: int) -> NDArray[np.float32]:
    """Penalties `slope·min(d, cut)` of a change by d labels, for `Engine.line_paths`."""
    return (slope * np.arange(cut + 1)).astype(np.float32)
