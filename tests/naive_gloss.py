"""The oracle of the gloss block: high-passed views, the probe and the tidied mask, in plain loops.

It shares no code with `lfdepth` and none of its numbers.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

import naive_photo

Array = NDArray[Any]

RADIUS, MIDDLE = 3, 128  # px of the mean that is subtracted; the level of no difference
CELL, FEWEST_VIEWS, FEWEST_PROBED = 8, 9, 5
ALONG, WINDOW, PROBED_RISE = 3, (1, 12), 0.07
AREA, HOLE, GROW = 30, 200, 2
GAP, COARSE = 4, 3  # cells between boxes that are one; every so many planes tell whether one is worth all
RISE, WHOLE = 0.1, 255  # of a peak, as a share of the views, that is gloss; parts that shares are kept in


def high_passed(views: Array) -> Array:
    """Views less their local mean, plus mid-grey: uint8 of uint8 views, else float32, whole 1/UNIT levels."""
    unit = 1 if views.dtype == np.uint8 else naive_photo.UNIT
    levels = naive_photo.levels(views) // (naive_photo.UNIT // unit)
    radius, (height, width) = RADIUS, views.shape[2:4]
    area, out = (2 * radius + 1) ** 2, np.empty_like(levels)
    for y, x in product(range(height), range(width)):
        total = np.zeros((*views.shape[:2], views.shape[4]), np.int64)
        for dy, dx in product(range(-radius, radius + 1), repeat=2):
            total += levels[:, :, min(max(y + dy, 0), height - 1), min(max(x + dx, 0), width - 1)]
        change = (2 * (area * levels[:, :, y, x] - total) + area) // (2 * area)
        out[:, :, y, x] = np.clip(change + MIDDLE * unit, 0, 255 * unit)
    return out.astype(np.uint8) if unit == 1 else (out / (255 * unit)).astype(np.float32)


def probed(present: Array) -> Array:
    """Present ones of the reference view, the corners and the middles of the sides of a grid."""
    chosen = np.zeros_like(present)
    middle = [count // 2 for count in present.shape]
    reach = [min(place, count - 1 - place) for place, count in zip(middle, present.shape, strict=True)]
    for di, dj in product((-1, 0, 1), repeat=2):
        i, j = middle[0] + di * reach[0], middle[1] + dj * reach[1]
        chosen[i, j] = present[i, j]
    return chosen


def suspects(views: Array, thresholds: Array, texture: Array, planes: Array, present: Array) -> Array:
    """Cells where the mean rise of the peak is large, and all beside them."""
    height, width = views.shape[2:4]
    chosen, filtered = probed(present), high_passed(views)
    cells = np.zeros((-(-height // CELL), -(-width // CELL)), bool)
    if present.sum() < FEWEST_VIEWS or chosen.sum() < FEWEST_PROBED:
        return cells
    rows = [min(CELL * i + CELL // 2, height - 1) for i in range(len(cells))]
    peaks = [np.zeros((len(rows), width)), np.zeros((len(rows), width))]
    for plane, (peak, version) in product(planes, zip(peaks, (views, filtered), strict=True)):
        share = naive_photo.photo_consistency(version, plane, thresholds, chosen)
        np.maximum(peak, _mean(share[rows], 0, ALONG), out=peak)
    rise = _mean((peaks[1] - peaks[0]) * texture[rows], *WINDOW)
    for i, j in np.argwhere(rise > PROBED_RISE):
        cells[i, j // CELL] = True
    return spread(cells, corners=True)


def _mean(image: Array, down: int, across: int) -> Array:
    """Mean over a window, the border repeated."""
    height, width = image.shape
    out = np.empty(image.shape)
    for y, x in np.ndindex(image.shape):
        rows = np.clip(range(y - down, y + down + 1), 0, height - 1)
        columns = np.clip(range(x - across, x + across + 1), 0, width - 1)
        out[y, x] = image[np.ix_(rows, columns)].mean()
    return out


def spread(mask: Array, corners: bool) -> Array:
    """A mask, and every pixel beside it."""
    out = np.zeros_like(mask)
    for y, x in np.argwhere(mask):
        for dy, dx in product((-1, 0, 1), repeat=2):
            inside = 0 <= y + dy < mask.shape[0] and 0 <= x + dx < mask.shape[1]
            if inside and (corners or dy == 0 or dx == 0):
                out[y + dy, x + dx] = True
    return out


def regions(mask: Array) -> list[set[tuple[int, int]]]:
    """Pixels of a mask connected by their sides."""
    left = {(int(y), int(x)) for y, x in np.argwhere(mask)}
    found = []
    while left:
        region, edge = set(), [left.pop()]
        while edge:
            y, x = edge.pop()
            region.add((y, x))
            beside = left & {(y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)}
            left -= beside
            edge.extend(beside)
        found.append(region)
    return found


def tidied(mask: Array) -> Array:
    """Opened by 3×3 px, without small regions, grown, small holes filled; what is outside does not matter."""
    opened = np.zeros_like(mask)
    for y, x in np.ndindex(mask.shape):
        square = slice(max(y - 1, 0), y + 2), slice(max(x - 1, 0), x + 2)
        if mask[square].all():
            opened[square] = True
    kept = np.zeros_like(mask)
    for region in regions(opened):
        for y, x in region if len(region) >= AREA else ():
            kept[y, x] = True
    for _ in range(GROW):
        kept = spread(kept, corners=False)
    for region in regions(~kept):
        for y, x in region if len(region) <= HOLE else ():
            kept[y, x] = True
    return kept


def boxes(cells: Array) -> list[tuple[int, int, int, int]]:
    """(Top, bottom, left, right) of groups of cells; those with fewer than `GAP` cells between are one."""
    found: list[tuple[int, int, int, int]] = []
    for region in regions(cells):
        y, x = zip(*region, strict=True)
        box = min(y), max(y) + 1, min(x), max(x) + 1
        while near := [other for other in found if _gap(box, other) < GAP]:
            found.remove(near[0])
            top, bottom, left, right = zip(box, near[0], strict=True)
            box = min(top), max(bottom), min(left), max(right)
        found.append(box)
    return found


def _gap(a: tuple[int, ...], b: tuple[int, ...]) -> int:
    return max(max(a[0], b[0]) - min(a[1], b[1]), max(a[2], b[2]) - min(a[3], b[3]))


def glossy(own: Array, fine: Array, cells: Array) -> Array:
    """Pixels that high-passed views decide: shares (K, H, W) in whole parts of the views', and of those."""
    rising, covered = (np.zeros(own.shape[1:], bool) for _ in "12")
    for box in boxes(cells):
        top, bottom, left, right = (CELL * side for side in box)
        part = slice(top, bottom), slice(left, right)
        coarse = _rises(own[::COARSE], fine[::COARSE])
        if coarse[part].sum() >= AREA:
            covered[part], rising[part] = True, _rises(own, fine)[part]
    return np.asarray(tidied(rising) & covered)


def _rises(own: Array, fine: Array) -> Array:
    return np.asarray(fine.max(axis=0) - own.max(axis=0) > RISE * WHOLE)
