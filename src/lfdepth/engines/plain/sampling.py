"""Images looked at between their pixels, and beyond their border."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.layout import Shifts

Whole = NDArray[np.int64]


def repeated(first: int, last: int, length: int) -> Whole:
    """Places first, ..., last − 1 of an axis; beyond its ends the outermost ones again."""
    return np.clip(np.arange(first, last), 0, length - 1)


def moved(image: NDArray[Any], rows: Whole, columns: Whole) -> NDArray[Any]:
    """Image (H, W, ...) at rows × columns, those beyond the border repeating it."""
    height, width = image.shape[:2]
    return image[np.clip(rows, 0, height - 1)[:, None], np.clip(columns, 0, width - 1)]


def shifted(image: NDArray[Any], plane: Shifts, view: tuple[int, int], rows: Whole, columns: Whole) -> Whole:
    """A view's whole levels (H, W, ...), times the weights' sum, where a plane samples it for some pixels."""
    down, across = rows + plane.down[view], columns + plane.across[view]
    w00, w01, w10, w11 = plane.weights[view]
    return np.asarray(
        w00 * moved(image, down, across)
        + w01 * moved(image, down, across + 1)
        + w10 * moved(image, down + 1, across)
        + w11 * moved(image, down + 1, across + 1),
        np.int64,
    )


def inside(y: NDArray[Any], x: NDArray[Any], size: tuple[int, ...]) -> NDArray[np.bool_]:
    """Which places lie within the centres of an image's outermost pixels."""
    return np.asarray((y >= 0) & (y <= size[0] - 1) & (x >= 0) & (x <= size[1] - 1))


def bilinear(image: NDArray[Any], y: NDArray[Any], x: NDArray[Any]) -> NDArray[np.float64]:
    """Colours (N, C) of an image (H, W, C) at places (N,) that lie `inside` it; of others, any."""
    height, width = image.shape[:2]
    y, x = np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)
    top, left = y.astype(np.int64), x.astype(np.int64)
    bottom, right = np.minimum(top + 1, height - 1), np.minimum(left + 1, width - 1)
    down, across = (y - top)[:, None], (x - left)[:, None]
    above = image[top, left] * (1 - across) + image[top, right] * across
    below = image[bottom, left] * (1 - across) + image[bottom, right] * across
    return np.asarray(above * (1 - down) + below * down, np.float64)
