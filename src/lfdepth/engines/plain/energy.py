"""The joint energy: scanline paths, least totals, islands at the range's ends, fitted planes."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.base import Array, Float
from lfdepth.engines.layout import ENERGY_CUT, ENERGY_SCALE, SHARE_LEVELS

_SAME_SURFACE = 2.0
"""Planes within which neighbours belong to one island."""

_VERTEX_REACH, _FLAT = 1.5, 1e-4
"""Planes that a minimum may be from the plane it was looked for at; curvature below which there is none."""

_FALL = 2.0
"""Weights of a fit fall as exp(−_FALL·distance²/radius²)."""


def whole_energies(signs: Array, shares: Array, weight: Float) -> NDArray[np.int64]:
    """Energies (H, W, K) above each pixel's least, as whole numbers, cut."""
    energy = signs - weight * shares.astype(np.float32) / np.float32(SHARE_LEVELS)
    above = (energy - energy.min(axis=0)) * np.float32(ENERGY_SCALE)
    return np.moveaxis(np.minimum(above, np.float32(ENERGY_CUT)).astype(np.int64), 0, 2)


def paths(
    energy: NDArray[np.int64], guide: Float, slope: float, jump: float, sharpness: float, noise: float
) -> NDArray[np.int64]:
    """Costs (H, W, K) of the best paths from four sides, summed."""
    total = np.zeros_like(energy)
    for axis in (0, 1):
        lines, image = np.moveaxis(energy, axis, 0), np.moveaxis(guide, axis, 0)
        change = np.zeros((len(image) - 1, image.shape[1]), np.float32)
        for channel in np.moveaxis(np.abs(np.diff(image, axis=0)), 2, 0):
            change += channel
        fall = np.exp(-np.float32(sharpness) * np.maximum(change - np.float32(noise), np.float32(0)))
        costs = [(np.float32(each * ENERGY_SCALE) * fall).astype(np.int64) for each in (slope, jump)]
        out = np.moveaxis(total, axis, 0)
        out += _sweep(lines, *costs)
        out[::-1] += _sweep(lines[::-1], *(each[::-1] for each in costs))
    return total


def _sweep(lines: NDArray[np.int64], slope: NDArray[np.int64], jump: NDArray[np.int64]) -> NDArray[np.int64]:
    """Costs along the first axis of (N, M, K), less the least of the pixel before."""
    out = lines.copy()
    for here in range(1, len(lines)):
        before = out[here - 1] - out[here - 1].min(axis=1, keepdims=True)
        best = np.minimum(before, jump[here - 1, :, None])
        aside = before + slope[here - 1, :, None]
        best[:, 1:] = np.minimum(best[:, 1:], aside[:, :-1])
        best[:, :-1] = np.minimum(best[:, :-1], aside[:, 1:])
        out[here] += best
    return out


def least(total: Array) -> Float:
    """Place of the least total of each pixel, between planes by a parabola."""
    best = total.argmin(axis=2)
    before, at, after = _around(np.moveaxis(total, 2, 0), best)
    left, right = (before - at).astype(np.float32), (after - at).astype(np.float32)
    bent = (best > 0) & (best < total.shape[2] - 1) & (left + right > 0)
    offset = np.divide(
        np.float32(0.5) * (left - right), left + right, out=np.zeros(best.shape, np.float32), where=bent
    )
    return np.asarray(best + offset, np.float32)


def _around(volume: Array, plane: NDArray[np.int64]) -> tuple[Any, Any, Any]:
    """Values (H, W) of a volume (K, H, W) at the plane before, at, and after a pixel's own."""
    places = (np.clip(plane + move, 0, len(volume) - 1)[None] for move in (-1, 0, 1))
    before, at, after = (np.take_along_axis(volume, place, 0)[0] for place in places)
    return before, at, after


def fill_islands(position: Float, planes: int, largest: int) -> None:
    """Give small islands at the ends of the range the lower median of what lies around them, in place."""
    done: set[tuple[int, int]] = set()
    at_end = (position <= 0) | (position >= planes - 1)
    for y, x in np.argwhere(at_end).tolist():
        if (y, x) in done:
            continue
        island = _island(position, (y, x), done, largest)
        if len(island) > largest:
            continue
        done.update(island)
        shore = sorted(
            position[there]
            for here in island
            for there in _beside(here, position.shape)
            if not _alike(position, here, there)
        )
        for here in island if shore else ():
            position[here] = shore[(len(shore) - 1) // 2]


def _island(
    position: Float, start: tuple[int, int], done: set[tuple[int, int]], largest: int
) -> list[tuple[int, int]]:
    """Pixels that neighbours of one surface lead to; growth ends where there are too many."""
    island = [start]
    for here in island:
        for there in _beside(here, position.shape):
            if there not in island and there not in done and _alike(position, here, there):
                island.append(there)
        if len(island) > largest:
            break
    return island


def _beside(place: tuple[int, int], size: tuple[int, ...]) -> list[tuple[int, int]]:
    y, x = place
    around = ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1))
    return [(a, b) for a, b in around if 0 <= a < size[0] and 0 <= b < size[1]]


