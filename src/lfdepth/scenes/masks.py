"""Regions of the reference view that the geometry of a scene defines."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.scenes.model import Ellipsoid, Facets, Plane, Scene

Mask = npt.NDArray[np.bool_]
Map = npt.NDArray[np.float32]

JUMP = 0.1
"""Disparity difference, px per view step, between two layers above which one occludes the other."""
REACH = 5.0
"""Pixels on either side of the jump that belong to the boundary region."""
WINDOW = 9
"""Side, px, of the window in which local contrast is measured."""
FLAT = 1.5
"""Standard deviation, grey levels, up to which a window counts as textureless."""


def geometric(scene: Scene, truth: Map, layers: npt.NDArray[np.int16]) -> dict[str, Mask]:
    """Masks that follow from truth and layers: occlusion_boundary, slanted, smooth and the layers' tags."""
    masks = {"occlusion_boundary": dilate(jumps(truth, layers), REACH)}
    for i, layer in enumerate(scene.layers):
        kinds = set(layer.tags)
        if isinstance(layer.surface, Plane) and layer.surface.slanted:
            kinds.add("slanted")
        if isinstance(layer.surface, Ellipsoid):
            kinds.add("smooth")
        if isinstance(layer.surface, Facets):
            kinds.add("slanted")
        for kind in kinds:
            masks[kind] = masks.get(kind, False) | (layers == i)
    return {name: mask for name, mask in masks.items() if mask.any()}


def jumps(truth: Map, layers: npt.NDArray[np.int16]) -> Mask:
    """Pixels next to one of another layer whose disparity differs by more than JUMP."""
    edge = np.zeros(truth.shape, dtype=np.bool_)
    for axis in (0, 1):
        near = (np.abs(np.diff(truth, axis=axis)) > JUMP) & (np.diff(layers, axis=axis) != 0)
        ahead, behind = [slice(None)] * 2, [slice(None)] * 2
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        edge[tuple(ahead)] |= near
        edge[tuple(behind)] |= near
    return edge


def dilate(mask: Mask, radius: float) -> Mask:
    """Pixels whose centre lies within `radius` px of one of the mask."""
    reach = int(radius)
    height, width = mask.shape
    counts = np.zeros((height, width + 1), dtype=np.int32)
    np.cumsum(mask, axis=1, out=counts[:, 1:])
    columns = np.arange(width)
    grown = np.zeros_like(mask)
    for dy in range(-reach, reach + 1):
        half = int((radius * radius - dy * dy) ** 0.5)
        ends, starts = np.minimum(columns + half + 1, width), np.maximum(columns - half, 0)
        row = counts[:, ends] > counts[:, starts]
        if dy < 0:
            grown[:dy] |= row[-dy:]
        else:
            grown[dy:] |= row[: height - dy]
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
