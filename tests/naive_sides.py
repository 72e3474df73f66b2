"""Oracles of the spinning parallelogram, of groups of views, and of k-means in patches, in loops.

They share no code with the package.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def clamped(image: Array, y: int, x: int) -> Any:
    """A pixel, or the nearest one of the border."""
    return image[min(max(y, 0), image.shape[0] - 1), min(max(x, 0), image.shape[1] - 1)]


def histogram_distances(pictures: Array, bins: int, walk: Array, corners: Array, weights: Array) -> Array:
    """Histograms of every pixel and label, sample by sample."""
    views, channels, height, width = pictures.shape
    samples, labels = weights.shape[1:]
    out = np.zeros((labels, height, width))
    for label, y, x in np.ndindex(labels, height, width):
        histogram = np.zeros((channels, bins))
        for n, s, c in np.ndindex(views, samples, channels):
            place = y + corners[n][0] + s * walk[0], x + corners[n][1] + s * walk[1]
            histogram[c, clamped(pictures[n, c], *place)] += weights[n, s, label]
        out[label, y, x] = (histogram**2).sum()
    return out


def side_distance(
    views: Array,
    place: tuple[int, int],
    direction: tuple[int, int],
    disparity: float,
    alpha: float,
    bins: int,
) -> float:
    """The paper's distance at one pixel: 8-bit views (V, U, H, W, C), histograms over the whole EPI.

    `direction` is (down, right), in the grid and in the picture.
    """
    centre = views.shape[0] // 2, views.shape[1] // 2
    total = 0.0
    for c in range(views.shape[4]):
        histogram = [0.0] * bins
        for i in range(-max(centre), max(centre) + 1):
            at = centre[0] + i * direction[0], centre[1] + i * direction[1]
            if not (0 <= at[0] < views.shape[0] and 0 <= at[1] < views.shape[1]):
                continue
            for t in range(-40, 41):
                y, x = place[0] + t * direction[0], place[1] + t * direction[1]
                w = t + disparity * i
                level = int(clamped(views[at][..., c], y, x))
                histogram[level * bins // 256] += w * math.exp(-(w**2) / (2 * alpha))
        total += sum(value**2 for value in histogram)
    return total


def joined(costs: list[Array], sigma: float) -> Array:
    """Directions joined as their labels stand out; each (K, H, W)."""
    total = np.zeros_like(costs[0])
    for cost in costs:
        for y, x in np.ndindex(*cost.shape[1:]):
            values = cost[:, y, x]
            total[:, y, x] += values * math.exp(-values.mean() / (sigma * values.max()))
    return total


def groups_shown(levels: Array, groups: Array, reference: Array) -> tuple[Array, Array]:
    """Means less the reference (2, C, H, W) and variances (2, H, W) of views already moved (N, H, W, C)."""
    _, height, width, channels = levels.shape
    means, variances = np.zeros((2, channels, height, width)), np.zeros((2, height, width))
    for g, y, x in np.ndindex(2, height, width):
        members = [levels[n, y, x] for n in range(len(levels)) if groups[g, n, y, x]]
        if not members:
            continue
        mean = np.mean(members, axis=0)
        means[g, :, y, x] = mean - reference[y, x]
        if len(members) > 1:
            variances[g, y, x] = sum(float(((m - mean) ** 2).sum()) for m in members) / (len(members) - 1)
    return means, variances


def region(picture: Array, point: tuple[int, int], radius: int, k: int, alike: float, rounds: int) -> Array:
    """What belongs with the middle of a patch."""
    side = 2 * radius + 1
    cells = [(i, j) for i in range(side) for j in range(side)]
    colours = [
        np.asarray(clamped(picture, point[0] + i - radius, point[1] + j - radius), np.float64)
        for i, j in cells
    ]

    def apart(a: Array, b: Array) -> float:
        return sum((float(x) - float(y)) ** 2 for x, y in zip(a, b, strict=True))

    middle = cells.index((radius, radius))
    centres = [colours[middle]]
    while len(centres) < k:
        nearest = [min(apart(colour, centre) for centre in centres) for colour in colours]
        centres.append(colours[nearest.index(max(nearest))])
    cluster: list[int] = []
    for _ in range(rounds):
        distances = [[apart(colour, centre) for centre in centres] for colour in colours]
        found = [each.index(min(each)) for each in distances]
        if found == cluster:
            break
        cluster = found
        for n in range(k):
            members = [colour for colour, own in zip(colours, cluster, strict=True) if own == n]
            if members:
                centres[n] = np.mean(members, axis=0)
    own = {cluster[middle]}
    for _ in range(k):
        own |= {n for n in range(k) if any(apart(centres[n], centres[m]) < alike**2 for m in own)}
    kept, waiting = set(), [(radius, radius)]
    while waiting:
        i, j = waiting.pop()
        if (i, j) in kept or not (0 <= i < side and 0 <= j < side) or cluster[cells.index((i, j))] not in own:
            continue
        kept.add((i, j))
        waiting += [(i + a, j + b) for a in (-1, 0, 1) for b in (-1, 0, 1)]
    return np.array([cell in kept for cell in cells]).reshape(side, side)


def in_first_half(angle: float, down: float, right: float) -> bool:
    """The original's inequality, for a view so many steps below and right of the reference view."""
    row, column = 4 + down, 4 + right
    return 4 - row - math.sin(angle + math.pi / 2) > math.tan(angle) * (
        column - math.cos(angle + math.pi / 2) - 4
    )


def mrf_energy(labels: Array, first: Array, width: Array, weights: Array, count: int) -> float:
    """Energy of a labelling (H, W): unary terms, and pairs to the right and below with weights (2, H, W)."""
    energy = 0.0
    height, columns = labels.shape

    def pair(a: Any, b: Any) -> float:
        return min(0.3, 1 - math.exp(-((a - b) ** 2) / (2 * (0.05 * count) ** 2)))

    for y, x in np.ndindex(height, columns):
        energy += 1 - math.exp(-((labels[y, x] - first[y, x]) ** 2) / (2 * width[y, x] ** 2))
        if x + 1 < columns:
            energy += weights[0, y, x] * pair(labels[y, x], labels[y, x + 1])
        if y + 1 < height:
            energy += weights[1, y, x] * pair(labels[y, x], labels[y + 1, x])
    return energy
