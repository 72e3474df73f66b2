"""The spinning parallelogram: how different the two sides of a line through an epipolar-plane image are.

Zhang, Sheng, Li, Zhang, Xiong: Robust depth estimation for light field via spinning parallelogram operator,
CVIU 145, 2016, doi:10.1016/j.cviu.2015.12.007.

On the line that a point draws through an EPI the colours left of it and right of it differ most; that holds
even where something hides the point on one side. Sides are compared by histograms of their colours, weighted
by the distance w from the line with `w·exp(−w²/2α)`: the weight is odd, so one histogram of signed weights is
the difference of the two sides', and the sum of its squares their distance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.smoothing import GuidedFilter
from lfdepth.engines.base import Array, Engine
from lfdepth.engines.layout import LABELS_AT_ONCE
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField
from lfdepth.trace import Trace

REACH = 4.5
"""Deviations √α of the weight beyond which samples are left out: they would count 2·10⁻⁴."""

CROSS = ((0, 1), (1, 0))
"""Steps (down, right) through the grid and the picture: rows, and columns."""

STAR = (*CROSS, (1, 1), (1, -1))
"""The same, and both diagonals."""


@dataclass(frozen=True, eq=False)
class Epi:
    """Views that stand in a line, and with them an EPI through every pixel.

    Attributes
    ----------
    pictures
        (N, C, H, W) uint8 bins of their samples' levels, the engine's.
    walk
        Px down and right from a sample of an EPI to the next.
    steps
        (N,) how far each view stands along the line, in such steps.
    beside
        (N, 2) how far down and right it stands off the line, in view steps.
    """

    pictures: Array
    walk: tuple[int, int]
    steps: NDArray[np.float64]
    beside: NDArray[np.float64]


def line_of_views(present: NDArray[np.bool_], walk: tuple[int, int]) -> list[tuple[int, int]]:
    """Places in the grid of the views that exist in a line through the reference view."""
    rows, columns = present.shape
    centre = np.array([rows // 2, columns // 2])
    ends = max(rows, columns)
    places = [tuple(centre + i * np.array(walk)) for i in range(-ends, ends + 1)]
    return [(v, u) for v, u in places if 0 <= v < rows and 0 <= u < columns and present[v, u]]


def epis(lf: LightField, walks: Sequence[tuple[int, int]], bins: int, engine: Engine) -> list[Epi]:
    """EPIs in all directions (steps down and right) in which a view stands beside the reference view.

    Parameters
    ----------
    lf
        Light field.
    walks
        Directions, such as `CROSS`.
    bins
        Bins of each channel's histogram, 2 to 256.
    engine
        Engine.

    Raises
    ------
    LightFieldError
        If there is none.
    """
    found = []
    for walk in walks:
        places = line_of_views(lf.available, walk)
        if len(places) < 2:
            continue
        pictures = np.stack([np.moveaxis(binned(lf.views[place], bins), 2, 0) for place in places])
        offsets = np.array([lf.offsets[place] for place in places])
        along = np.array(walk, np.float64)
        steps = offsets @ along / (along @ along)
        found.append(Epi(engine.upload(pictures), walk, steps, offsets - steps[:, None] * along))
    if not found:
        raise LightFieldError(
            f"{lf.name}: no view is in line with the reference view; expected one beside, above or below it; "
            "choose another grid, or a method that uses all views"
        )
    return found


def binned(view: NDArray[Any], bins: int) -> NDArray[np.uint8]:
    """Bins of a view's levels, each as wide as the others; of 8-bit levels and 64 bins, four levels."""
    if view.dtype == np.uint8:
        return np.asarray(view.astype(np.uint16) * np.uint16(bins) >> np.uint16(8), np.uint8)
    levels = view if view.dtype == np.uint16 else np.rint(view * np.float32(65535))
    return np.asarray(levels.astype(np.uint32) * np.uint32(bins) >> np.uint32(16), np.uint8)


