"""A quick look at disparities, before anything is known of a light field.

A few views, as far apart as the grid allows, are compared with the reference view over a wide range of
planes. The map is coarse, but a pixel knows whether it has only one explanation, and those that do are rarely
wrong: enough to find the range of disparities and the order of the views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import using
from lfdepth.engines.boxes import box_mean
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField, luma

if TYPE_CHECKING:
    from lfdepth.engines.base import Engine

LIMIT = 20.0
"""Largest difference that counts, grey levels of 255: beyond it, one mismatch is like another."""

PEAK = 2.5
"""Half the width of a minimum of the costs, in px by which the outermost view moves."""

_DIRECTIONS = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
# Local contrast: radius of the surroundings, px, and the level below which it is not trusted, of 255.
_SURROUNDINGS, _DARKNESS = 8, 8.0
# By how much an aperture with fewer views has to be better than all of them: a factor, and grey levels.
_PARTIAL = 1.1, 0.05


@dataclass(frozen=True)
class Order:
    """How the grid of views is taken.

    Attributes
    ----------
    transposed
        Rows for columns.
    mirrored
        Columns, after that, from right to left.
    """

    transposed: bool = False
    mirrored: bool = False

    def of(self, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rows and columns (…, 2) of views, counted from the reference view, if they are taken so."""
        grid = offsets[..., ::-1] if self.transposed else offsets
        return np.asarray(grid * np.array([1, -1 if self.mirrored else 1]), np.float64)


IN_ORDER = Order()


@dataclass(frozen=True, eq=False)
class Probe:
    """A few grey, smoothed views.

    Attributes
    ----------
    reference
        (H, W) float32, grey levels 0..255.
    views
        (N, H, W + 2·margin) float32, columns repeated beyond the border.
    offsets
        (N, 2) grid row and column of each view, counted from the reference view.
    shrink
        Whole factor by which the views were shrunk.
    margin
        Columns left and right of each view.
    """

    reference: NDArray[np.float32]
    views: NDArray[np.float32]
    offsets: NDArray[np.float64]
    shrink: int
    margin: int

    @property
    def reach(self) -> float:
        """How many view steps the outermost view is away."""
        return float(np.abs(self.offsets).max())

    @property
    def unit(self) -> float:
        """Disparity, px per view step, by which the outermost view moves one px of the shrunk views."""
        return self.shrink / self.reach

    def ordered(self, order: Order) -> NDArray[np.float64]:
        """(N, 2) rows and columns of the views where the grid is taken in another order."""
        return order.of(self.offsets)


@dataclass(frozen=True, eq=False)
class Match:
    """What was found per pixel of the shrunk views.

    Attributes
    ----------
    disparity
        (H, W) float32, px per view step of the whole views.
    cost, runner_up
        (H, W) float32, mean difference at that disparity, and the smallest one elsewhere; grey levels.
    """

    disparity: NDArray[np.float32]
    cost: NDArray[np.float32]
    runner_up: NDArray[np.float32]

    @property
    def certain(self) -> NDArray[np.bool_]:
        """(H, W), True where nothing else explains the pixel nearly as well."""
        return better(self.cost, self.runner_up)

    def coherent(self, tolerance: float, neighbours: int) -> NDArray[np.bool_]:
        """(H, W), True where certain and as many of 8 certain neighbours agree to within `tolerance` px."""
        agree, _ = self._agreement(tolerance)
        return np.asarray(self.certain & (agree >= neighbours))

    def calmed(self, tolerance: float) -> Match:
        """The same with each certain disparity averaged with those of its 8 neighbours that agree with it."""
        agree, total = self._agreement(tolerance)
        mean = np.where(self.certain, (self.disparity + total) / (1 + agree), self.disparity)
        return replace(self, disparity=mean.astype(np.float32))

    def _agreement(self, tolerance: float) -> tuple[NDArray[np.int8], NDArray[np.float32]]:
        """How many of 8 certain neighbours agree to within `tolerance` px, and the sum of theirs."""
        known = np.pad(np.where(self.certain, self.disparity, np.inf), 1, constant_values=np.inf)
        height, width = self.disparity.shape
        agree, total = np.zeros(self.disparity.shape, np.int8), np.zeros(self.disparity.shape, np.float32)
        for down, across in _DIRECTIONS:
            beside = known[1 + down : 1 + down + height, 1 + across : 1 + across + width]
            agreeing = np.abs(beside - self.disparity) <= tolerance
            agree += agreeing
            np.add(total, beside, out=total, where=agreeing)
        return agree, total


