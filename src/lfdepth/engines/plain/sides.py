"""Two sides of a line through an EPI, and two groups of views."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lfdepth.engines.base import Array, Bool, Float
from lfdepth.engines.layout import COLOUR_WHITE
from lfdepth.engines.plain.costs import moved_views
from lfdepth.engines.plain.photo import ColourLevels
from lfdepth.engines.plain.sampling import moved


def histogram_distances(
    pictures: Array, bins: int, walk: tuple[int, int], corners: NDArray[np.int64], weights: Float
) -> NDArray[np.float64]:
    """Sums of squares (L, H, W) of all bins and channels."""
    height, width = pictures.shape[2:]
    total = np.zeros((weights.shape[2], height, width))
    for b in range(bins):
        histogram = np.zeros((*total.shape, pictures.shape[1]))
        for (n, s), _ in np.ndenumerate(weights[:, :, 0]):
            down, across = corners[n] + s * np.array(walk)
            inside = np.moveaxis(pictures[n] == b, 0, 2)
            sampled = moved(inside, np.arange(height) + down, np.arange(width) + across)
            histogram += weights[n, s, :, None, None, None].astype(np.float64) * sampled
        total += (histogram**2).sum(axis=3)
    return total


def view_groups(
    views: ColourLevels, disparity: float, groups: Array
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means (2, C, H, W) less the reference view, and variances (2, H, W), of two groups of views."""
    levels = np.zeros((groups.shape[1], *views.size, views.levels.shape[4]))
    indices = np.flatnonzero(views.present)
    for index, level in zip(indices, moved_views(views, disparity), strict=True):
        levels[index] = (level - views.levels[views.reference]) / COLOUR_WHITE
    means, variances = [], []
    for group in groups:
        member = (group.astype(bool) & views.present.reshape(-1, 1, 1))[..., None]
        count = member.sum(axis=0)
        mean = (levels * member).sum(axis=0) / np.maximum(count, 1)
        apart = (((levels - mean) * member) ** 2).sum(axis=(0, 3))
        means.append(np.moveaxis(mean, 2, 0))
        variances.append(apart / np.maximum(count[..., 0] - 1, 1))
    return np.array(means), np.array(variances)


def patch_regions(
    picture: Float, points: NDArray[np.int64], radius: int, clusters: int, alike: float, rounds: int
) -> Bool:
    """What belongs with the middle of each patch, (P, side, side)."""
    side = np.arange(-radius, radius + 1)
    height, width = picture.shape[:2]
    rows = np.clip(points[:, 0, None] + side, 0, height - 1)[:, :, None]
    columns = np.clip(points[:, 1, None] + side, 0, width - 1)[:, None, :]
    colours = picture[rows, columns].astype(np.float64).reshape(len(points), len(side) ** 2, -1)
    middle = len(side) ** 2 // 2
    centres = colours[:, middle][:, None]
    for _ in range(1, clusters):
        farthest = _apart(colours, centres).min(axis=2).argmax(axis=1)
        centres = np.concatenate([centres, colours[np.arange(len(points)), farthest][:, None]], axis=1)
    cluster = np.full(colours.shape[:2], -1)
    running = np.ones(len(points), np.bool_)
    for _ in range(rounds):
        found = np.where(running[:, None], _apart(colours, centres).argmin(axis=2), cluster)
        running = (found != cluster).any(axis=1)
        cluster = found
        for k in range(clusters):
            member = (cluster == k) & running[:, None]
            count = member.sum(axis=1)
            total = (colours * member[..., None]).sum(axis=1)
            centres[count > 0, k] = total[count > 0] / count[count > 0, None]
    near = _apart(centres, centres) < alike**2
    for _ in range(clusters):
        near = near @ near
    joined = near[np.arange(len(points)), cluster[:, middle]]
    allowed = np.take_along_axis(joined, cluster, 1).reshape(len(points), len(side), len(side))
    seeds = np.zeros_like(allowed)
    seeds[:, radius, radius] = True
    grown = ndimage.binary_propagation(seeds, structure=np.ones((1, 3, 3), bool), mask=allowed)
    return np.asarray(grown)


def _apart(colours: NDArray[np.float64], centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squared distances (P, N, K) of colours (P, N, C) from centres (P, K, C), channel after channel."""
    total = np.zeros((*colours.shape[:2], centres.shape[1]))
    for c in range(colours.shape[2]):
        total += (colours[:, :, None, c] - centres[:, None, :, c]) ** 2
    return total
