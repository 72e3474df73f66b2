"""Pixels beside depth edges decided by what the views show, and how far views differ where planes fit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lfdepth.engines.base import Bool, EdgeColours, Float
from lfdepth.engines.layout import DISPARITY_PARTS, JUMP_SHARE
from lfdepth.engines.plain.photo import Surfaces
from lfdepth.engines.plain.sampling import bilinear, inside
from lfdepth.lightfield import LightField

_FRONT_REACH, _FRONT_BLUR = 2, 1.5  # px: where the foreground's colour is looked for, and its weights' spread
_FRONT_GATE = 0.25  # of a jump, within which a pixel is the nearer surface's
_FRINGE = 0.05  # weight of foreground pixels that touch the background: they may be mixed themselves
_FEWEST_VIEWS = 3
_SAME_COLOUR = 4.0  # 8-bit levels squared per channel
_NORMAL = np.pi / 2  # a normal spread's variance over its squared mean deviation

_EXTREMES = ndimage.maximum_filter, ndimage.minimum_filter

Levels = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Views:
    """The views as they are, (V, U, H, W, C); `others` are those present but for the reference view."""

    views: NDArray[Any]
    full_scale: float
    reference: NDArray[Any]
    present: Bool
    others: Bool
    offsets: NDArray[np.float64]


def prepare(lf: LightField) -> Views:
    """The views of a light field."""
    others = lf.available.copy()
    others[lf.centre] = False
    return Views(lf.views, lf.full_scale, lf.reference, lf.available, others, lf.offsets)


def samples(
    views: Views, y: NDArray[Any], x: NDArray[Any], disparity: NDArray[Any]
) -> Iterator[tuple[tuple[int, int], NDArray[Any], NDArray[Any], Bool, Levels]]:
    """For every other view: where it shows some pixels (N,), whether it does, and their colours (N, C)."""
    for v, u in np.argwhere(views.others).tolist():
        to_y, to_x = (
            at - step * disparity.astype(np.float64)
            for at, step in zip((y, x), views.offsets[v, u], strict=True)
        )
        image = views.views[v, u]
        yield (v, u), to_y, to_x, inside(to_y, to_x, image.shape[:2]), bilinear(image, to_y, to_x)


def residuals(views: Views, y: NDArray[Any], x: NDArray[Any], planes: NDArray[np.float64]) -> Float:
    """Least over planes of the mean difference of some pixels to all views that show them."""
    own = views.reference[y, x].astype(np.float64)
    lowest = np.full(len(y), np.inf)
    for plane in planes:
        total, count = np.zeros(len(y)), np.zeros(len(y))
        for _, _, _, shown, colour in samples(views, y, x, np.full(len(y), plane)):
            total += shown * np.abs(colour - own).mean(axis=1)
            count += shown
        lowest = np.fmin(lowest, np.divide(total, count, out=np.full(len(y), np.inf), where=count > 0))
    return lowest.astype(np.float32)


def window_means(
    views: Views, points: NDArray[np.int64], disparity: NDArray[np.float64], reach: int
) -> tuple[Float, Bool]:
    """Mean levels (V·U, N, C) of windows about the nearest whole px where views show points; their use."""
    grid_v, grid_u, height, width, channels = views.views.shape
    means = np.zeros((grid_v * grid_u, len(points), channels), np.float32)
    usable = np.zeros(means.shape, np.bool_)
    around = np.arange(-reach, reach + 1)
    for n, (v, u) in enumerate(np.ndindex(grid_v, grid_u)):
        place = np.rint(points - disparity[:, None] * views.offsets[v, u]).astype(np.int64)
        inner = ((place >= reach) & (place < np.array([height, width]) - reach)).all(axis=1)
        inner &= views.present[v, u]
        rows, columns = (place[inner, axis, None] + around for axis in (0, 1))
        windows = views.views[v, u][rows[:, :, None], columns[:, None, :]]
        means[n, inner] = windows.mean(axis=(1, 2), dtype=np.float64)
        usable[n, inner] = ((windows > 0) & (windows < views.full_scale)).all(axis=(1, 2))
    return means, usable


def decide(
    views: Views,
    disparity: Float,
    surfaces: Surfaces,
    thresholds: Float,
    found: Bool,
    jump: float,
    spread: float,
    inertia: float,
) -> Float:
    """Decide the pixels beside edges: which of two surfaces each belongs to, by its colour."""
    near, far = (each(disparity, 3, mode="nearest") for each in _EXTREMES)
    at_edge = edges(disparity, near, far, jump)
    found |= at_edge
    y, x = np.nonzero(at_edge)
    decided = disparity.copy()
    if len(y) == 0:
        return decided
    own_near, own_far, here = near[y, x], far[y, x], disparity[y, x]
    levels = views.reference.astype(np.float64) * (255 / views.full_scale)
    own, channels = levels[y, x], levels.shape[2]
    front, front_spread, has_front = _front_colour(disparity, near, far, levels, y, x)
    behind, sees = _colours(views, y, x, own_far, surfaces, own_near)
    back, back_spread = _back_colour(behind, sees)
    apart = ((front - back) ** 2).sum(axis=1)
    decidable = has_front & (sees.sum(axis=0) >= _FEWEST_VIEWS) & (apart >= _SAME_COLOUR * channels)

    is_front = here > np.float32(0.5) * (own_near + own_far)
    all_colours, shown = _colours(views, y, x, own_near)
    colours, counted = np.where(is_front[:, None], all_colours, behind), np.where(is_front, shown, sees)
    agree = counted & (np.abs(colours - own).sum(axis=2) < channels * thresholds[y, x])
    doubt = 1 + inertia * (agree.sum(axis=0) / np.maximum(counted.sum(axis=0), 1))
    least = spread**2 * apart + 1
    to_back = ((own - back) ** 2).sum(axis=1) * (front_spread + least)
    to_front = ((own - front) ** 2).sum(axis=1) * (back_spread + least)
    leaves, joins = is_front & (to_back * doubt < to_front), ~is_front & (to_front * doubt <= to_back)
    new = np.where(decidable & leaves, own_far, np.where(decidable & joins, own_near, here))
    decided[y, x] = new
    return decided


def edge_colours(
    views: Views,
    disparity: Float,
    places: NDArray[np.int64],
    sides: Float,
    surfaces: Surfaces,
    thresholds: Float,
) -> EdgeColours:
    """Both surfaces' colours at some pixels, and how many views agree with either."""
    near, far = (each(disparity, 3, mode="nearest") for each in _EXTREMES)
    y, x = places.T
    levels = views.reference.astype(np.float64) * (255 / views.full_scale)
    own, limit = levels[y, x], levels.shape[2] * thresholds[y, x]
    front, front_spread, has_front = _front_colour(disparity, near, far, levels, y, x)
    behind, sees = _colours(views, y, x, sides[:, 1], surfaces, sides[:, 0])
    back, back_spread = _back_colour(behind, sees)
    ahead, shown = _colours(views, y, x, sides[:, 0])
    hides = _colours(views, y, x, sides[:, 1])[1] & ~sees
    at_near, at_far = (np.abs(each - own).sum(axis=2) < limit for each in (ahead, behind))
    counted = sees, sees & shown & at_near, sees & at_far, hides, hides & shown & at_near, shown
    spreads = np.stack([np.where(has_front, front_spread, -1), back_spread], axis=1)
    counts = np.stack([each.sum(axis=0) for each in counted], axis=1)
    return EdgeColours(*(np.asarray(each, np.float32) for each in (front, back, spreads, counts)))


