"""Views that do not show what the others show: of another scene, mirrored, out of their place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lfdepth.probe.agreement import likeness

if TYPE_CHECKING:
    from lfdepth.engines.base import Engine
    from lfdepth.lightfield import LightField

# How many points tell. Likeness of a foreign view, at most, as a share of the typical view's, and of the best
# beside it in the grid, for it falls with the distance from the reference view: views from cameras up to 15 %
# off the grid reach at least 0.8 of the former, mirrored ones at most 0.66 (docs/research-log.md).
_POINTS, _FOREIGN = 400, 0.7
# Only where the typical view is that like is the map good enough to tell; where a greater share of the views
# is foreign, it is their order or their grid that is wrong.
_TYPICAL, _MOST = 0.6, 0.15


def foreign_views(
    lf: LightField, points: NDArray[np.int64], disparity: NDArray[np.float64], engine: Engine
) -> NDArray[np.bool_]:
    """Which views (V, U) show something else at points than the reference view.

    Local differences are compared, which neither brightness nor a camera that is a little off its place
    changes much. False where too few points are seen, and everywhere if many views seem foreign.

    Parameters
    ----------
    lf
        Light field.
    points, disparity
        (N, 2) pixels of the reference view, (N,) px per view step.
    engine
        Engine.
    """
    some = slice(None, None, max(1, len(points) // _POINTS))
    alike = likeness(lf, points[some], disparity[some], engine)
    alike[lf.centre] = np.nan
    known = np.isfinite(alike)
    typical = float(np.median(alike[known])) if known.any() else 0.0
    found = known & (alike < _FOREIGN * np.minimum(typical, _best_beside(alike)))
    if typical < _TYPICAL or found.sum() > max(1.0, _MOST * known.sum()):
        return np.zeros_like(found)
    return found


def _best_beside(alike: NDArray[np.float64]) -> NDArray[np.float64]:
    """Highest likeness among the views (V, U) next to each, itself left out."""
    rows, columns = alike.shape
    padded = np.pad(np.where(np.isfinite(alike), alike, -1.0), 1, constant_values=-1.0)
    places = [(v, u) for v in range(3) for u in range(3) if (v, u) != (1, 1)]
    return np.asarray(np.max([padded[v : v + rows, u : u + columns] for v, u in places], axis=0))
