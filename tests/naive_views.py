"""Maps of several views, pixel by pixel: the oracle of `Engine.carry`, `support` and `agree`."""

from __future__ import annotations

from math import floor, isfinite

import numpy as np

import fields

Array = fields.Array
UNKNOWN = -np.inf


def _corners(y: float, x: float, size: tuple[int, int]) -> list[tuple[int, int]]:
    top, left = min(int(y), size[0] - 2), min(int(x), size[1] - 2)
    return [(top + i, left + k) for i in (0, 1) for k in (0, 1)]


def _inside(y: float, x: float, size: tuple[int, int]) -> bool:
    return 0 <= y <= size[0] - 1 and 0 <= x <= size[1] - 1


def carry(disparity: Array, beside: Array, seen: Array, offset: tuple[float, float]) -> tuple[Array, Array]:
    size = disparity.shape[0], disparity.shape[1]
    carried, other = np.full(size, UNKNOWN), np.zeros(size)
    for y, x in np.argwhere(np.isfinite(seen)):
        d = float(seen[y, x])
        for _ in range(2):
            from_y, from_x = y + offset[0] * d, x + offset[1] * d
            if not _inside(from_y, from_x, size):
                break
            corners = _corners(from_y, from_x, size)
            values = np.array([disparity[each] for each in corners])
            if np.ptp(values) >= 0.25:
                break
            part_y, part_x = from_y - corners[0][0], from_x - corners[0][1]
            weights = np.outer([1 - part_y, part_y], [1 - part_x, part_x]).ravel()
            d = float(weights @ values)
        carried[y, x] = d
        row, column = floor(y + offset[0] * d + 0.5), floor(x + offset[1] * d + 0.5)
        other[y, x] = beside[min(max(row, 0), size[0] - 1), min(max(column, 0), size[1] - 1)]
    return carried, other


def support(
    views: Array,
    at: tuple[int, int],
    offsets: Array,
    maps: Array,
    places: Array,
    candidates: Array,
    thresholds: Array,
    margin: float,
) -> Array:
    """`views` (V, U, H, W, C) in 8-bit levels; `maps` (V, U, H, W), NaN: unknown."""
    size = views.shape[2:4]
    found = np.full(candidates.shape, -1.0)
    for n, (y, x) in enumerate(places):
        for k, d in enumerate(candidates[n]):
            if not isfinite(d):
                continue
            likeness = []
            for v, u in np.ndindex(*views.shape[:2]):
                down, across = offsets[v, u] - offsets[at]
                to_y, to_x = y - down * d, x - across * d
                if (v, u) == at or not _inside(to_y, to_x, size):
                    continue
                there = maps[v, u, int(to_y + 0.5), int(to_x + 0.5)]
                if np.isfinite(there) and np.trunc(1000 * there) > 1000 * (d + margin):
                    continue
                top, left = min(int(to_y), size[0] - 2), min(int(to_x), size[1] - 2)
                fy, fx = to_y - top, to_x - left
                part = views[v, u, top : top + 2, left : left + 2]
                colour = np.einsum("i,j,ijc->c", [1 - fy, fy], [1 - fx, fx], part)
                apart = np.abs(colour - views[at][y, x]).mean() / thresholds[y, x]
                likeness.append(1 / (1 + apart**2))
            found[n, k] = np.mean(likeness) if len(likeness) > 1 else 0.0
    return found


def agree(
    maps: Array, own: int, partners: Array, steps: Array, tolerance: float
) -> tuple[Array, Array, Array]:
    size = maps.shape[1], maps.shape[2]

    def held(y: int, x: int, d: float) -> tuple[int, int]:
        yes = no = 0
        for partner, (down, across) in zip(partners, steps, strict=True):
            to_y, to_x = y - down * d, x - across * d
            if _inside(to_y, to_x, size):
                values = np.array([maps[partner][each] for each in _corners(to_y, to_x, size)])
                same = bool((abs(values - d) <= tolerance).any())
                yes, no = yes + same, no + (not same and values.max() < d)
        return yes, no

    settled = maps[own].copy()
    counts = np.zeros((2, *size), int)
    for y, x in np.ndindex(*size):
        d = maps[own, y, x]
        best = held(y, x, d)
        if best[1] > best[0]:
            around = maps[own, max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2].ravel().tolist()
            for partner, (down, across) in zip(partners, steps, strict=True):
                if _inside(y - down * d, x - across * d, size):
                    around.append(maps[partner, int(y - down * d + 0.5), int(x - across * d + 0.5)])
            for other in around:
                if abs(other - d) > tolerance:
                    now = held(y, x, other)
                    if now[0] - now[1] > best[0] - best[1]:
                        settled[y, x], best = other, now
        counts[:, y, x] = best
    return settled, counts[0], counts[1]
