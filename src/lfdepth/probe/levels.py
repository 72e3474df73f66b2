"""Whether the mean levels of views differ by more than what moves through them explains."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lfdepth.lightfield import LightField, luma

Array = NDArray[np.float64]

# Of the reference view's level: scenes of the suite reach 0.6 and 8 %, of 32 to 60 px, 3x3 to 9x9 views;
# gains of 5 % at least 2.4 %, corner views at 80 % at least 14 % (docs/research-log.md).
_STEPS, _FALL = 0.012, 0.105
# Standard deviation over median; variance of the difference between a value and the mean of its neighbours.
_DEVIATION, _BESIDE = 1.48, 1.5


def view_levels(lf: LightField) -> Array:
    """Mean level (V, U) of each view over that of the reference view, NaN where views are absent.

    Where the reference view is black, nothing is known of any.
    """
    mean = luma(lf.views.mean(axis=(2, 3))[:, :, None, None])[:, :, 0, 0].astype(np.float64)
    mean[~lf.available] = np.nan
    own = float(mean[lf.centre])
    return mean / own if own > 0 else np.full_like(mean, np.nan)


def unevenness(level: Array, centre: tuple[int, int]) -> float:
    """By how much levels (V, U) differ from view to view; 0 where the scene may explain it.

    What moves into and out of the views changes their levels smoothly from view to view, and by little. Gains
    of cameras differ from one to the next; the levels of plenoptic cameras fall towards the outer views.
    """
    steps, fall = _steps(level), _fall(level, centre)
    return max(steps if steps > _STEPS else 0.0, fall if fall > _FALL else 0.0)


def _steps(level: Array) -> float:
    """Typical difference between the level of a view and that of its neighbours in its row or column."""
    beside = [(rows[:, 1:-1] - (rows[:, :-2] + rows[:, 2:]) / 2).ravel() for rows in (level, level.T)]
    known = np.concatenate(beside)
    known = known[np.isfinite(known)]
    return _DEVIATION * float(np.median(np.abs(known))) / _BESIDE**0.5 if known.size else 0.0


def _fall(level: Array, centre: tuple[int, int]) -> float:
    """How far the level falls from the reference view to the corners, besides from side to side."""
    down, across = (np.arange(size) - at for size, at in zip(level.shape, centre, strict=True))
    v, u = np.meshgrid(down / max(abs(down).max(), 1), across / max(abs(across).max(), 1), indexing="ij")
    known = np.isfinite(level)
    if np.count_nonzero(known) < 9:
        return 0.0
    design = np.stack([np.ones_like(v), v, u, (v * v + u * u) / 2], axis=-1)[known]
    return -float(np.linalg.lstsq(design, level[known], rcond=None)[0][3])
