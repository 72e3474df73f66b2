"""Disparity between planes: local planes fitted to the minima of every pixel's own energy.

Paths decide near which plane a surface lies, but their penalties draw it towards whole planes. A pixel's own
energy, on which no neighbour has a say, has its minimum where the surface is, and the more texture there is
the sharper it is. So the minimum is looked for beside the plane that the paths chose, and a plane is fitted
to the minima around a pixel, weighted by their sharpness, by likeness of colour, and by distance; minima of
another surface, further away than a few planes, do not count. What has no texture keeps its paths'
disparity, which stands in with a weight of its own (`_PRIOR`). As only every other pixel takes part in a fit,
a last mean over neighbours makes the lattices of even and odd pixels agree.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import single
from lfdepth.engines.base import Array, Engine

SPACING = 2
"""Every other pixel of every other row takes part in a fit."""

_GATE = 0.175  # px per view step beyond which another surface begins; at least 1.5 planes
_PRIOR = 2.0  # energy per (px per view step)², as sharp as the minimum of a faint texture
_RIDGE = 4.0  # the same per px² of image, that keeps planes level where hardly anything takes part
_SHARPNESS = 10.0  # weights fall as exp(−_SHARPNESS · Σ_channels |ΔI|), I in [0, 1]


def fit_surfaces(
    position: NDArray[np.float32],
    energy: tuple[Array, Array, NDArray[np.float32]],
    guide: NDArray[np.float32],
    step: float,
    radius: int,
    *,
    engine: Engine | None = None,
) -> NDArray[np.float32]:
    """Place disparities between planes.

    Parameters
    ----------
    position
        (H, W) places of the paths' minima, in planes from the first.
    energy
        Sign energies (K, H, W), photo-consistency (K, H, W) in 1/255, both the engine's, and its weight (H,
        W).
    guide
        (H, W, C) reference view in [0, 1].
    step
        Distance of planes, px per view step.
    radius
        Radius of the fits in px, a multiple of `SPACING`.
    engine
        Engine; by default the processor's, on one thread.

    Returns
    -------
    (H, W) places in planes from the first.
    """
    return (engine or single()).fit_planes(
        position,
        *energy,
        guide,
        radius=radius,
        spacing=SPACING,
        gate=max(_GATE / step, 1.5),
        prior=_PRIOR * step**2,
        ridge=_RIDGE * step**2 * SPACING**2,
        sharpness=_SHARPNESS,
    )
