"""Regions of the reference view that the geometry of a scene defines."""

# numba ships no types for its decorators
# mypy: disallow-untyped-decorators=False
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from lfdepth.scenes.model import Ellipsoid, Facets, Scene, Surface

Mask = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.uint8]
Map = npt.NDArray[np.float32]
Index = npt.NDArray[np.int16]
Kinds = Sequence[Mapping[str, int]]

OURS = ("occlusion_boundary", "slanted", "smooth", "thin")
"""Masks of which the benchmark has a counterpart."""
JUMP = 0.1
"""Disparity difference, px per view step, between two layers above which one occludes the other."""
REACH = 5.0
"""Pixels on either side of the jump that belong to the boundary region."""
WINDOW = 9
"""Side, px, of the window in which local contrast is measured."""
FLAT = 1.5
"""Standard deviation, grey levels, up to which a window counts as textureless."""


def geometric(kinds: Kinds, truth: Map, layers: Index, scale: float = 1.0) -> dict[str, Labels]:
    """Masks that follow from truth and layers: occlusion_boundary, those of the layers, the benchmark's.

    Parameters
    ----------
    kinds : sequence of mapping of str to int
        For each layer, the masks that its pixels count in and their label there.
    truth, layers : ndarray, shape (H, W)
        Disparity and index of the nearest layer.
    scale : float
        Pixels of the maps per pixel of the views.

    Returns
    -------
    dict of str to ndarray, shape (H, W)
        uint8: labels where a mask has them, else 1; only masks that are not empty.
    """
    boundary = dilate(jumps(truth, layers, apart=round(scale)), REACH * scale)
    masks = {"occlusion_boundary": boundary.view(np.uint8)}
    for name, table in _label_tables(kinds).items():
        masks[name] = table[layers]
    return with_benchmark({name: mask for name, mask in masks.items() if mask.any()}, scale)


def with_benchmark(masks: Mapping[str, Labels], scale: float = 1.0) -> dict[str, Labels]:
    """The masks, and those that the 4D Light Field Benchmark has for photo-realistic scenes, made of them."""
    some = next(iter(masks.values()), np.zeros((0, 0), np.uint8))
    have = {name: masks.get(name, np.zeros_like(some)) > 0 for name in OURS}
    boundary, thin = have["occlusion_boundary"], have["thin"]
    theirs = {
        "discontinuities": boundary,
        "planes": have["slanted"] & ~boundary,
        "smooth_surfaces": have["smooth"] & ~boundary,
        "fine": thin,
        "fine_surrounding": dilate(thin, REACH * scale) & ~thin,
    }
    return {**masks, **{name: mask.view(np.uint8) for name, mask in theirs.items() if mask.any()}}


def _label_tables(kinds: Kinds) -> dict[str, Labels]:
    """For each mask, the label by layer; one entry more, for pixels that no layer covers."""
    tables: dict[str, Labels] = {}
    for i, labels in enumerate(kinds):
        for name, label in labels.items():
            tables.setdefault(name, np.zeros(len(kinds) + 1, dtype=np.uint8))[i] = label
    return tables


def kinds_of(scene: Scene) -> Kinds:
    """Masks that the layers of a scene count in: those of their surface's geometry, and their tags."""
    return [{**_kind(layer.surface), **layer.tags} for layer in scene.layers]


def _kind(surface: Surface) -> dict[str, int]:
    """Mask of a surface's geometry."""
    if isinstance(surface, Ellipsoid):
        return {"smooth": 1}
    if isinstance(surface, Facets) or surface.slanted:
        return {"slanted": 1}
    return {}


def jumps(truth: Map, layers: Index | None = None, apart: int = 1) -> Mask:
    """Pixels next to one (of another layer, where layers are given) whose disparity differs by over JUMP.

    The difference is that of the two pixels, or of those `apart` px from each other on either side: surfaces
    that meet steeply jump in the views' pixels (`apart` of the map's) although they do not in smaller ones.
    """
    edge = np.zeros(truth.shape, dtype=np.bool_)
    for axis in (0, 1):
        near = _differ(truth, axis, 1)
        if layers is not None:
            near |= _differ(truth, axis, apart)
            near &= np.diff(layers, axis=axis) != 0
        ahead, behind = [slice(None)] * 2, [slice(None)] * 2
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        edge[tuple(ahead)] |= near
        edge[tuple(behind)] |= near
    return edge


def _differ(truth: Map, axis: int, apart: int) -> Mask:
    """Between which neighbours along an axis the disparity changes by over JUMP within `apart` px."""
    between, last = np.arange(truth.shape[axis] - 1), truth.shape[axis] - 1
    before = truth.take(np.maximum(between - (apart - 1) // 2, 0), axis)
    after = truth.take(np.minimum(between + 1 + apart // 2, last), axis)
    return np.asarray(np.abs(after - before) > JUMP)


@njit(cache=True, nogil=True)
def dilate(mask: Mask, radius: float) -> Mask:
    """Pixels whose centre lies within `radius` px of one of the mask; takes the same time for any radius."""
    height, width = mask.shape
    far = int(radius) + 1
    rows_away = np.full((height, width), far, np.int32)  # to the nearest one in the same column
    for y in range(height):
        for x in range(width):
            above = rows_away[y - 1, x] + 1 if y else far
            rows_away[y, x] = 0 if mask[y, x] else min(far, above)
    for y in range(height - 2, -1, -1):
        for x in range(width):
            rows_away[y, x] = min(rows_away[y, x], rows_away[y + 1, x] + 1)
    grown = np.zeros((height, width), np.bool_)
    starts = np.empty(width + 1, np.int32)
    for y in range(height):
        starts[:] = 0  # how many more stretches begin than end at a column
        for x in range(width):
            dy = rows_away[y, x]
            if dy < far:
                half = int(np.sqrt(radius * radius - dy * dy))
                starts[max(0, x - half)] += 1
                starts[min(width, x + half + 1)] -= 1
        open_stretches = 0
        for x in range(width):
            open_stretches += starts[x]
            grown[y, x] = open_stretches > 0
    return grown


def textureless(picture: npt.NDArray[Any]) -> Mask:
    """Pixels of a noise-free picture (H, W, 3) around which no channel deviates by more than FLAT."""
    values = picture.astype(np.float64)
    mean = _box_mean(values)
    variance = _box_mean(values * values) - mean * mean
    return np.asarray((variance <= FLAT * FLAT).all(axis=-1))


def _box_mean(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Mean over WINDOW × WINDOW px, edges repeated."""
    half = WINDOW // 2
    padded = np.pad(values, ((half + 1, half), (half + 1, half), (0, 0)), mode="edge")
    sums = padded.cumsum(axis=0).cumsum(axis=1)
    n = WINDOW
    window = sums[n:, n:] - sums[:-n, n:] - sums[n:, :-n] + sums[:-n, :-n]
    return np.asarray(window / (n * n))
