"""The weighted median by sorting networks: a window's pixels side by side, sorted by compare-exchange."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.base import Float
from lfdepth.engines.cpu.kernels.median import median_kernel
from lfdepth.engines.cpu.workers import Workers


def weighted_median(
    workers: Workers,
    disparity: NDArray[Any],
    guide: NDArray[Any],
    weight: NDArray[Any] | None,
    radius: int,
    sigma_colour: float,
    sigma_space: float,
) -> Float:
    """Filter a map (H, W)."""
    out = np.empty(disparity.shape, np.float32)
    prior = np.ones(disparity.shape) if weight is None else weight
    to_binary = 1 / np.log(2)
    workers.rows(
        disparity.shape[0],
        median_kernel,
        out,
        _padded(disparity, radius, "edge"),
        _padded(np.moveaxis(guide, 2, 0), radius, "edge"),
        # Pixels beyond the border weigh nothing, which cuts the window.
        _padded(prior, radius, "constant"),
        _offsets(radius, to_binary / (2 * sigma_space**2)),
        sorting_network((2 * radius + 1) ** 2),
        np.float32(min(to_binary / (2 * sigma_colour**2), np.finfo(np.float32).max)),
    )
    return out


def _padded(maps: NDArray[Any], radius: int, mode: Any) -> Float:
    """Flat copy, padded along the last two axes."""
    border = [(0, 0)] * (maps.ndim - 2) + [(radius, radius)] * 2
    return np.pad(maps.astype(np.float32), border, mode).reshape(-1)


def _offsets(radius: int, scale: float) -> Float:
    """(down, across, `scale` times their squared length) of a window's pixels."""
    down, across = (axis.reshape(-1) for axis in np.mgrid[-radius : radius + 1, -radius : radius + 1])
    exponents = np.minimum(scale * (down**2 + across**2), 30.0)
    return np.stack([down, across, exponents], axis=-1).astype(np.float32)


@cache
def sorting_network(count: int) -> NDArray[np.int64]:
    """Pairs (low, high) to put in order, one after the other, that sort any `count` values.

    Batcher's merge exchange: Knuth, The Art of Computer Programming 3, 5.2.2, algorithm M.
    """
    pairs: list[tuple[int, int]] = []
    top = 1 << max((count - 1).bit_length() - 1, 0)
    p = top
    while p > 0:
        q, r, d = top, 0, p
        while True:
            pairs += [(i, i + d) for i in range(count - d) if i & p == r]
            if q == p:
                break
            d, q, r = q - p, q // 2, p
        p //= 2
    return np.array(pairs, np.int64).reshape(-1, 2)
