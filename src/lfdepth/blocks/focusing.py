"""Averages of the views where they show the points of a surface: what a lens as wide as the grid would see.

A point that the reference view shows at (x, y) with disparity D is at (x − D·u, y − D·v) in view (u, v).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.base import Engine, Float
from lfdepth.engines.boxes import local_largest
from lfdepth.lightfield import LightField


def present_views(lf: LightField) -> Iterator[tuple[tuple[int, int], float, float]]:
    """Index of each view that is there, and where it stands: v down and u across from the reference view."""
    offsets = lf.offsets
    for row, column in np.argwhere(lf.available).tolist():
        v, u = offsets[row, column]
        yield (row, column), float(v), float(u)


def average(
    lf: LightField, focus: Float, engine: Engine, *, surface: Float | None = None, limit: Float | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Mean (H, W, C) of the views that show the points at disparity `focus`, and how many (H, W) do.

    With the `surface` that the reference view sees, views do not count where they show something nearer than
    `limit`, a disparity for each point. The mean is in the views' levels, 0 where no view shows a point.
    """
    total: NDArray[np.float32] = np.zeros((lf.height, lf.width, lf.shape[4]), np.float32)
    count: NDArray[np.float32] = np.zeros((lf.height, lf.width), np.float32)
    front = np.zeros_like(focus)
    if limit is None:
        limit = np.full_like(focus, np.inf)
    for index, v, u in present_views(lf):
        if surface is not None:
            # At a boundary, a pixel shows both surfaces.
            front = local_largest(engine.seen(surface, (v, u)), 1)
        engine.gather(lf.views[index], (v, u), focus, total, count, front=front, limit=limit)
    total /= np.maximum(count, 1)[..., None]
    return total, count
