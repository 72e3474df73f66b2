"""Reparameterisation (eq. 1): every view shifted so that one disparity plane falls into register."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.layout import GREY_UNIT, shifts
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import grid_offsets


def reparameterise(views: NDArray[Any], disparity: float) -> NDArray[np.float32]:
    """Shift every view so that the plane at `disparity` falls into register (eq. 1).

    `L_D(x, y, u, v) = L_0(x − u·D, y − v·D, u, v)`; the paper writes `d = −D`.

    Parameters
    ----------
    views
        (V, U, H, W) or (V, U, H, W, C), any numeric type: views, or a mask per view.
    disparity
        Plane in px per view step; positive is nearer.

    Returns
    -------
    Array of the same shape, float32, in the units of `views`.

    Raises
    ------
    LightFieldError
        If `views` has another number of axes or the disparity is not finite.
    """
    if views.ndim not in (4, 5):
        raise LightFieldError(
            f"views: found shape {views.shape}, expected (V, U, H, W) or (V, U, H, W, C); "
            "add the missing axes"
        )
    if not np.isfinite(disparity):
        raise LightFieldError(f"disparity: found {disparity}, expected a finite number of px per view step")
    plane = shifts(grid_offsets((views.shape[0], views.shape[1])), disparity)
    out = np.empty(views.shape, np.float32)
    for v, u in np.ndindex(*views.shape[:2]):
        out[v, u] = _shift(views[v, u], int(plane.down[v, u]), int(plane.across[v, u]), plane.weights[v, u])
    return out


def _shift(image: NDArray[Any], down: int, across: int, weights: NDArray[np.int64]) -> NDArray[np.float32]:
    height, width = image.shape[:2]
    row = np.clip(np.arange(height + 1) + down, 0, height - 1)
    column = np.clip(np.arange(width + 1) + across, 0, width - 1)
    sample = image[row[:, None], column[None, :]].astype(np.float32)
    w00, w01, w10, w11 = (weights / GREY_UNIT).astype(np.float32)
    shifted = w00 * sample[:-1, :-1] + w01 * sample[:-1, 1:] + w10 * sample[1:, :-1] + w11 * sample[1:, 1:]
    return np.asarray(shifted, np.float32)
