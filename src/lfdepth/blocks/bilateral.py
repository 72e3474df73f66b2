"""Weights of a joint bilateral filter, for `Engine.local_means`.

Tomasi and Manduchi: Bilateral Filtering for Gray and Color Images, ICCV 1998; joint: Petschnigg et al.,
SIGGRAPH 2004.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Window = Literal["square", "disc"]
Colours = Literal["euclidean", "sum"]


def bilateral_weights(
    guide: NDArray[Any],
    radius: int,
    *,
    sigma_colour: float,
    sigma_space: float | None = None,
    colours: Colours = "euclidean",
    window: Window = "square",
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Weights exp(−c²/(2·σ_colour²) − ‖Δp‖²/(2·σ_space²)) of a window's pixels, 1 in all.

    Parameters
    ----------
    guide
        (H, W, C).
    radius
        Of the window, px.
    sigma_colour
        Spread over colours, in the guide's unit.
    sigma_space
        Spread over distances, px; None: all distances weigh alike.
    colours
        How far two colours are apart (c): by their Euclidean distance, or by the sum of absolute differences
        over channels, as in OpenCV.
    window
        All pixels of a square, or those no farther than the radius, as in OpenCV.

    Returns
    -------
    (H, N, W) float32 weights, 0 beyond the border; (N, 2) where the pixels lie, px down and across.
    """
    height, width, _ = guide.shape
    around = [
        (down, across)
        for down in range(-radius, radius + 1)
        for across in range(-radius, radius + 1)
        if window == "square" or down**2 + across**2 <= radius**2
    ]
    image = guide.astype(np.float32)
    padded = np.pad(image, ((radius, radius), (radius, radius), (0, 0)), constant_values=np.nan)
    weights = np.empty((height, len(around), width), np.float32)
    for n, (down, across) in enumerate(around):
        change = padded[radius + down :, radius + across :][:height, :width] - image
        square = (change**2).sum(axis=2) if colours == "euclidean" else np.abs(change).sum(axis=2) ** 2
        space = 0.0 if sigma_space is None else (down**2 + across**2) / (2 * sigma_space**2)
        weights[:, n] = np.exp(-square / np.float32(2 * sigma_colour**2) - np.float32(space))
    np.nan_to_num(weights, copy=False)  # beyond the border
    weights /= weights.sum(axis=1, keepdims=True)
    return weights, np.array(around, np.int64)
