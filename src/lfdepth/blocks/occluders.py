"""Views that an occluder leaves: two groups of views at every pixel, what they cost, and an energy of labels.

Wang, Efros, Ramamoorthi: Occlusion-aware depth estimation using light-field cameras, ICCV 2015,
doi:10.1109/ICCV.2015.398, and TPAMI 38(11), 2016, doi:10.1109/TPAMI.2016.2515615. Zhu, Wang, Yu:
Occlusion-model guided antiocclusion depth estimation in light field, IEEE JSTSP 11(7), 2017,
doi:10.1109/JSTSP.2017.2730818.

Where the occluder covers p + s·(u, v) of the reference view's pixels, s the difference of disparities, it
hides p from view (u, v). So an edge in the picture splits the views as it splits the picture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.bilateral import bilateral_weights
from lfdepth.blocks.contours import canny
from lfdepth.blocks.labels import cheapest
from lfdepth.blocks.smoothing import guide_image
from lfdepth.engines.base import Engine
from lfdepth.engines.layout import PATH_STEPS
from lfdepth.lightfield import LightField, luma
from lfdepth.trace import Trace

Float = NDArray[np.float32]
Bool = NDArray[np.bool_]
Groups = NDArray[np.uint8]

FEWEST = 5
"""A group of fewer views would say nothing: all take its place."""

_BAND = 1.0
"""View steps beside the line that belong to neither half."""

_BESIDE = 2.0
"""Px from an edge at which its two sides' colours are looked up."""

_COLOUR_TOLERANCE = 0.05
"""Squared difference of colours, of full scale, by which halves may fit the other sides better."""

_OUTER = 0.1
"""Part of the labels at either end of the range that are not trusted."""


def halves(lf: LightField, angles: NDArray[np.float64]) -> Groups:
    """Views on either side of the line at each pixel's angle; all views in both where it is NaN.

    Parameters
    ----------
    lf
        Light field.
    angles
        (H, W) radians, anticlockwise from the rows.

    Returns
    -------
    (2, V·U, H, W) uint8, 1 where a view belongs to a half.
    """
    groups = np.zeros((2, lf.available.size, *angles.shape), np.uint8)
    up, right = np.cos(angles), -np.sin(angles)
    for n, (place, exists) in enumerate(np.ndenumerate(lf.available)):
        if not exists:
            continue
        down, across = lf.offsets[place]
        beyond = right * across - up * down
        groups[0, n], groups[1, n] = beyond > _BAND + 1e-9, beyond < -_BAND - 1e-9
    return _filled(groups, lf.available)


def _filled(groups: Groups, present: Bool) -> Groups:
    """All views where a group has too few, in place."""
    everyone = present.reshape(-1, 1, 1).astype(np.uint8)
    for group in groups:
        lacking = group.sum(axis=0, dtype=np.int64) < FEWEST
        np.copyto(group, everyone, where=lacking)
    return groups


def side_contrast(lf: LightField, angles: NDArray[np.float64]) -> Float:
    """Colour (C, H, W) on the first half's side of each pixel's edge, less that on the other side; else 0."""
    picture = guide_image(lf, "colour")
    y, x = np.indices(angles.shape)
    down, across = -_BESIDE * np.cos(angles), -_BESIDE * np.sin(angles)
    edge = ~np.isnan(angles)
    sides = []
    for way in (1, -1):
        rows = np.rint(np.where(edge, y + way * down, y)).astype(np.int64).clip(0, lf.height - 1)
        columns = np.rint(np.where(edge, x + way * across, x)).astype(np.int64).clip(0, lf.width - 1)
        sides.append(picture[rows, columns])
    return np.ascontiguousarray(np.moveaxis(sides[0] - sides[1], 2, 0))


def consistent_groups(
    lf: LightField,
    candidates: Bool,
    *,
    clusters: int,
    alike: float,
    rounds: int,
    scale: float,
    engine: Engine,
) -> Groups:
    """Views that should see each candidate, and all views.

    A view should see it where the reference view, as many px away as the view is steps, times `scale`, shows
    what hangs together with the pixel.

    Returns
    -------
    (2, V·U, H, W) uint8.
    """
    everyone = lf.available.reshape(-1, 1, 1).astype(np.uint8)
    groups = np.empty((2, lf.available.size, lf.height, lf.width), np.uint8)
    groups[:] = everyone
    points = np.argwhere(candidates)
    cells = np.rint(scale * lf.offsets.reshape(-1, 2)).astype(np.int64)
    radius = max(int(np.abs(cells[lf.available.ravel()]).max()), 1)
    regions = engine.patch_regions(
        guide_image(lf, "colour"), points, radius=radius, clusters=clusters, alike=alike, rounds=rounds
    )
    for n in np.flatnonzero(lf.available):
        down, across = cells[n] + radius
        groups[0, n][candidates] = regions[:, down, across]
    return _filled(groups, lf.available)


