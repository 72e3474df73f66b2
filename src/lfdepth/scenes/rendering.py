"""From a scene to a light field: views, truth, noise."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from lfdepth.camera import Camera
from lfdepth.engines.cpu.kernels import scenes as kernels
from lfdepth.engines.scene_layout import Packed
from lfdepth.lightfield import LightField
from lfdepth.scenes.masks import Labels, Map, geometric, kinds_of, textureless
from lfdepth.scenes.model import Scene, pack

MARGIN = 0.1
"""By how much the disparity range is wider than the truth's, px per view step, at either end."""
READ_SHARE = 0.5
"""Read noise as a share of the noise at mid grey; shot noise makes up the rest."""
MID_GREY = 128.0
_BLOCK = 128  # rows that a thread traces at a time


@dataclass(frozen=True, eq=False)
class Rendering:
    """A light field, and its geometry at any resolution.

    `geometry(factor)` gives truth and labelled masks (H·factor, W·factor) of the reference view.
    """

    lf: LightField
    geometry: Callable[[int], tuple[Map, dict[str, Labels]]]


def render(
    scene: Scene,
    name: str,
    size: tuple[int, int],
    views: tuple[int, int],
    seed: int,
    noise: float | None,
    samples: int,
) -> Rendering:
    """Render all views of a scene, its truth and masks."""
    packed = pack(scene)
    level = np.float32(scene.noise if noise is None else noise)
    pictures = _render_views(packed, size, views, seed, level * noise_share(scene), samples)
    flat = textureless(kernels.render_view(packed, 0.0, 0.0, *size, samples))
    at = partial(geometry, scene, size)
    return Rendering(assemble(name, pictures, at(1), {"textureless": flat}), at)


def geometry(scene: Scene, size: tuple[int, int], factor: int) -> tuple[Map, dict[str, Labels]]:
    """Truth and masks of the reference view, (H, W) times `factor`."""
    truth, layers = trace(pack(scene), size, factor)
    return truth, geometric(kinds_of(scene), truth, layers, factor)


def assemble(
    name: str,
    views: npt.NDArray[np.uint8],
    geometry: tuple[Map, dict[str, Labels]],
    more: Mapping[str, npt.NDArray[np.bool_]],
    taken: Camera | None = None,
) -> LightField:
    """Light field of rendered views, with a plausible camera unless they were taken with a real one."""
    truth, labels = geometry
    span = float(truth.min()) - MARGIN, float(truth.max()) + MARGIN
    masks = {key: mask > 0 for key, mask in labels.items()} | {k: m for k, m in more.items() if m.any()}
    fitting = taken or camera(span, (truth.shape[0], truth.shape[1]))
    return LightField(views, fitting, disparity_range=span, truth=truth, masks=masks, name=name)


def noise_share(scene: Scene) -> npt.NDArray[np.float32]:
    """Share of the noise by pixel, (H, W, 1), or for all of them."""
    share = np.float32(1) if scene.noise_share is None else scene.noise_share[..., None]
    return np.asarray(share, dtype=np.float32)


def trace(
    packed: Packed, size: tuple[int, int], factor: int = 1, view: tuple[float, float] = (0.0, 0.0)
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int16]]:
    """Disparity and layer index of a view (u, v), by default the reference view, (H, W) times `factor`.

    Pixels of the larger maps divide those of the views: the first is centred at (0.5/factor - 0.5).
    """
    height, width = size[0] * factor, size[1] * factor
    truth, layers = np.empty((height, width), np.float32), np.empty((height, width), np.int16)
    first = 0.5 / factor - 0.5

    def block(start: int) -> None:
        rows = first + np.arange(start, min(start + _BLOCK, height)) / factor
        part = slice(start, start + _BLOCK)
        truth[part], layers[part] = kernels.trace(packed, *view, rows, width, first, 1 / factor)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(block, range(0, height, _BLOCK)))
    return truth, layers


def truths(scene: Scene, size: tuple[int, int], views: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Disparity that every view shows, (V, U, H, W)."""
    packed, out = pack(scene), np.empty((*views, *size), np.float32)
    for v, u in np.ndindex(*views):
        out[v, u] = trace(packed, size, view=(float(u - views[1] // 2), float(v - views[0] // 2)))[0]
    return out


def _render_views(
    packed: Packed,
    size: tuple[int, int],
    views: tuple[int, int],
    seed: int,
    noise: npt.NDArray[np.float32],
    samples: int,
) -> npt.NDArray[np.uint8]:
    """Views (V, U, H, W, 3); each has its own noise generator, so that threads cannot change the result."""
    out = np.empty((*views, *size, 3), dtype=np.uint8)

    def draw(index: tuple[int, int]) -> None:
        v, u = index[0] - views[0] // 2, index[1] - views[1] // 2
        picture = kernels.render_view(packed, float(u), float(v), *size, samples)
        out[index] = expose(picture, noise, [seed, 1, *index])

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(draw, np.ndindex(*views)))
    return out


def expose(
    picture: npt.NDArray[np.float32], noise: npt.NDArray[np.float32] | np.float32, seed: Sequence[int]
) -> npt.NDArray[np.uint8]:
    """8-bit picture with shot and read noise; `noise` is their joint deviation at mid grey."""
    if noise.any():
        shot = (1 - READ_SHARE**2) / MID_GREY
        brightness = np.sqrt(READ_SHARE**2 + shot * np.maximum(picture, 0))
        chance = np.random.default_rng(seed).standard_normal(picture.shape, dtype=np.float32)
        picture = picture + noise * brightness * chance
    return np.rint(np.clip(picture, 0, 255)).astype(np.uint8)


def camera(span: tuple[float, float], size: tuple[int, int]) -> Camera:
    """A camera array that would see the scene so: focal length 100 mm, 35 mm sensor, focused at 8 m.

    The baseline is chosen such that the farthest disparity still lies well in front of infinity.
    """
    focal_length, sensor, focus = 100.0, 35.0, 8.0
    infinity = 2 * max(abs(span[0]), abs(span[1])) + 2  # -disparity of infinitely far points
    pitch = sensor / max(size)
    return Camera(
        focal_length, sensor, infinity * focus * 1000 * pitch / focal_length, focus, size[1], size[0]
    )
