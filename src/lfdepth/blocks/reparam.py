"""Reparameterisation (eq. 1): every view shifted so that one disparity plane falls into register.

The sweep works on grey levels in eighths of an 8-bit level (0...2040) and shifts rounded to 1/32 px. Levels
times bilinear weights are then whole numbers of 16 bits: signs of differences, all that the vote looks at,
are exact, a uniform area has none, and a vector unit handles twice the pixels of 32-bit arithmetic. The three
extra bits matter where texture is weak: luma rounded to 8 bits loses what the colour channels still hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField

UNIT = 32
"""Sum of the four bilinear weights, and parts of a pixel that shifts are rounded to."""

FULL_SCALE = 2040
"""Grey level of full scale; `FULL_SCALE * UNIT` just fits 16 bits."""

PAD = 16
"""Columns kept left and right of a row buffer: horizontal neighbours exist, and loops have round lengths."""

_REC601 = np.array([0.299, 0.587, 0.114], dtype=np.float32)


@dataclass(frozen=True, eq=False)
class ViewStack:
    """Grey views, padded by repeating the border so that kernels need no clamping in x.

    `data` is flat, laid out (V, H, U, row_length): the rows that a row of votes reads lie side by side, which
    streams twice as fast from memory as whole views would. A row starts `margin` columns before the image.
    """

    data: NDArray[np.uint16]
    grid: tuple[int, int]
    size: tuple[int, int]
    margin: int
    row_length: int
    present: NDArray[np.bool_]

    @property
    def centre(self) -> tuple[int, int]:
        """Row and column of the reference view."""
        return self.grid[0] // 2, self.grid[1] // 2


def round_width(width: int) -> int:
    """Width of a row buffer's interior: a multiple of 32, so that vector loops have no remainder."""
    return -(-width // 32) * 32


def grey_levels(views: NDArray[Any]) -> NDArray[np.uint16]:
    """Grey views in whole numbers from 0 to `FULL_SCALE`.

    Parameters
    ----------
    views
        (..., C) uint8, uint16 or float (full scale 1); C is 1 or 3 (Rec. 601 luma).

    Returns
    -------
    (...) uint16 array.
    """
    full_scale = {1: 255.0, 2: 65535.0}[views.dtype.itemsize] if views.dtype.kind == "u" else 1.0
    grey = views[..., 0].astype(np.float32) if views.shape[-1] == 1 else views.astype(np.float32) @ _REC601
    levels = np.rint(grey * np.float32(FULL_SCALE / full_scale))
    return np.asarray(np.clip(levels, 0, FULL_SCALE), np.uint16)


def stack_views(lf: LightField, max_disparity: float) -> ViewStack:
    """Prepare the grey views of a light field for planes up to |D| = `max_disparity` px per view step."""
    rows, columns, height, width, _ = lf.views.shape
    # Samples farther away are the border's, see `Shifts.limited`.
    reach = min(np.ceil(columns // 2 * abs(max_disparity)), width + 1)
    margin = int(reach) + 2 + PAD
    row_length = round_width(width) + 2 * margin
    data = np.empty((rows, height, columns, row_length), np.uint16)
    for v in range(rows):
        for u in range(columns):
            padded = data[v, :, u]
            padded[:, margin : margin + width] = grey_levels(lf.views[v, u])
            padded[:, :margin] = padded[:, margin, None]
            padded[:, margin + width :] = padded[:, margin + width - 1, None]
    present = np.ones((rows, columns), np.bool_) if lf.present is None else lf.present.astype(np.bool_)
    return ViewStack(
        data=data.reshape(-1),
        grid=(rows, columns),
        size=(height, width),
        margin=margin,
        row_length=row_length,
        present=present,
    )


@dataclass(frozen=True, eq=False)
class Shifts:
    """How one plane samples the views: whole pixels per view row and column, and bilinear weights per view.

    `weights` is (V, U, 4) for the neighbours (y, x), (y, x+1), (y+1, x), (y+1, x+1): whole numbers that
    sum to `UNIT`.
    """

    down: NDArray[np.int64]
    across: NDArray[np.int64]
    weights: NDArray[np.int64]

    @property
    def reach(self) -> int:
        """Largest distance in px from a pixel to a neighbour that is sampled."""
        return int(max(max(-whole.min(), whole.max() + 1) for whole in (self.down, self.across)))

    def limited(self, size: tuple[int, int]) -> Shifts:
        """Shifts that sample an image of this size (H, W) alike and reach just beyond its repeated border."""
        height, width = size
        down, across = self.down.clip(-height - 1, height), self.across.clip(-width - 1, width)
        return Shifts(down, across, self.weights)


def shifts(grid: tuple[int, int], disparity: float) -> Shifts:
    """Sampling shifts of a (V, U) grid for a plane: view (v, u) is sampled at (x − u·D, y − v·D)."""
    down, qy = _whole_and_fraction(grid[0], disparity)
    across, qx = _whole_and_fraction(grid[1], disparity)
    both = (qy[:, None] * qx + UNIT // 2) // UNIT
    weights = np.stack([UNIT - qx - qy[:, None] + both, qx - both, qy[:, None] - both, both], axis=-1)
    return Shifts(down, across, weights)


def _whole_and_fraction(count: int, disparity: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    fixed = np.rint(-(np.arange(count) - count // 2) * disparity * UNIT).astype(np.int64)
    return fixed // UNIT, fixed % UNIT


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
    plane = shifts((views.shape[0], views.shape[1]), disparity)
    out = np.empty(views.shape, np.float32)
    for v, u in np.ndindex(*views.shape[:2]):
        out[v, u] = _shift(views[v, u], int(plane.down[v]), int(plane.across[u]), plane.weights[v, u])
    return out


def _shift(image: NDArray[Any], down: int, across: int, weights: NDArray[np.int64]) -> NDArray[np.float32]:
    height, width = image.shape[:2]
    row = np.clip(np.arange(height + 1) + down, 0, height - 1)
    column = np.clip(np.arange(width + 1) + across, 0, width - 1)
    sample = image[row[:, None], column[None, :]].astype(np.float32)
    w00, w01, w10, w11 = (weights / UNIT).astype(np.float32)
    shifted = w00 * sample[:-1, :-1] + w01 * sample[:-1, 1:] + w10 * sample[1:, :-1] + w11 * sample[1:, 1:]
    return np.asarray(shifted, np.float32)
