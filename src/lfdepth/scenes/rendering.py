"""From a scene to a light field: views, truth, noise."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from lfdepth.camera import Camera
from lfdepth.lightfield import LightField
from lfdepth.scenes import kernels
from lfdepth.scenes.masks import geometric, textureless
from lfdepth.scenes.model import Packed, Scene, pack

MARGIN = 0.1
"""By how much the disparity range is wider than the truth's, px per view step, at either end."""
READ_SHARE = 0.5
"""Read noise as a share of the noise at mid grey; shot noise makes up the rest."""
MID_GREY = 128.0


def light_field(
    scene: Scene,
    name: str,
    size: tuple[int, int],
    views: tuple[int, int],
    seed: int,
    noise: float | None,
    samples: int,
) -> LightField:
    """Render all views of a scene, its truth and masks."""
    packed = pack(scene)
    truth, layers = kernels.trace(packed, np.arange(size[0], dtype=np.float64), size[1], 0.0, 1.0)
    masks = geometric(scene, truth, layers)
    flat = textureless(kernels.render_view(packed, 0.0, 0.0, *size, samples))
    if flat.any():
        masks["textureless"] = flat
    span = float(truth.min()) - MARGIN, float(truth.max()) + MARGIN
    return LightField(
        views=_render_views(packed, size, views, seed, scene.noise if noise is None else noise, samples),
        camera=camera(span, size),
        disparity_range=span,
        truth=truth,
        masks=masks,
        name=name,
    )


def _render_views(
    packed: Packed, size: tuple[int, int], views: tuple[int, int], seed: int, noise: float, samples: int
) -> npt.NDArray[np.uint8]:
    """Views (V, U, H, W, 3); each has its own noise generator, so that threads cannot change the result."""
    out = np.empty((*views, *size, 3), dtype=np.uint8)

    def draw(index: tuple[int, int]) -> None:
        v, u = index[0] - views[0] // 2, index[1] - views[1] // 2
        picture = kernels.render_view(packed, float(u), float(v), *size, samples)
        if noise > 0:
            _add_noise(picture, noise, np.random.default_rng([seed, 1, *index]))
        out[index] = np.rint(np.clip(picture, 0, 255))

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(draw, np.ndindex(*views)))
    return out


def _add_noise(picture: npt.NDArray[np.float32], level: float, rng: np.random.Generator) -> None:
    """Add shot and read noise in place; `level` is their joint deviation at mid grey."""
    read = (READ_SHARE * level) ** 2
    shot = (level * level - read) / MID_GREY
    picture += rng.standard_normal(picture.shape, dtype=np.float32) * np.sqrt(
        read + shot * np.maximum(picture, 0)
    )


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
