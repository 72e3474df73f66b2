"""The oracles of what planes cost: differences, entropy, partial focal stacks; in plain NumPy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from naive_photo import UNIT, levels, sample

Array = NDArray[Any]
WHITE = 255 * UNIT


def moved(
    views: Array, disparity: float, present: Array, itself: bool = False
) -> Iterator[tuple[tuple[int, int], Array]]:
    """Place and levels (H, W, C) of every present view, or of the reference view, where a plane has it."""
    rows, columns = views.shape[:2]
    stack = levels(views)
    for i, j in np.argwhere(present).tolist():
        v, u = i - rows // 2, j - columns // 2
        source = stack[rows // 2, columns // 2] if itself else stack[i, j]
        yield (v, u), sample(source, -u * disparity, -v * disparity)


def differences(
    views: Array, disparity: float, limits: Array, beyond: float, present: Array, itself: bool = False
) -> Array:
    """Mean over views of the mean difference over channels; `beyond` where it is not below the limit."""
    own = levels(views)[views.shape[0] // 2, views.shape[1] // 2] / WHITE
    total = [
        np.where(change < limits.astype(np.float64) - 1e-12, change, beyond)
        for _, image in moved(views, disparity, present, itself)
        for change in [np.abs(image / WHITE - own).mean(axis=2)]
    ]
    return np.asarray(np.mean(total, axis=0))


def adaptive_defocus(views: Array, planes: Array, present: Array) -> Array:
    """Least distance of colour within 9×9 px plus 15 times the mean defocus there, a pixel at a time."""
    own = levels(views)[views.shape[0] // 2, views.shape[1] // 2] / WHITE
    height, width = own.shape[:2]
    costs = np.full((len(planes), height, width), np.inf)
    for k, plane in enumerate(planes.tolist()):
        total, count = np.zeros(own.shape), np.zeros((height, width))
        for (v, u), image in moved(views, plane, present):
            y, x = np.mgrid[:height, :width]
            inside = (abs(y - v * plane - (height - 1) / 2) <= (height - 1) / 2 + 1e-9) & (
                abs(x - u * plane - (width - 1) / 2) <= (width - 1) / 2 + 1e-9
            )
            total[inside] += image[inside] / WHITE
            count += inside
        defocus = np.linalg.norm(total / count[..., None] - own, axis=2)
        padded = np.pad(defocus, 3, "edge")
        mean = np.array([[padded[y : y + 7, x : x + 7].mean() for x in range(width)] for y in range(height)])
        for y, x in np.ndindex(height, width):
            around = [
                (np.linalg.norm(own[p, q] - own[y, x]), mean[p, q], (p, q) == (y, x))
                for p in range(max(0, y - 4), min(height, y + 5))
                for q in range(max(0, x - 4), min(width, x + 5))
            ]
            closest = min(distance for distance, _, itself in around if not itself)
            costs[k, y, x] = min((closest if itself else distance) + 15 * a for distance, a, itself in around)
    return costs


def entropy(views: Array, disparity: float, sigma: float, present: Array) -> Array:
    """Mean over channels of the entropy of each pixel's weighed histogram of whole 8-bit levels."""
    own = np.floor(levels(views)[views.shape[0] // 2, views.shape[1] // 2] / UNIT + 0.5)
    shown = [np.floor(image / UNIT + 0.5) for _, image in moved(views, disparity, present)]
    out = np.empty(own.shape)
    for place in np.ndindex(*own.shape):
        histogram = np.zeros(256)
        for image in shown:
            distance = image[place] - own[place]
            histogram[int(image[place])] += np.exp(-(distance**2) / (2 * sigma**2)) / len(shown)
        filled = histogram[histogram > 0]
        out[place] = -(filled / filled.sum() * np.log(filled)).sum()
    return np.asarray(out.mean(axis=2))


def focal_symmetry(
    views: Array,
    planes: Array,
    stacks: Array,
    pairs: list[tuple[int, int]],
    reach: int,
    sigma: float,
    present: Array,
    stride: int = 1,
) -> Array:
    """(K, H, W) mean over distances of the least unlikeness of two stacks before and behind each plane."""
    means: list[list[Array]] = [
        [
            np.mean([image / WHITE for _, image in moved(views, plane, present & stack)], axis=0)
            for plane in planes
        ]
        for stack in stacks
    ]
    costs = []
    for k in range(reach, len(planes) - reach):
        unlike = [
            np.min(
                [
                    1 - np.exp(-((means[i][k - d] - means[j][k + d]) ** 2).mean(axis=2) / (2 * sigma**2))
                    for i, j in pairs
                ],
                axis=0,
            )
            for d in range(0, reach + 1, stride)
        ]
        costs.append(np.mean(unlike, axis=0))
    return np.array(costs)