def _alike(position: Float, here: tuple[int, int], there: tuple[int, int]) -> bool:
    return bool(abs(position[there] - position[here]) <= _SAME_SURFACE)


def own_minima(
    signs: Array, shares: Array, weight: Float, position: Float, prior: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Place and sharpness of each pixel's minimum beside its position, drawn to it by a prior."""
    near = np.clip((position + np.float32(0.5)).astype(np.int64), 0, len(signs) - 1)
    energies = zip(_around(signs, near), _around(shares, near), strict=True)
    before, at, after = (s.astype(np.float64) - weight * (p / SHARE_LEVELS) for s, p in energies)
    curvature = (before + after - 2 * at) / 2
    found = (near > 0) & (near < len(signs) - 1) & (curvature > _FLAT)
    offset = np.divide(before - after, 4 * curvature, out=np.zeros(near.shape), where=found)
    vertex = near + np.clip(offset, -_VERTEX_REACH, _VERTEX_REACH)
    sharpness = np.where(found, curvature, 0)
    return (sharpness * vertex + prior * position) / (sharpness + prior), sharpness + prior


def fit(
    position: Float,
    target: NDArray[np.floating],
    strength: NDArray[np.floating],
    guide: Float,
    radius: int,
    spacing: int,
    gate: float,
    ridge: float,
    sharpness: float,
) -> Float:
    """Heights, at their own pixels, of planes fitted by weighted least squares to the targets around."""
    moments = np.zeros((*position.shape, 3, 3))
    moments[..., (1, 2), (1, 2)] = ridge
    moved = np.zeros((*position.shape, 3))
    reach = range(-radius, radius + 1, spacing)
    for dy, dx in product(reach, reach):
        here, there = _pair(position.shape, dy, dx)
        weight = np.exp(-_FALL * (dy**2 + dx**2) / radius**2) * strength[there]
        weight = weight * _likeness(guide, here, there, sharpness)
        weight = weight * (np.abs(position[there] - position[here]) <= np.float32(gate))
        tap = np.array([1.0, dx, dy])
        moments[here] += weight[..., None, None] * np.outer(tap, tap)
        moved[here] += (weight * (target[there] - position[here]))[..., None] * tap
    height = np.linalg.solve(moments, moved[..., None])[..., 0, 0]
    return np.asarray(position + height, np.float32)


def even(position: Float, guide: Float, gate: float, sharpness: float) -> Float:
    """Binomial mean of 3×3 px, over pairs of opposite neighbours both of which are near enough."""
    out = position.astype(np.float64)
    for dy, dx, weight in ((0, 1, 2), (1, 0, 2), (1, 1, 1), (1, -1, 1)):
        inner = slice(dy, position.shape[0] - dy), slice(1, -1) if dx else slice(None)
        change, near, like = [], np.array(True), np.array(np.inf)
        for side in (-1, 1):
            here, there = _pair(position.shape, side * dy, side * dx)
            apart, alike = np.zeros(position.shape, np.float32), np.zeros(position.shape)
            apart[here], alike[here] = (
                position[there] - position[here],
                _likeness(guide, here, there, sharpness),
            )
            change.append(apart[inner])
            near = near & (np.abs(apart[inner]) <= np.float32(gate))
            like = np.minimum(like, alike[inner])
        out[inner] += near * like * (change[0].astype(np.float64) + change[1]) * (weight / 16)
    return out.astype(np.float32)


def _pair(size: tuple[int, ...], dy: int, dx: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Pixels that have a neighbour (dy, dx) away, and those neighbours."""

    def part(length: int, move: int) -> tuple[slice, slice]:
        count = max(length - abs(move), 0)
        start, end = max(-move, 0), max(move, 0)
        return slice(start, start + count), slice(end, end + count)

    (rows, other_rows), (columns, other_columns) = part(size[0], dy), part(size[1], dx)
    return (rows, columns), (other_rows, other_columns)


def _likeness(
    guide: Float, here: tuple[slice, slice], there: tuple[slice, slice], sharpness: float
) -> NDArray[np.float64]:
    """About exp(−t), (1 − t/8)⁸, of the change of colour times a sharpness."""
    change = np.abs(guide[there].astype(np.float64) - guide[here]).sum(axis=2)
    return np.asarray(np.maximum(1 - sharpness / 8 * change, 0) ** 8)
