"""Photo-consistency votes: how many views show the reference view's colour at one disparity plane.

The share peaks at the surface's plane. Views that an occluder covers lower the peak but do not move it; the
disparity sign's profile, for its part, is smooth and precise between planes. What counts as the same colour
adapts to the local contrast, as a shift by a part of a plane's distance changes a textured pixel more than an
even one; an idea of the occlusion-aware vote cost of Han et al., TPAMI 2022, doi:10.1109/TPAMI.2021.3105523.

All channels take part, in 1/128 of an 8-bit level, and shifts are rounded to 1/128 px. Levels of 8-bit views
times bilinear weights are then whole numbers of 15 bits, and every count is exact. Views of 16 bits or floats
are rounded to 1/128 of a level, and so are their interpolated levels; the same levels give the same votes in
either form.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import single
from lfdepth.engines.base import Engine
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import FULL_SCALE, LightField, reference_index

FEWEST_VIEWS = 25
"""Views that thinning leaves."""

LARGEST_THRESHOLD = 0.5
"""Of full scale. A bound on the sum over three channels then fits 16 bits."""


def thinned(present: NDArray[np.bool_], *, sparse: bool) -> NDArray[np.bool_]:
    """Views (V, U) enough to count photo-consistency: neighbouring views say much the same.

    Half of them, as the white squares of a chessboard whose reference view is white; with `sparse`, every
    other row and column of them. No fewer than `FEWEST_VIEWS` remain, or else the denser choice is made.
    """
    middle = reference_index((present.shape[0], present.shape[1]))
    v, u = (abs(np.arange(count) - at) % 2 for count, at in zip(present.shape, middle, strict=True))
    chessboard = np.asarray(present & (v[:, None] == u))
    lattice = np.asarray(present & (v[:, None] == 0) & (u == 0))
    for choice in (lattice, chessboard) if sparse else (chessboard,):
        if np.count_nonzero(choice) >= FEWEST_VIEWS:
            return choice
    return present


def local_thresholds(
    reference: NDArray[Any], slope: float = 0.2, low: float = 0.003, high: float = 0.02
) -> NDArray[np.float32]:
    """Colour difference per pixel below which two views agree.

    The change that a misregistration by `slope` px causes: `slope` times the largest absolute difference to
    the left, right, upper and lower neighbour, the mean over channels, clipped to [`low`, `high`]; after Han
    et al., TPAMI 2022, doi:10.1109/TPAMI.2021.3105523.

    Parameters
    ----------
    reference
        (H, W, C) reference view, uint8, uint16 or float32 (full scale 255, 65535 or 1).
    slope
        Tolerated misregistration in px, not negative.
    low, high
        Bounds as fractions of full scale, 0 < low ≤ high ≤ 0.5; `low` allows for noise.

    Returns
    -------
    (H, W) float32, fractions of full scale.

    Raises
    ------
    LightFieldError
        For another shape or sample type of the view, or values outside the ranges above.
    """
    if reference.ndim != 3 or reference.dtype.name not in FULL_SCALE:
        raise LightFieldError(
            f"reference: found {reference.dtype} of shape {reference.shape}, "
            "expected a uint8, uint16 or float32 view (H, W, C); convert it"
        )
    if not (0 <= slope < np.inf and 0 < low <= high <= LARGEST_THRESHOLD):
        raise LightFieldError(
            f"thresholds: found slope {slope}, low {low}, high {high}, expected slope ≥ 0 "
            f"and 0 < low ≤ high ≤ {LARGEST_THRESHOLD}; change them"
        )
    # Differences of whole levels are exact in any type that holds them.
    exact = {"uint8": np.int16, "uint16": np.int32, "float32": np.float64}
    image = reference.astype(exact[reference.dtype.name])
    contrast = np.zeros_like(image)
    for axis in (0, 1):
        change = np.abs(np.diff(image, axis=axis))
        for side in (slice(1, None), slice(None, -1)):
            part = contrast[side] if axis == 0 else contrast[:, side]
            np.maximum(part, change, out=part)
    scale = slope / (FULL_SCALE[reference.dtype.name] * image.shape[2])
    return np.asarray(np.clip(contrast.sum(axis=2) * scale, low, high), np.float32)


def photo_consistency(
    lf: LightField,
    disparity: float,
    *,
    thresholds: NDArray[Any] | None = None,
    engine: Engine | None = None,
) -> NDArray[np.float32]:
    """Share of the views that show the reference view's colour at one plane.

    A view counts where the mean over channels of its absolute difference to the reference view's pixel, after
    reparameterisation (eq. 1), is below the pixel's threshold.

    Parameters
    ----------
    lf
        Light field.
    disparity
        Plane in px per view step.
    thresholds
        (H, W) fractions of full scale, in (0, 0.5]; default `local_thresholds` of the reference view.
    engine
        Engine; by default the processor's, on one thread.

    Returns
    -------
    (H, W) float32 in (0, 1]: counted views over present ones, the reference view among both.

    Raises
    ------
    LightFieldError
        For thresholds of another shape or outside their range, or a disparity that is not finite.
    """
    if not np.isfinite(disparity):
        raise LightFieldError(f"disparity: found {disparity}, expected a finite number of px per view step")
    if thresholds is None:
        thresholds = local_thresholds(lf.reference)
    if thresholds.shape != lf.shape[2:4]:
        raise LightFieldError(
            f"thresholds: found shape {thresholds.shape}, expected {lf.shape[2:4]} like the views; "
            "resize them"
        )
    lowest, highest = float(thresholds.min()), float(thresholds.max())
    if not (lowest > 0 and highest <= LARGEST_THRESHOLD):
        raise LightFieldError(
            f"thresholds: found values from {lowest:g} to {highest:g}, "
            f"expected fractions of full scale in (0, {LARGEST_THRESHOLD}]; clip them"
        )
    used = engine or single()
    views = used.colour_views(lf, disparity)
    out = used.empty(views.size, np.float32)
    used.photo(views, disparity, used.upload(thresholds.astype(np.float32)), out)
    return np.asarray(used.download(out), np.float32)
