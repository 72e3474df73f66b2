"""Shrinking pictures and maps by an exact factor, the same along both axes.

Pixel x of the small picture has its centre at ``(x + 1/2) / scale - 1/2`` of the large one. Where the
factor does not divide the size, less than one small pixel is cut at the right and bottom: rounding the size
would scale x and y, and thus the disparities of horizontal and vertical views, differently.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError


def scaled_size(size: tuple[int, ...], scale: float, what: str = "picture") -> tuple[int, int]:
    """(width, height) after scaling.

    Raises
    ------
    LightFieldError
        If the scale is not in (0, 1], or leaves no pixel.
    """
    if not 0 < scale <= 1:
        raise LightFieldError(f"{what}: scale is {scale}; expected a factor above 0 and at most 1; change it")
    width, height = (int(length * scale + 1e-9) for length in size)
    if min(width, height) < 1:
        raise LightFieldError(
            f"{what}: scale {scale} leaves nothing of {size[0]}x{size[1]} px; expected at least one pixel; "
            "choose a larger scale"
        )
    return width, height


def scale_view(view: npt.NDArray[Any], scale: float) -> npt.NDArray[Any]:
    """Shrink a view (H, W, C) with a triangle filter two small pixels wide, which does not overshoot."""
    if scale == 1:
        return view
    width, height = scaled_size((view.shape[1], view.shape[0]), scale)
    small = np.empty((height, width, view.shape[2]), dtype=view.dtype)
    for channel in range(view.shape[2]):
        plane = _shrink(view[..., channel].astype(np.float32), scale, (width, height))
        small[..., channel] = plane if view.dtype.kind == "f" else np.rint(plane)
    return small


def scale_nearest(whole: npt.NDArray[Any], scale: float) -> npt.NDArray[Any]:
    """Shrink a map (H, W) by taking the value at the centre of each small pixel."""
    if scale == 1:
        return whole
    width, height = scaled_size((whole.shape[1], whole.shape[0]), scale)
    rows, columns = (((np.arange(n) + 0.5) / scale).astype(np.intp) for n in (height, width))
    return whole[np.ix_(rows, columns)]


def _shrink(plane: npt.NDArray[np.float32], scale: float, size: tuple[int, int]) -> npt.NDArray[np.float32]:
    from PIL import Image

    box = (0.0, 0.0, min(size[0] / scale, plane.shape[1]), min(size[1] / scale, plane.shape[0]))
    picture = Image.fromarray(plane).resize(size, Image.Resampling.BILINEAR, box=box)
    return np.asarray(picture).clip(plane.min(), plane.max())
