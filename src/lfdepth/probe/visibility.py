"""Points of the reference view whose surroundings are one surface, and the views that show them.

A coarse map is enough: what is nearer at the places where a view would show a point hides it there. Thin
wires hide a part of many windows, all changed to the same side, so that no robust fit leaves them out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.boxes import local_largest, local_range
from lfdepth.lightfield import LightField
from lfdepth.probe.matching import make_probe, match, plane_range, shrink_to

if TYPE_CHECKING:
    from lfdepth.engines.base import Engine

Array = NDArray[np.float64]
Map = NDArray[np.float32]

# Planes per px by which the outermost view moves; by how much of that px something nearer hides a point, and
# up to how much of it surroundings are one surface.
_PLANES, _NEARER, _FLAT = 4, 0.5, 1.0


def surface_map(
    lf: LightField, range: tuple[float, float], side: int, rings: tuple[float, ...], engine: Engine
) -> tuple[Map, float]:
    """Coarse disparity (H, W) by the levels of views of equal brightness, thin things kept; and its unit.

    Parameters
    ----------
    lf
        Light field, of equal brightness.
    range
        (min, max) disparity, px per view step.
    side
        Shorter side, px, to which larger views are shrunk.
    rings
        How far out views are looked at (`make_probe`).
    engine
        Engine.

    Returns
    -------
    Disparity of every pixel of the shrunk views, px per view step; that by which the outermost view moves by
    one of these pixels.
    """
    probe = make_probe(lf, max(-range[0], range[1], 0.1), shrink_to(lf, side), rings, engine=engine)
    found = match(probe, plane_range(*range, probe.unit / _PLANES), engine, halves=True)
    return found.disparity, probe.unit


def of_one_surface(disparity: Map, unit: float) -> Map:
    """The map (H, W), NaN where it changes within 3×3 px by more than the outermost view tells."""
    return np.where(local_range(disparity, 1) < _FLAT * unit, disparity, np.float32(np.nan))


def hidden(
    lf: LightField, surface: Map, unit: float, points: NDArray[np.int64], disparity: Array, engine: Engine
) -> NDArray[np.bool_]:
    """Whether views show something nearer at the place of a point, or beside it.

    Parameters
    ----------
    lf
        Light field.
    surface, unit
        What `surface_map` gives.
    points, disparity
        (N, 2) pixels of the reference view, (N,) px per view step.
    engine
        Engine.

    Returns
    -------
    (V·U, N), False in views that are absent.
    """
    size = np.array(surface.shape)
    scale = np.array(lf.shape[2:4]) / size
    places, moved = (points + 0.5) / scale - 0.5, disparity / scale.mean()
    shrunk = surface / np.float32(scale.mean())
    result = np.zeros((lf.available.size, len(points)), np.bool_)
    for view, step in enumerate(lf.offsets.reshape(-1, 2)):
        if not lf.available.flat[view]:
            continue
        front = local_largest(engine.seen(shrunk, (float(step[0]), float(step[1]))), 1)
        there = np.rint(places - moved[:, None] * step).astype(np.intp).clip(0, size - 1)
        nearer: Any = front[there[:, 0], there[:, 1]] - moved
        result[view] = nearer * scale.mean() > _NEARER * unit
    return result
