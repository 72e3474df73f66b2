"""Maps of several views: carried from one to another, supported by colours, held against each other."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.base import Bool, Float
from lfdepth.engines.layout import DISPARITY_PARTS, SURFACE_JUMP
from lfdepth.engines.plain.edges import Views, samples
from lfdepth.engines.plain.photo import Surfaces
from lfdepth.engines.plain.sampling import inside

Whole = NDArray[np.int64]
Counts = NDArray[np.int32]


def carry(disparity: Float, beside: Float, seen: Float, offset: tuple[float, float]) -> tuple[Float, Float]:
    """Sharpen what a view shows of a map, `seen`; what is beside the nearest pixel it comes from."""
    height, width = disparity.shape
    y, x = np.mgrid[:height, :width].astype(np.float32)
    down, across = (np.float32(each) for each in offset)
    shown = np.isfinite(seen)
    carried = np.where(shown, seen, np.float32(0))
    going = shown.copy()
    for _ in range(2):
        from_y, from_x = y + down * carried, x + across * carried
        going &= inside(from_y, from_x, (height, width))
        top = np.clip(from_y.astype(np.int64), 0, height - 2)
        left = np.clip(from_x.astype(np.int64), 0, width - 2)
        a, b, c, e = (disparity[top + i, left + k] for i, k in product((0, 1), (0, 1)))
        around = np.stack([a, b, c, e])
        going &= around.max(axis=0) - around.min(axis=0) < np.float32(SURFACE_JUMP)
        part_y, part_x = from_y - top, from_x - left
        upper, lower = a + part_x * (b - a), c + part_x * (e - c)
        carried = np.where(going, upper + part_y * (lower - upper), carried).astype(np.float32)
    half = np.float32(0.5)
    row = np.clip(np.floor(y + down * carried + half).astype(np.int64), 0, height - 1)
    column = np.clip(np.floor(x + across * carried + half).astype(np.int64), 0, width - 1)
    unknown = np.float32(-np.inf)
    return np.where(shown, carried, unknown), np.where(shown, beside[row, column], np.float32(0))


def support(
    views: Views,
    surfaces: Surfaces,
    places: Whole,
    candidates: Float,
    thresholds: Float,
    margin: float,
) -> Float:
    """How far views agree with candidates of disparity at places."""
    found = np.full(candidates.shape, -1, np.float32)
    scale = 255 / views.full_scale
    for k in range(candidates.shape[1]):
        asked = np.isfinite(candidates[:, k])
        y, x = places[asked].T
        d = candidates[asked, k]
        own = views.reference[y, x].astype(np.float64) * scale
        horizon = (d + np.float32(margin)) * np.float32(DISPARITY_PARTS)
        total, count = np.zeros(len(d)), np.zeros(len(d))
        for view, to_y, to_x, shown, colour in samples(views, y, x, d):
            row, column = (np.where(shown, at + 0.5, 0).astype(np.int64) for at in (to_y, to_x))
            sees = shown & (surfaces.nearest[view][row, column] <= horizon)
            apart = np.abs(colour * scale - own).mean(axis=1) / thresholds[y, x]
            total += sees / (1 + apart**2)
            count += sees
        found[asked, k] = np.where(count > 1, total / np.maximum(count, 1), 0)
    return found


def agree(
    maps: Float, own: int, partners: Whole, steps: NDArray[np.float64], tolerance: float
) -> tuple[Float, Counts, Counts]:
    """A map that holds against its partners', and how many of them are for and against each pixel."""
    there = _Partners(maps, partners, steps, np.float32(tolerance))
    before = maps[own]
    settled = before.copy()
    yes, no = there.held(before)
    asked = no > yes
    best = yes - no
    for other, usable in there.candidates(before):
        far = asked & usable & (np.abs(other - before) > np.float32(tolerance))
        more, less = there.held(other)
        better = far & (more - less > best)
        for target, value in ((settled, other), (best, more - less), (yes, more), (no, less)):
            target[better] = value[better]
    return settled, yes.astype(np.int32), no.astype(np.int32)


class _Partners:
    """The maps that one is held against."""

    def __init__(
        self, maps: Float, partners: Whole, steps: NDArray[np.float64], tolerance: np.float32
    ) -> None:
        self.maps, self.partners, self.steps, self.tolerance = maps, partners, steps, tolerance
        self.size = maps.shape[1:]

    def landing(self, disparity: Float, i: int) -> tuple[NDArray[Any], NDArray[Any], Bool]:
        """Rows and columns where pixels land in a partner's map, and whether that is inside it."""
        y, x = np.mgrid[: self.size[0], : self.size[1]]
        to_y, to_x = (
            at - step * disparity.astype(np.float64) for at, step in zip((y, x), self.steps[i], strict=True)
        )
        shown = inside(to_y, to_x, self.size)
        return np.where(shown, to_y, 0), np.where(shown, to_x, 0), shown

    def held(self, disparity: Float) -> tuple[Whole, Whole]:
        """How many agree, and how many show something farther."""
        yes, no = np.zeros(self.size, np.int64), np.zeros(self.size, np.int64)
        for i, partner in enumerate(self.partners):
            to_y, to_x, shown = self.landing(disparity, i)
            top = np.minimum(to_y.astype(np.int64), self.size[0] - 2)
            left = np.minimum(to_x.astype(np.int64), self.size[1] - 2)
            around = np.stack([self.maps[partner][top + i, left + k] for i, k in product((0, 1), (0, 1))])
            same = (np.abs(around - disparity) <= self.tolerance).any(axis=0)
            yes += shown & same
            no += shown & ~same & (around.max(axis=0) < disparity)
        return yes, no

    def candidates(self, disparity: Float) -> Iterator[tuple[Float, Bool]]:
        """Maps of other values, and where they are any: neighbours, then what partners show."""
        height, width = self.size
        y, x = np.mgrid[:height, :width]
        for down, across in product((-1, 0, 1), (-1, 0, 1)):
            row, column = y + down, x + across
            usable = inside(row, column, self.size)
            yield disparity[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)], usable
        for i, partner in enumerate(self.partners):
            to_y, to_x, shown = self.landing(disparity, i)
            yield self.maps[partner][(to_y + 0.5).astype(np.int64), (to_x + 0.5).astype(np.int64)], shown