def better(cost: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Whether a cost beats another beyond noise; the constant is what rounding to 8 bits leaves open."""
    return np.asarray(other > 1.25 * cost + 0.15)


def shrink_to(lf: LightField, side: int) -> int:
    """Whole factor that leaves views whose shorter side is `side` px, or somewhat more."""
    return max(1, min(lf.height, lf.width) // side)


def widest(lf: LightField) -> float:
    """Disparity, px per view step, at which the outermost view moves by a quarter of the picture."""
    return max(lf.height, lf.width) / 4 / max(lf.centre)


def plane_range(low: float, high: float, step: float) -> NDArray[np.float64]:
    """Evenly spaced planes, ascending, at least two, the last one at or beyond `high`."""
    return low + step * np.arange(max(2, int(np.ceil((high - low) / step)) + 1), dtype=np.float64)


def make_probe(
    lf: LightField,
    limit: float,
    shrink: int,
    rings: Sequence[float],
    *,
    contrast: bool = False,
    engine: Engine | None = None,
) -> Probe:
    """Take views for planes up to |D| = `limit` px per view step.

    Parameters
    ----------
    lf
        Light field.
    limit
        Largest |D|.
    shrink
        Whole factor by which the views are shrunk.
    rings
        How far out views are taken, in eight directions, as shares of the grid's extent. Outer views are
        precise; inner ones see through gaps, and repeat themselves less.
    contrast
        Take local contrast instead of grey levels: it stays the same where brightness differs.
    engine
        Engine whose threads prepare the views.

    Raises
    ------
    LightFieldError
        If no other view than the reference view is present.
    """
    v, u = lf.centre
    places = _ring_offsets(lf, rings)
    offsets = lf.offsets[v + places[:, 0], u + places[:, 1]]
    margin = int(np.ceil(limit * float(np.abs(offsets).max()) / shrink)) + 2
    prepared = local_contrast if contrast else _prepared
    reference = prepared(lf, (v, u), shrink)
    views = np.empty((len(offsets), reference.shape[0], reference.shape[1] + 2 * margin), np.float32)

    def fill(index: int) -> None:
        down, across = places[index]
        view = prepared(lf, (v + down, u + across), shrink)
        views[index] = np.pad(view, ((0, 0), (margin, margin)), "edge")

    with using(engine) as used:
        used.each(fill, range(len(views)))
    return Probe(reference, views, offsets, shrink, margin)


def match(
    probe: Probe,
    planes: NDArray[np.float64],
    engine: Engine,
    order: Order = IN_ORDER,
    *,
    halves: bool = False,
) -> Match:
    """Find the best plane per pixel.

    Parameters
    ----------
    probe
        Views.
    planes
        (K,) disparities, px per view step of the whole views, ascending, evenly spaced.
    engine
        Engine.
    order
        How the grid is taken.
    halves
        Also compare half of the views at a time: beside an occluder, one half sees what is behind it.
    """
    grid = probe.ordered(order)
    step = float(planes[1] - planes[0])
    sides = np.sign(np.rint(grid)).astype(np.int32)
    down, across = (np.outer(-planes / probe.shrink, grid[:, axis]) for axis in (0, 1))
    best, costs = engine.match(
        probe.reference,
        probe.views,
        (down, across),
        sides,
        _apertures(sides, halves),
        margin=probe.margin,
        apart=int(np.ceil(PEAK * probe.unit / step)),
        limit=LIMIT,
    )
    disparity = planes[0] + step * (best + _parabola(costs[1], costs[0], costs[2]))
    return Match(disparity.astype(np.float32), costs[0], costs[3])


def _ring_offsets(lf: LightField, rings: Sequence[float]) -> NDArray[np.int32]:
    """Grid offsets (N, 2) of views in eight directions, on each ring."""
    found = (_first_present(lf, direction, ring) for ring in rings for direction in _DIRECTIONS)
    offsets = list(dict.fromkeys(offset for offset in found if offset))
    if not offsets:
        raise LightFieldError(
            f"{lf.name}: no view in line with the reference view is present; expected views beside, above or "
            "diagonally from it; read more views"
        )
    return np.array(offsets, np.int32)


def _first_present(lf: LightField, direction: tuple[int, int], ring: float) -> tuple[int, int] | None:
    """Offset of the view that far out in a direction; if it is absent, of the next one inwards."""
    v, u = lf.centre
    room = (
        v if direction[0] < 0 else lf.shape[0] - 1 - v,
        u if direction[1] < 0 else lf.shape[1] - 1 - u,
    )
    if any(sign and not space for sign, space in zip(direction, room, strict=True)):
        return None
    for share in np.arange(ring, 0, -1 / max(room)):
        down, across = (
            sign * max(1, round(share * space)) for sign, space in zip(direction, room, strict=True)
        )
        if lf.present is None or lf.present[v + down, u + across]:
            return down, across
    return None


def _apertures(sides: NDArray[np.int32], halves: bool) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Weight per sample of each aperture, and its penalty; an aperture of all views or none never wins."""
    count = len(sides)
    weights, penalty = [1 / (9 * count)], [0.0]
    for axis, side in ((1, 1), (1, -1), (0, 1), (0, -1)) if halves else ():
        half = int((side * sides[:, axis] <= 0).sum())
        weights.append(_PARTIAL[0] / (9 * max(half, 1)))
        penalty.append(_PARTIAL[1] if 0 < half < count else np.inf)
    return np.array(weights, np.float32), np.array(penalty, np.float32)


def _parabola(
    before: NDArray[np.float32], at: NDArray[np.float32], after: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Minimum of the parabola through three planes, −0.5 to 0.5 plane from the middle one."""
    bend = before - 2 * at + after
    offset = np.divide(0.5 * (before - after), bend, out=np.zeros_like(at), where=bend > 1e-6)
    return np.asarray(np.clip(offset, -0.5, 0.5), np.float32)


def _prepared(lf: LightField, index: tuple[int, int], shrink: int) -> NDArray[np.float32]:
    """Grey levels of a view, shrunk, then smoothed by (1, 2, 1)/4: then sampling hardly blurs it."""
    samples = lf.views[index]
    if shrink > 1:
        samples = _summed(_summed(samples, shrink, 0), shrink, 1)
    grey = luma(samples) * np.float32(255 / lf.full_scale / shrink**2)
    padded = np.pad(grey, 1, "edge")
    columns: NDArray[np.float32] = (padded[:-2] + 2 * padded[1:-1] + padded[2:]) / np.float32(4)
    return np.asarray((columns[:, :-2] + 2 * columns[:, 1:-1] + columns[:, 2:]) / np.float32(4))


def _summed(samples: NDArray[Any], shrink: int, axis: int) -> NDArray[Any]:
    """Sums of so many neighbouring samples along an axis."""
    length = samples.shape[axis] // shrink
    parts = [
        samples[(slice(None),) * axis + (slice(first, length * shrink, shrink),)] for first in range(shrink)
    ]
    wide = np.uint32 if samples.dtype.kind == "u" else np.float32
    total: NDArray[Any] = np.empty(parts[0].shape, wide)
    # Pixels that are not neighbours any more are added channel by channel, not three samples at a time.
    channels = range(samples.shape[2]) if axis == 1 else [slice(None)]
    for c in channels:
        np.add(parts[0][..., c], parts[1][..., c], out=total[..., c], dtype=wide)
        for part in parts[2:]:
            total[..., c] += part[..., c]
    return total


def local_contrast(lf: LightField, index: tuple[int, int], shrink: int) -> NDArray[np.float32]:
    """Difference of a prepared view to its surroundings, as a share of those, in 1/100."""
    grey = _prepared(lf, index, shrink)
    around = box_mean(grey, _SURROUNDINGS, np.float32)
    return np.asarray(100 * (grey - around) / (around + _DARKNESS), np.float32)
