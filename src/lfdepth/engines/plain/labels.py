"""Cost volumes (K, H, W): minima, paths with any penalty, local means."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.base import Array, Float

Exact = NDArray[np.float64]


def minima(volume: Array) -> tuple[NDArray[np.int32], Float]:
    """First label of least cost; the cost there, before and after, and the next lowest local minimum."""
    index = volume.argmin(axis=0)
    last = len(volume) - 1
    places = (index, np.maximum(index - 1, 0), np.minimum(index + 1, last))
    beside = [np.take_along_axis(volume, place[None], 0)[0] for place in places]
    other = np.empty_like(beside[0])
    for y, x in np.ndindex(*index.shape):
        found = _local_minima(volume[:, y, x])
        other[y, x] = sorted(found)[1] if len(found) > 1 else volume[:, y, x].max()
    return index.astype(np.int32), np.array([*beside, other], np.float32)


def _local_minima(costs: Array) -> list[float]:
    """Costs of local minima; a level stretch of labels is one, or none."""
    levels = [float(costs[0])]
    for cost in costs[1:]:
        if cost != levels[-1]:
            levels.append(float(cost))
    padded = [np.inf, *levels, np.inf]
    return [b for a, b, c in zip(padded, padded[1:], padded[2:], strict=False) if a > b < c]


def paths(volume: Array, weights: Float, table: Float) -> Float:
    """Costs (K, H, W) summed over the best paths from 2·N sides."""
    costs = np.moveaxis(volume.astype(np.float64), 0, 2)
    total = np.zeros_like(costs)
    for weight, step in zip(weights.astype(np.float64), ((0, 1), (1, 0), (1, 1), (1, -1)), strict=False):
        for way in (1, -1):
            total += _sweep(costs, weight, table.astype(np.float64), step, way)
    return np.asarray(np.moveaxis(total, 2, 0), np.float32)


def _sweep(costs: Exact, weight: Exact, table: Exact, step: tuple[int, int], way: int) -> Exact:
    """Costs (H, W, K) of paths along `step`, or against it."""
    height, width, count = costs.shape
    apart = np.abs(np.arange(count)[:, None] - np.arange(count))
    penalty = table[np.minimum(apart, len(table) - 1)]
    out = costs.copy()
    for place in list(np.ndindex(height, width))[::way]:
        y, x = place
        before = y - way * step[0], x - way * step[1]
        if not (0 <= before[0] < height and 0 <= before[1] < width):
            continue
        pair = weight[before if way == 1 else place]
        path = out[before] - out[before].min()
        out[y, x] += (path[:, None] + pair * penalty).min(axis=0)
    return out


def local_means(volume: Array, weights: Float, around: NDArray[np.int64]) -> Exact:
    """Weighted sums (K, H, W) of the pixels around every pixel."""
    planes = np.moveaxis(volume.astype(np.float64), 0, 2)
    total = np.zeros_like(planes)
    for n, (down, across) in enumerate(around.tolist()):
        total += weights[:, n, :, None] * _moved(planes, down, across)
    return np.moveaxis(total, 2, 0)


def _moved(image: NDArray[Any], dy: int, dx: int) -> Exact:
    """What lies `dy` below and `dx` to the right of each pixel of (H, W, ...), 0 beyond the border."""
    out = np.zeros(image.shape)
    height, width = image.shape[:2]
    rows, columns = (
        slice(max(-dy, 0), max(height - max(dy, 0), 0)),
        slice(max(-dx, 0), max(width - max(dx, 0), 0)),
    )
    source = image[max(dy, 0) :, max(dx, 0) :][: rows.stop - rows.start, : columns.stop - columns.start]
    out[rows, columns] = source
    return out
