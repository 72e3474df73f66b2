"""The oracle of cost volumes: minima, paths with any penalty, bilateral means; pixel by pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def local_minima(costs: list[float]) -> list[float]:
    """Costs of the stretches of equal costs that are lower than what lies beside them."""
    found, first = [], 0
    while first < len(costs):
        last = first
        while last + 1 < len(costs) and costs[last + 1] == costs[first]:
            last += 1
        left = costs[first - 1] if first > 0 else np.inf
        right = costs[last + 1] if last + 1 < len(costs) else np.inf
        if costs[first] < min(left, right):
            found.append(costs[first])
        first = last + 1
    return found


def runner_up(costs: list[float]) -> float:
    """The second lowest local minimum, or else the largest cost."""
    found = sorted(local_minima(costs))
    return found[1] if len(found) > 1 else max(costs)


def path_sums(volume: Array, weights: Array, table: Array) -> Array:
    """Each pixel's and label's best path from every side, by recursion over pixels and pairs of labels."""
    count, height, width = volume.shape
    total = np.zeros(volume.shape)
    forward = [(0, 1), (1, 0), (1, 1), (1, -1)][: len(weights)]
    for pair, (dy, dx) in zip(weights, forward, strict=True):
        for sign in (1, -1):
            known: dict[tuple[int, int], list[float]] = {}

            def best(
                y: int,
                x: int,
                sign: int = sign,
                pair: Array = pair,
                move: tuple[int, int] = (dy, dx),
                known: dict[tuple[int, int], list[float]] = known,
            ) -> list[float]:
                if (y, x) not in known:
                    costs = [float(c) for c in volume[:, y, x]]
                    by, bx = y - sign * move[0], x - sign * move[1]
                    if 0 <= by < height and 0 <= bx < width:
                        earlier = best(by, bx)
                        weight = float(pair[by, bx] if sign == 1 else pair[y, x])
                        for k in range(count):
                            costs[k] += min(
                                earlier[j] + weight * float(table[min(abs(j - k), len(table) - 1)])
                                for j in range(count)
                            ) - min(earlier)
                    known[y, x] = costs
                return known[y, x]

            for y, x in np.ndindex(height, width):
                total[:, y, x] += best(y, x)
    return total


def bilateral(
    image: Array,
    guide: Array,
    radius: int,
    sigma_colour: float,
    sigma_space: float | None,
    colours: str,
    window: str,
) -> Array:
    """Weighted mean of every window, cut at the border."""
    height, width = image.shape
    out = np.zeros(image.shape)
    for y, x in np.ndindex(height, width):
        total = weight = 0.0
        for qy in range(max(y - radius, 0), min(y + radius + 1, height)):
            for qx in range(max(x - radius, 0), min(x + radius + 1, width)):
                space = (y - qy) ** 2 + (x - qx) ** 2
                if window == "disc" and space > radius**2:
                    continue
                pairs = [abs(float(a) - float(b)) for a, b in zip(guide[y, x], guide[qy, qx], strict=True)]
                apart = sum(each**2 for each in pairs) if colours == "euclidean" else sum(pairs) ** 2
                own = np.exp(-apart / (2 * sigma_colour**2))
                own *= 1 if sigma_space is None else np.exp(-space / (2 * sigma_space**2))
                total, weight = total + own * float(image[qy, qx]), weight + own
        out[y, x] = total / weight
    return out
