"""Occlusion rules: how foreground found on earlier planes decides which views vote on the next one."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.reparam import reparameterise
from lfdepth.blocks.voting import Mask
from lfdepth.engines import single
from lfdepth.engines.base import Array, Engine
from lfdepth.errors import LightFieldError


def mask_4d(
    mask: NDArray[Any], *, found_at: float, wanted_at: float, views: tuple[int, int] = (9, 9)
) -> NDArray[np.float32]:
    """Carry a mask of the reference view to every view, as seen from another plane (algorithm 2, eq. 7).

    At the plane where the mask was found it lies in register in all views; reparameterising it by the
    distance of the planes, Δ = wanted − found, moves it with the views:
    `F(x, y, u, v) = BW(x − u·Δ, y − v·Δ)`.
    For a mask per view in the view's own coordinates, reparameterise once more by −`wanted_at`.

    Parameters
    ----------
    mask
        (H, W), bool or any weight in [0, 1].
    found_at, wanted_at
        Disparities of the two planes, px per view step.
    views
        Size (V, U) of the camera grid.

    Returns
    -------
    (V, U, H, W) float32 in the mask's range; fractions where its edge falls between pixels.

    Raises
    ------
    LightFieldError
        If the mask is not two-dimensional.
    """
    if mask.ndim != 2:
        raise LightFieldError(
            f"mask: found shape {mask.shape}, expected (H, W); pass a mask of the reference view"
        )
    return reparameterise(np.broadcast_to(mask, (*views, *mask.shape)), wanted_at - found_at)


class SkipMask:
    """The paper's rule: plane k is voted on with the foreground of plane k − J (algorithm 1).

    The J chains of algorithm 1 are independent, so one pass front to back that remembers the last J maps
    does the same.

    Parameters
    ----------
    skip
        The paper's J, at least 1.
    step
        Distance between planes in px per view step.
    engine
        Engine; by default the processor's, on one thread.

    Raises
    ------
    LightFieldError
        If `skip` is below 1.
    """

    def __init__(self, skip: int, step: float, *, engine: Engine | None = None) -> None:
        if skip < 1:
            raise LightFieldError(f"skip: found J = {skip}, expected at least 1 plane")
        self._engine = engine or single()
        self._recent: deque[Array] = deque(maxlen=skip)
        self._offset = -skip * step

    def mask(self) -> Mask | None:
        """Foreground found J planes before the next one; None for the first plane of each chain."""
        if len(self._recent) < (self._recent.maxlen or 0):
            return None
        return Mask(self._recent[0], self._offset)

    def update(self, smoothed: Array) -> None:
        """Remember the foreground of a plane (eq. 7)."""
        self._recent.append(self._engine.foreground(smoothed))
