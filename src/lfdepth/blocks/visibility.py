"""Exact visibility: what is nearest at every pixel of every view.

An occluder moves through the views with its own disparity, not with that of the plane being looked at. So
each pixel of a map is splatted into every view at *its own* disparity, once; in a view's own coordinates a
surface point then stands still while the planes sweep, and the view sees a plane at a pixel unless something
nearer was splatted there. The answer is sampled with the very shift that samples the view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.cpu.visibility import PARTS, SATURATED, splat_kernel
from lfdepth.engines.cpu.workers import Workers

MARGIN = 0.2
"""Surfaces count as nearer only if they are by more than this, px per view step."""


@dataclass(frozen=True, eq=False)
class NearestSurfaces:
    """Nearest disparity per view, and the map it comes from.

    `data` is flat int16 in 1/`PARTS` px, laid out (V, U, H, row_length) with `margin` empty columns on either
    side; `EMPTY` where no surface is known. Surfaces that the reference view does not see are unknown. `rows`
    is the nearest of every row, (V, U, H), flat.
    """

    data: NDArray[np.int16]
    rows: NDArray[np.int16]
    grid: tuple[int, int]
    margin: int
    row_length: int
    disparity: NDArray[np.float32]

    def in_front(self, plane: float) -> tuple[NDArray[np.int16], int]:
        """Which pixels of the reference view lie in front of a plane, (H, W), and the plane's horizon.

        A pixel in front of the plane is voted on by all views: its surface hides the plane in every one, and
        must go on saying that it is in front.
        """
        horizon = int(np.clip(round((plane + MARGIN) * PARTS), -SATURATED, SATURATED))
        return (self.disparity > plane + MARGIN).astype(np.int16), horizon


def nearest_surfaces(
    disparity: NDArray[np.float32],
    present: NDArray[np.bool_],
    margin: int,
    row_length: int,
    workers: Workers,
    spare: NDArray[np.int16] | None = None,
) -> NearestSurfaces:
    """Splat a map (H, W) into the present views of a grid (V, U), nearest wins; others stay undefined.

    Beyond ±32 px per view step all disparities are one. `spare` is `data` of a result no longer needed, to be
    written over: fresh memory costs as much as the splats.
    """
    data = np.empty(present.size * disparity.shape[0] * row_length, np.int16) if spare is None else spare
    levels = np.clip(disparity * np.float32(PARTS), -SATURATED, SATURATED).astype(np.int16)
    rows = np.empty(present.size * disparity.shape[0], np.int16)
    workers.rows(present.size, splat_kernel, disparity, levels, present, data, rows, margin, row_length)
    return NearestSurfaces(data, rows, (present.shape[0], present.shape[1]), margin, row_length, disparity)