@dataclass(frozen=True, eq=False)
class Winners:
    """What the labels cost, and what the groups of views show at the cheapest.

    Attributes
    ----------
    labels
        (H, W) cheapest label.
    disparity
        (H, W) its disparity, px per view step.
    confidence
        (H, W) in [0, 1]: how much higher the next local minimum lies, as a part of the least cost.
    spreads
        (2, H, W) standard deviation in each group at the cheapest label.
    apart
        (H, W) squared distance of the groups' mean colours there.
    """

    labels: NDArray[np.int32]
    disparity: Float
    confidence: Float
    spreads: Float
    apart: Float


Choose = Callable[[Float, Float], tuple[Float, Float]]
"""From the groups' means (2, C, H, W) and deviations (2, H, W) to deviation and distance of colours."""


def find_winners(
    lf: LightField,
    planes: NDArray[np.float64],
    groups: Groups,
    choose: Choose,
    *,
    window: int,
    sigma_colour: float,
    subplane: bool,
    engine: Engine,
    trace: Trace,
) -> Winners:
    """Cost of every label: deviation of the views and distance of their mean colour, bilaterally smoothed."""
    size = lf.height, lf.width
    with trace.block("preparation"):
        views = engine.colour_views(lf, float(np.abs(planes).max()))
        members = engine.upload(groups)
        guide = guide_image(lf, "colour")
        weights = bilateral_weights(guide, window, sigma_colour=sigma_colour)
        means = engine.empty((2, lf.shape[4], *size), np.float32)
        variances = engine.empty((2, *size), np.float32)
        volume = engine.empty((len(planes), *size), np.float32)
    least = np.full(size, np.inf, np.float32)
    spreads, apart = np.zeros((2, *size), np.float32), np.zeros(size, np.float32)
    for k, plane in enumerate(planes):
        with trace.block("views"):
            engine.view_groups(views, float(plane), members, means, variances)
        with trace.block("costs"):
            mean, deviation = engine.download(means), np.sqrt(engine.download(variances))
            cost = np.add(*choose(mean, deviation))
            trace.take("costs", cost)
        with trace.block("smoothing"):
            engine.local_means(engine.upload(cost[None]), *weights, volume[k : k + 1])
        with trace.block("costs"):
            found = engine.download(volume[k])
            better = found < least
            np.copyto(least, found, where=better)
            np.copyto(spreads, deviation, where=better)
            np.copyto(apart, ((mean[0] - mean[1]) ** 2).sum(axis=0), where=better)
        trace.step("label")
    with trace.block("decoding"):
        disparity, _ = cheapest(volume, planes, subplane=subplane, engine=engine)
        labels, beside = engine.minima(volume)
        largest = np.max(engine.download(volume), axis=0)
    return Winners(labels, disparity, _confidence(labels, beside, largest, len(planes)), spreads, apart)


def _confidence(labels: NDArray[np.int32], beside: Float, largest: Float, count: int) -> Float:
    """Second lowest local minimum over the lowest, less 1; 0 near the ends of the range."""
    least, before, after, other = beside
    # Where there is one minimum only the lower of its neighbours is the second lowest; `minima` repeats the
    # least cost beyond the ends.
    before = np.where(labels == 0, after, before)
    after = np.where(labels == count - 1, before, after)
    second = np.where(other < largest, other, np.minimum(before, after))
    found = np.divide(second, least, out=np.ones_like(least), where=least > 0) - 1
    outer = (labels < _OUTER * count) | (labels >= (1 - _OUTER) * count)
    return np.asarray(np.clip(np.where(outer, 0, found), 0, 1), np.float32)


def choose_half(contrast: Float, picture: Float) -> Choose:
    """The half of less deviation, if the halves' colours fit the sides of the edge no worse than crossed.

    Else the deviation is 1 and the colour −1. `contrast` (C, H, W) is `side_contrast`, `picture` (H, W, C)
    the reference view.
    """
    failed = (1 + picture).sum(axis=2)

    def choose(means: Float, deviations: Float) -> tuple[Float, Float]:
        # ‖m₁ − a‖² + ‖m₂ − b‖² − ‖m₁ − b‖² − ‖m₂ − a‖² is −2·(m₁ − m₂)·(a − b).
        fits = ((means[0] - means[1]) * contrast).sum(axis=0) > -_COLOUR_TOLERANCE / 2
        distances = np.abs(means).sum(axis=1)
        second = deviations[1] < deviations[0]
        deviation = np.where(second, deviations[1], deviations[0])
        distance = np.where(second, distances[1], distances[0])
        return np.where(fits, deviation, np.float32(1)), np.where(fits, distance, failed)

    return choose


