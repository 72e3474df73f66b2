"""Weighted median of a disparity map, steered by the reference view.

Neighbours of the same colour decide; outliers vanish and edges between colours stay sharp. Unlike a mean, a
median makes no disparities that lie between two surfaces. Ma et al.: Constant Time Weighted Median Filtering
for Stereo Matching and Beyond, ICCV 2013, doi:10.1109/ICCV.2013.13.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import single
from lfdepth.engines.base import Engine
from lfdepth.errors import LightFieldError

LARGEST_RADIUS = 15
"""Sums of a window's whole weights then fit 32 bits."""


def weighted_median(
    disparity: NDArray[Any],
    guide: NDArray[Any],
    *,
    radius: int = 2,
    sigma_colour: float = 0.05,
    sigma_space: float = 2.0,
    weight: NDArray[Any] | None = None,
    engine: Engine | None = None,
) -> NDArray[np.float32]:
    """Lower weighted median over (2·radius + 1)² windows, cut at the image's border.

    The first of the window's values, in ascending order, at which the cumulated weight reaches half of the
    total. Pixel q weighs `weight(q)·exp(−‖I(p) − I(q)‖²/(2·σ_colour²) − ‖p − q‖²/(2·σ_space²))` at pixel p,
    rounded to 2⁻²⁰; where all weights of a window round to zero the pixel's value stays.

    Parameters
    ----------
    disparity
        (H, W), finite; any unit.
    guide
        (H, W, C) in [0, 1], such as the reference view (I).
    radius
        Window radius in px, 1 to 15.
    sigma_colour
        Colour distance, in the guide's units, at which a pixel's weight falls to exp(−1/2).
    sigma_space
        The same for the distance in px.
    weight
        (H, W) in [0, 1], such as a confidence; None weighs all pixels alike.
    engine
        Engine; by default the processor's, on one thread.

    Returns
    -------
    (H, W) float32, in the unit of `disparity`.

    Raises
    ------
    LightFieldError
        For shapes that do not match, values outside these ranges, or sigmas that are not positive.
    """
    _check_maps(disparity, guide, weight)
    if not 1 <= radius <= LARGEST_RADIUS:
        raise LightFieldError(f"radius: found {radius}, expected 1 to {LARGEST_RADIUS} px")
    for name, sigma in (("sigma_colour", sigma_colour), ("sigma_space", sigma_space)):
        if not 0 < sigma < np.inf:
            raise LightFieldError(f"{name}: found {sigma}, expected a positive number")
    return (engine or single()).median(
        disparity, guide, weight, radius=radius, sigma_colour=sigma_colour, sigma_space=sigma_space
    )


def _check_maps(disparity: NDArray[Any], guide: NDArray[Any], weight: NDArray[Any] | None) -> None:
    if disparity.ndim != 2 or not np.isfinite(disparity).all():
        found = f"shape {disparity.shape}" if disparity.ndim != 2 else "NaN or infinite values"
        raise LightFieldError(f"disparity: found {found}, expected a finite map (H, W); fill the gaps")
    if guide.ndim != 3 or guide.shape[:2] != disparity.shape or not np.isfinite(guide).all():
        raise LightFieldError(
            f"guide: found shape {guide.shape}, expected finite (H, W, C) of the disparity's size "
            f"{disparity.shape}; pass the reference view in [0, 1]"
        )
    if weight is None:
        return
    if weight.shape != disparity.shape or not (weight.min() >= 0 and weight.max() <= 1):
        raise LightFieldError(
            f"weight: found shape {weight.shape} with values from {weight.min():g} to {weight.max():g}, "
            f"expected {disparity.shape} with values in [0, 1]; scale it"
        )
