"""Whether the views agree with a disparity map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import using
from lfdepth.engines.boxes import box_mean
from lfdepth.lightfield import LightField, luma

if TYPE_CHECKING:
    from lfdepth.engines.base import Engine

Array = NDArray[np.float64]

_POINTS = 3000
# Radius of the windows, and how far off a window shows something else, px; least contrast, of full scale.
_REACH, _ELSEWHERE, _CONTRAST = 2, 5, 0.015


def disagreement(lf: LightField, disparity: NDArray[Any], *, engine: Engine | None = None) -> Array:
    """How far views differ from the reference view at a disparity, as a share of the contrast around.

    Of textured points only. Near 0 where the typical view shows what the reference view shows, near 1 where
    it shows something else near by.

    Returns
    -------
    (N,) array, one value for each point.
    """
    grey = box_mean(luma(lf.reference) / lf.full_scale, _REACH)
    contrast = np.zeros_like(grey)
    for axis in (0, 1):
        for step in (-_ELSEWHERE, _ELSEWHERE):
            contrast += np.abs(np.roll(grey, step, axis) - grey) / 4
    edge = _REACH + _ELSEWHERE
    inner = np.zeros(grey.shape, np.bool_)
    inner[edge:-edge, edge:-edge] = True
    chosen = np.argwhere(inner & (contrast > _CONTRAST) & np.isfinite(disparity))
    chosen = chosen[:: max(1, -(-len(chosen) // _POINTS))].astype(np.int64)
    if not len(chosen):
        return np.zeros(0)
    at = chosen[:, 0], chosen[:, 1]
    with using(engine) as used:
        levels, valid = used.window_means(used.views(lf), chosen, disparity[at].astype(np.float64), _REACH)
    seen = valid.all(axis=-1)
    change = np.abs(luma(levels) / lf.full_scale - grey[at])
    change = np.sort(np.where(seen, change, np.inf), axis=0)
    count = seen.sum(axis=0)
    typical = change[np.minimum(count // 2, len(change) - 1), np.arange(len(chosen))]
    return np.asarray((typical / contrast[at])[count > 4], np.float64)