def choose_first(doubt: float) -> Choose:
    """The first group, at a cost of `doubt`, or all views, which are the second: whichever costs less.

    Where a picture has texture and no occluder, views that are chosen by colour agree at a wrong label too,
    and all views at the right one alone.
    """

    def choose(means: Float, deviations: Float) -> tuple[Float, Float]:
        distances = np.abs(means).sum(axis=1)
        chosen = deviations[0] + np.float32(doubt)
        everyone = deviations[1] + distances[1] <= chosen + distances[0]
        return np.where(everyone, deviations[1], chosen), np.where(everyone, distances[1], distances[0])

    return choose


def occlusion_chains(winners: Winners, near: Bool, edges: Bool) -> Bool:
    """Edges at which the two halves differ: whole chains of which a tenth of the pixels do."""
    from scipy import ndimage

    ratio = np.minimum(_ratio(winners.spreads), 100)
    apart = np.minimum(winners.apart, 0.01)
    both = _standardised(ratio) * _standardised(apart)
    found = (both > 1) & (ratio > ratio.mean()) & near
    pieces, count = ndimage.label(found, np.ones((3, 3), bool))
    sizes = np.bincount(pieces.ravel(), minlength=count + 1)
    found &= sizes[pieces] >= 2
    crowded = ndimage.convolve(edges.astype(np.int64), np.ones((3, 3), np.int64), mode="constant") > 3
    chains, number = ndimage.label(edges & ~crowded, np.ones((3, 3), bool))
    lengths = np.bincount(chains.ravel(), minlength=number + 1)
    hits = np.bincount(chains[found], minlength=number + 1)
    marked = hits > 0.1 * lengths
    marked[0] = False
    return np.asarray(marked[chains])


def _ratio(spreads: Float) -> Float:
    """The larger of two deviations over the smaller; 1 where both are 0."""
    larger, smaller = np.maximum(*spreads), np.minimum(*spreads)
    return np.asarray(np.where(larger > 0, larger / np.maximum(smaller, 1e-12), 1), np.float32)


def _standardised(values: Float) -> Float:
    deviation = values.std()
    return np.asarray((values - values.mean()) / deviation if deviation > 0 else np.zeros_like(values))


def regularise(
    lf: LightField,
    winners: Winners,
    occlusions: Bool,
    planes: NDArray[np.float64],
    *,
    subplane: bool,
    engine: Engine,
) -> Float:
    """Labels near the winners' that change little but at edges and occlusions; the disparity (H, W).

    Where the winner is sure labels around it cost more. Neighbours pay `min(0.3, 1 − exp(−d²/(2·(K/20)²)))`
    for a change by d of K labels, times a weight that falls with what changes between them in the picture.
    Minimised along scanlines, where the original ran a graph cut. At the end a median of 3×3 px.
    """
    from scipy import ndimage

    count = len(planes)
    width = 0.1 * count * np.clip(1 - winners.confidence, 0.01, 1)
    costs = np.empty((count, *width.shape), np.float32)
    for k in range(count):
        costs[k] = 1 - np.exp(-((k - winners.labels) ** 2) / (2 * width**2))
    changes = np.arange(count)
    table = np.minimum(0.3, 1 - np.exp(-(changes**2) / (2 * (0.05 * count) ** 2))).astype(np.float32)
    table = table[: int(np.argmax(table >= table[-1])) + 1]
    volume = engine.upload(costs)
    del costs
    engine.line_paths(volume, _pair_weights(lf, occlusions), table)
    disparity, _ = cheapest(volume, planes, subplane=subplane, engine=engine)
    return np.asarray(ndimage.median_filter(disparity, 3, mode="nearest"))


def _pair_weights(lf: LightField, occlusions: Bool) -> Float:
    """Weights (2, H, W) between a pixel and the next to the right, and below."""
    from scipy import ndimage

    picture = guide_image(lf, "colour").astype(np.float64)
    edges = canny(luma(lf.reference), sigma=1.0, upper=0.1)
    weights = np.zeros((2, *edges.shape), np.float32)
    for weight, (down, across) in zip(weights, PATH_STEPS[:2], strict=True):
        slope = np.abs(ndimage.sobel(picture, axis=0 if down else 1, mode="nearest")).sum(axis=2)
        change = _next(slope, down, across) + slope.max() * (
            _next(edges, down, across) + 1e5 * _next(occlusions, down, across)
        )
        weight[: change.shape[0], : change.shape[1]] = 1 / (0.2 * (change + 0.1))
    return weights


def _next(image: NDArray[Any], down: int, across: int) -> NDArray[np.float64]:
    """Absolute difference of each pixel to the next."""
    values = image.astype(np.float64)
    height, width = values.shape
    return np.asarray(np.abs(values[down:, across:] - values[: height - down, : width - across]))
