"""The oracle of a first look and of pictures from many views, pixel by pixel.

It shares no code with `lfdepth`.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

SURFACE_JUMP = 0.25  # px per view step from which on neighbours are of two surfaces


def between(image: Array, y: float, x: float) -> Array:
    """An image (H, W, ...) at a place between pixels; beyond the border the nearest one."""
    total = np.zeros(image.shape[2:])
    top, left = int(np.floor(y)), int(np.floor(x))
    for row, column in product((top, top + 1), (left, left + 1)):
        weight = (1 - abs(y - row)) * (1 - abs(x - column))
        inside = min(max(row, 0), image.shape[0] - 1), min(max(column, 0), image.shape[1] - 1)
        total = total + weight * image[inside].astype(np.float64)
    return np.asarray(total)


def matching_costs(
    reference: Array,
    views: Array,
    shifts: tuple[Array, Array],
    sides: Array,
    apertures: tuple[Array, Array],
    limit: float,
) -> Array:
    """Costs (K, H, W) of all planes; `views` (N, H, W) have no margin."""
    height, width = reference.shape
    count, (weights, penalties) = len(shifts[0]), apertures
    apart = np.empty((count, len(views), height, width))
    for k, i, y, x in np.ndindex(*apart.shape):
        sample = between(views[i], y + shifts[0][k, i], x + shifts[1][k, i])
        apart[k, i, y, x] = min(abs(float(sample) - float(reference[y, x])), limit)
    out = np.full((count, height, width), np.inf)
    for k, a, y, x in np.ndindex(count, len(weights), height, width):
        total = 0.0
        for i, dy, dx in product(range(len(views)), (-1, 0, 1), (-1, 0, 1)):
            down, across = sides[i]
            if (False, across > 0, across < 0, down > 0, down < 0)[a]:
                continue
            total += apart[k, i, min(max(y + dy, 0), height - 1), min(max(x + dx, 0), width - 1)]
        out[k, y, x] = min(out[k, y, x], total * weights[a] + penalties[a])
    return out


def best_planes(costs: Array, apart: int) -> tuple[Array, Array]:
    """Best plane, and its cost, those before and after it, and the least more than `apart` away."""
    planes, height, width = costs.shape
    best, beside = np.empty((height, width), int), np.empty((4, height, width))
    for y, x in np.ndindex(height, width):
        line = list(costs[:, y, x])
        k = line.index(min(line))
        far = [cost for i, cost in enumerate(line) if abs(i - k) > apart]
        best[y, x] = k
        beside[:, y, x] = line[k], line[max(k - 1, 0)], line[min(k + 1, planes - 1)], min([np.inf, *far])
    return best, beside


def seen(disparity: Array, offset: tuple[float, float], plane: float) -> Array:
    """What a view shows of a map as seen from a plane; −inf where nothing lands.

    Each pixel lands on one; where neighbours of one surface land two apart, the farther one does so between.
    Places are single precision, which decides which pixel is nearest where two are alike.
    """
    height, width = disparity.shape
    out = np.full(disparity.shape, -np.inf)

    def place(y: int, x: int) -> tuple[int, int]:
        moved = disparity[y, x] - np.float32(plane)
        places = (np.float32(at) - np.float32(o) * moved for at, o in zip((y, x), offset, strict=True))
        row, column = (int(np.floor(each + np.float32(0.5))) for each in places)
        return row, column

    def put(row: int, column: int, level: float) -> None:
        if 0 <= row < height and 0 <= column < width:
            out[row, column] = max(out[row, column], level)

    for y, x in np.ndindex(height, width):
        (row, column), here = place(y, x), float(disparity[y, x])
        put(row, column, here)
        for axis, before in enumerate(((y - 1, x), (y, x - 1))):
            if min(before) < 0 or (row, column)[axis] - place(*before)[axis] != 2:
                continue
            there = float(disparity[before])
            if abs(here - there) < SURFACE_JUMP:
                put(row - (axis == 0), column - (axis == 1), min(here, there))
    return out


def gathered(
    view: Array, offset: tuple[float, float], disparity: Array, front: Array, limit: Array
) -> tuple[Array, Array]:
    """A view where it shows the points of a map (H, W, C), and where it does (H, W)."""
    height, width, channels = view.shape
    out, shown = np.zeros((height, width, channels)), np.zeros((height, width))
    for y, x in np.ndindex(height, width):
        row, column = (at - step * float(disparity[y, x]) for at, step in zip((y, x), offset, strict=True))
        if not (0 <= row <= height - 1 and 0 <= column <= width - 1):
            continue
        touched = product(
            {int(np.floor(row)), int(np.ceil(row))}, {int(np.floor(column)), int(np.ceil(column))}
        )
        if all(front[p] <= limit[y, x] for p in touched):
            out[y, x], shown[y, x] = between(view, row, column), 1
    return out, shown


def window_means(
    views: Array, present: Array, points: Array, disparity: Array, reach: int, white: float
) -> tuple[Array, Array]:
    """Means (V·U, N, C) of windows where views show points, and whether no sample there is clipped."""
    rows, columns, height, width, channels = views.shape
    means = np.zeros((rows * columns, len(points), channels))
    usable = np.zeros(means.shape, bool)
    for i, j, n in product(range(rows), range(columns), range(len(points))):
        y = round(points[n, 0] - (i - rows // 2) * disparity[n])
        x = round(points[n, 1] - (j - columns // 2) * disparity[n])
        fits = reach <= y < height - reach and reach <= x < width - reach
        if not (fits and present[i, j]):
            continue
        window = views[i, j, y - reach : y + reach + 1, x - reach : x + reach + 1].astype(np.float64)
        means[i * columns + j, n] = window.mean(axis=(0, 1))
        usable[i * columns + j, n] = window.min(axis=(0, 1)) > 0
        usable[i * columns + j, n] &= window.max(axis=(0, 1)) < white
    return means, usable