def distances(
    epi: Epi, planes: NDArray[np.float64], alpha: float, bins: int, engine: Engine
) -> Iterator[tuple[slice, NDArray[np.float32]]]:
    """Distances of the histograms on both sides of the lines of all labels.

    Parameters
    ----------
    epi
        EPIs of one direction.
    planes
        (K,) disparities of the labels, px per view step.
    alpha
        Square of the distance in px at which samples weigh most.
    bins
        Bins of the histograms.
    engine
        Engine.

    Yields
    ------
    A few labels at a time, and (L, H, W) float32 sums of squares over bins and channels; memory that is used
    again.
    """
    out = engine.empty((LABELS_AT_ONCE, *epi.pictures.shape[2:]), np.float32)
    nearest = np.rint(-planes[:, None, None] * epi.beside).astype(np.int64)
    for labels in _groups(nearest):
        first, weights = _weights(planes[labels], epi.steps, alpha)
        corners = first[:, None] * np.array(epi.walk) + nearest[labels.start]
        engine.histogram_distances(epi.pictures, bins, epi.walk, corners, weights, out)
        yield labels, engine.download(out)[: labels.stop - labels.start]


def _groups(nearest: NDArray[np.int64]) -> Iterator[slice]:
    """Labels side by side for which views off the line are sampled in the same px."""
    start, count = 0, len(nearest)
    for label in range(1, count + 1):
        full = label - start == LABELS_AT_ONCE
        if label == count or full or not np.array_equal(nearest[label], nearest[start]):
            yield slice(start, label)
            start = label


def _weights(
    planes: NDArray[np.float64], steps: NDArray[np.float64], alpha: float
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """First sample of each view (N,), and weights (N, S, L) from it on; those of labels that lack are 0."""
    reach = REACH * np.sqrt(alpha)
    line = -steps[:, None] * planes
    first = np.ceil(line.min(axis=1) - reach).astype(np.int64)
    last = np.floor(line.max(axis=1) + reach).astype(np.int64)
    samples = first[:, None] + np.arange((last - first).max() + 1)
    distance = samples[:, :, None] - line[:, None, :]
    weights = np.where(abs(distance) <= reach, distance * np.exp(-(distance**2) / (2 * alpha)), 0)
    lacking = LABELS_AT_ONCE - len(planes)
    return first, np.pad(weights, ((0, 0), (0, 0), (0, lacking))).astype(np.float32)


def certainty(volume: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """How clearly one label of a direction stands out: exp(−mean/(σ·max)) over the labels of (K, H, W)."""
    largest = volume.max(axis=0)
    share = np.divide(volume.mean(axis=0), largest, out=np.ones_like(largest), where=largest > 0)
    return np.asarray(np.exp(-share / np.float32(sigma)), np.float32)


@dataclass(frozen=True)
class SideRule:
    """How sides are compared, and directions joined.

    Attributes
    ----------
    alpha
        Square of the distance in px at which samples weigh most.
    bins
        Bins of each channel's histogram.
    sigma
        How much a direction counts less where no label stands out (`certainty`).
    """

    alpha: float = 0.8
    bins: int = 64
    sigma: float = 0.26


def joined_costs(
    directions: Sequence[Epi],
    planes: NDArray[np.float64],
    rule: SideRule,
    *,
    trust: Sequence[NDArray[np.float32]] | None = None,
    engine: Engine,
    trace: Trace,
) -> NDArray[np.float32]:
    """Costs of all labels: the distances of all directions, each as its labels stand out, less than zero.

    Parameters
    ----------
    directions
        EPIs.
    planes
        (K,) labels.
    rule
        How they are compared.
    trust
        (H, W) how much each direction counts beside; the costs are then means, without it sums.
    engine, trace
        Engine, and the trace, which is told of every label of every direction.

    Returns
    -------
    (K, H, W), on the host.
    """
    size = directions[0].pictures.shape[2:]
    costs = np.zeros((len(planes), *size), np.float32)
    alone, total = np.empty_like(costs), np.zeros(size, np.float32)
    for index, epi in enumerate(directions):
        with trace.block("histograms"):
            for labels, found in distances(epi, planes, rule.alpha, rule.bins, engine):
                alone[labels] = found
                for _ in found:
                    trace.step("label")
        with trace.block("directions"):
            weight = certainty(alone, rule.sigma)
            if trust is not None:
                weight *= trust[index]
            total += weight
            for cost, distance in zip(costs, alone, strict=True):
                cost -= weight * distance
    if trust is not None:
        costs /= np.maximum(total, np.float32(1e-30))
    return costs


def smooth_slices(costs: NDArray[np.float32], smoothing: GuidedFilter, engine: Engine, trace: Trace) -> Array:
    """Costs (K, H, W) smoothed slice by slice, the engine's; what is given may be written over."""
    volume = engine.upload(costs)
    out = engine.empty(costs.shape[1:], np.float32)
    for cost in volume:
        with trace.block("smoothing"):
            smoothing.smooth(cost, out)
            cost[:] = out
        trace.step("slice")
    return volume