def edges(disparity: Float, near: Float, far: Float, jump: float) -> Bool:
    """Pixels, but for the outermost, beside a jump: a steep slope changes twice as far within 5×5 px."""
    highest, lowest = (each(disparity, 5, mode="nearest") for each in _EXTREMES)
    change = near - far
    found = (change >= np.float32(jump)) & (change >= np.float32(JUMP_SHARE) * (highest - lowest))
    outermost = np.ones(disparity.shape, np.bool_)
    outermost[1:-1, 1:-1] = False
    return np.asarray(found & ~outermost)


def _front_colour(
    disparity: Float, near: Float, far: Float, levels: Levels, y: NDArray[Any], x: NDArray[Any]
) -> tuple[Levels, Levels, Bool]:
    """Mean colour (N, C) of the nearer surface around, its summed variance, and whether there is any."""
    height, width = disparity.shape
    own_near, own_far = near[y, x], far[y, x]
    middle = np.float32(0.5) * (own_near + own_far)
    reach = range(-_FRONT_REACH, _FRONT_REACH + 1)
    weights, colours = [], []
    for dy, dx in product(reach, reach):
        if dy == dx == 0:
            continue
        there = np.clip(y + dy, 0, height - 1), np.clip(x + dx, 0, width - 1)
        takes = (y + dy >= 1) & (y + dy < height - 1) & (x + dx >= 1) & (x + dx < width - 1)
        takes &= np.abs(disparity[there] - own_near) <= np.float32(_FRONT_GATE) * (own_near - own_far)
        weight = np.exp(-(dy**2 + dx**2) / (2 * _FRONT_BLUR**2)) * np.where(far[there] < middle, _FRINGE, 1)
        weights.append(weight * takes)
        colours.append(levels[there])
    total = np.sum(weights, axis=0)
    share = np.array(weights) / np.where(total > 0, total, 1)
    mean = np.einsum("kn,knc->nc", share, np.array(colours))
    variance = np.einsum("kn,knc->n", share, (np.array(colours) - mean) ** 2)
    return mean, variance, total > 0


def _colours(
    views: Views,
    y: NDArray[Any],
    x: NDArray[Any],
    disparity: Float,
    surfaces: Surfaces | None = None,
    near: Float | None = None,
) -> tuple[Levels, Bool]:
    """Colours (M, N, C) of N pixels in M other views in 8-bit levels, and which of these show them.

    With `surfaces`, only where nothing lies nearer than halfway between `disparity` and `near`.
    """
    colours, shown = [], []
    for view, to_y, to_x, is_inside, colour in samples(views, y, x, disparity):
        seen = is_inside
        if surfaces is not None and near is not None:
            horizon = (disparity + np.float32(0.5) * (near - disparity)) * np.float32(DISPARITY_PARTS)
            rows, columns = ((np.where(is_inside, at, 0) + 0.5).astype(np.int64) for at in (to_y, to_x))
            seen = is_inside & (surfaces.nearest[view][rows, columns] <= horizon)
        colours.append(colour * (255 / views.full_scale))
        shown.append(seen)
    return np.array(colours), np.array(shown)


def _back_colour(colours: Levels, sees: Bool) -> tuple[Levels, Levels]:
    """Mean colour (N, C) over the views that see past the edge, and its summed squared spread."""
    count = np.maximum(sees.sum(axis=0), 1)[:, None]
    mean = (colours * sees[..., None]).sum(axis=0) / count
    deviation = (np.abs(colours - mean) * sees[..., None]).sum(axis=0) / count
    return mean, (_NORMAL * deviation**2).sum(axis=1)
