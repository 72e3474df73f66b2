"""Small light fields for the tests of the sweep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.lightfield import LightField

Array = NDArray[Any]
Texture = Callable[[Array, Array], Array]

DTYPES = ("uint8", "uint16", "float32")
TEXTURES = ("scene", "noise", "coarse")


def texture(
    rng: np.random.Generator, waves: int = 12, shortest: float = 4.0, longest: float = 20.0
) -> Texture:
    """A smooth picture with values in [0, 1], defined at every real (x, y)."""
    angle, phase = rng.uniform(0, 2 * np.pi, (2, waves))
    frequency = 2 * np.pi / rng.uniform(shortest, longest, waves)
    along_x, along_y = frequency * np.cos(angle), frequency * np.sin(angle)

    def value(x: Array, y: Array) -> Array:
        waves_here = np.sin(along_x * x[..., None] + along_y * y[..., None] + phase)
        return np.asarray(0.5 + 0.5 * np.tanh(waves_here.sum(axis=-1) / np.sqrt(waves)))

    return value


def plane_views(
    paint: Texture,
    disparity: float,
    grid: tuple[int, int],
    size: tuple[int, int],
    origin: tuple[float, float] = (0, 0),
) -> Array:
    """(V, U, H, W) exact views, in [0, 1], of a picture on one plane; `origin` (x, y) moves the picture."""
    x, y = np.meshgrid(np.arange(size[1], dtype=float), np.arange(size[0], dtype=float))
    v = np.arange(grid[0])[:, None, None, None] - grid[0] // 2
    u = np.arange(grid[1])[None, :, None, None] - grid[1] // 2
    return paint(x + disparity * u + origin[0], y + disparity * v + origin[1])


def two_planes(
    rng: np.random.Generator,
    grid: tuple[int, int],
    size: tuple[int, int],
    near: float = 0.8,
    far: float = -0.6,
) -> tuple[Array, Array]:
    """Views (V, U, H, W) in [0, 1] of a rectangle in front of a wall, and the exact disparity (H, W)."""
    height, width = size
    wall, front = texture(rng), texture(rng)
    v = np.arange(grid[0])[:, None, None, None] - grid[0] // 2
    u = np.arange(grid[1])[None, :, None, None] - grid[1] // 2
    x, y = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))

    def inside(column: Array, row: Array) -> Array:
        return (abs(column - 0.45 * width) < 0.2 * width) & (abs(row - 0.5 * height) < 0.25 * height)

    covered = inside(x + near * u, y + near * v)
    views = np.where(covered, front(x + near * u, y + near * v), wall(x + far * u, y + far * v))
    return views, np.where(inside(x, y), near, far)


def glossy_plane(rng: np.random.Generator, grid: tuple[int, int], size: tuple[int, int]) -> Array:
    """Views (V, U, H, W, 3) in [0, 1] of a textured plane at 0.5, its right half under a shine."""
    paint = plane_views(texture(rng, shortest=3, longest=6), 0.5, grid, size)
    shine = rng.uniform(0, 0.5, (*grid, 1, 1)) * (np.arange(size[1]) > size[1] / 2)
    return np.stack([0.1 + 0.35 * paint**gamma + shine for gamma in (1.0, 0.7, 1.6)], axis=-1)


def light_field(
    rng: np.random.Generator,
    grid: tuple[int, int] = (5, 5),
    size: tuple[int, int] = (20, 24),
    channels: int = 1,
    dtype: str = "uint8",
    kind: str = "scene",
    present: Array | None = None,
    **fields: Any,
) -> LightField:
    """A random light field.

    `kind`: "scene" two textured planes; "noise" every sample on its own; "coarse" noise of three levels, so
    that many gradients are zero and others as large as they can be.
    """
    shape = (*grid, *size)
    if kind == "scene":
        grey, _ = two_planes(rng, grid, size)
        values = np.stack([grey**gamma for gamma in (1.0, 0.7, 1.6)[:channels]], axis=-1)
    elif kind == "noise":
        values = rng.random((*shape, channels))
    else:
        values = rng.integers(0, 3, (*shape, channels)) / 2
    return LightField(quantise(values, dtype), present=present, **fields)


def quantise(values: Array, dtype: str) -> Array:
    """Values in [0, 1] as samples of a type; see `_off_the_fence`."""
    if dtype == "uint8":
        return np.asarray(np.rint(values * 255), np.uint8)
    whole = _off_the_fence(np.rint(values * 65535).astype(np.int64))
    return whole.astype(np.uint16) if dtype == "uint16" else np.asarray(whole / 65535, np.float32)


def _off_the_fence(samples: Array) -> Array:
    """16-bit samples moved a little wherever their luma lies close to the middle between two grey levels.

    There single and double precision may round differently, and the oracle could not be compared exactly.
    """
    weights = np.array([1.0] if samples.shape[-1] == 1 else [0.299, 0.587, 0.114])
    towards_middle = np.where(samples[..., -1] > 32768, -1, 1)
    for _ in range(50):
        level = samples @ weights * 2040 / 65535
        close = abs(level % 1 - 0.5) < 0.01
        if not close.any():
            return samples
        samples[..., -1] += np.where(close, towards_middle, 0)
    raise AssertionError("samples stay between grey levels")


def random_present(rng: np.random.Generator, grid: tuple[int, int]) -> Array:
    """About a third of the views absent, never the reference view."""
    present = rng.random(grid) > 0.35
    present[grid[0] // 2, grid[1] // 2] = True
    return present


def random_mask(rng: np.random.Generator, size: tuple[int, int]) -> Array:
    """A mask with large uniform parts, straight and ragged edges, and single pixels."""
    height, width = size
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    mask = (x > rng.uniform(0.2, 0.9) * width) & (y > rng.uniform(0, 0.6) * height)
    mask |= (x - rng.uniform(0, width)) ** 2 + (y - rng.uniform(0, height)) ** 2 < (0.2 * min(size)) ** 2
    return np.asarray(mask ^ (rng.random(size) < 0.002))


RANGE = (-1.0, 1.2)
"""Disparity range of `scene`."""


def scene(
    seed: int,
    grid: tuple[int, int] = (5, 5),
    size: tuple[int, int] = (44, 50),
    channels: int = 3,
    dtype: str = "uint8",
    absent: bool = False,
) -> LightField:
    """A light field with a range, and with some views absent if asked for."""
    rng = np.random.default_rng(seed)
    present = random_present(rng, grid) if absent else None
    return light_field(rng, grid, size, channels, dtype, present=present, disparity_range=RANGE)
