"""Depth edges decided pixel by pixel with exact visibility.

Most of what is wrong in a smoothed map lies within one pixel of a depth edge, and most of that is foreground
too fat, because a pixel that mixes both surfaces moves with the nearer one. There, however, the other views
know more. An occluder moves through the views with its own disparity, not with the background's: each pixel
of the map, splatted into every view at *its own* disparity, says exactly which views see past the edge.
Their mean colour at the background's disparity is the colour `B` that the background has at this very pixel;
the foreground's colour `F` comes from the nearest pixels inside it. The pixel belongs to the background if
its own colour is nearer to B than to F, each distance measured by that surface's spread. In doubt a pixel
keeps its side: the more views agree with it at its present disparity, the more the colours must say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.sweep.edges_kernels import EMPTY, edge_kernel, splat_kernel
from lfdepth.sweep.parallel import Workers


@dataclass(frozen=True, kw_only=True)
class EdgeRule:
    """How depth edges are decided.

    Parameters
    ----------
    passes
        Passes over the edges; each can move an edge by one pixel; 0 leaves the map as it is.
    jump
        Least difference of disparity between neighbours that makes an edge, px per view step.
    spread
        Spread of either surface's colour at least, as a share of the distance between their colours.
    inertia
        How much more the colours must say when all views agree with the present side.
    """

    passes: int = 2
    jump: float = 0.15
    spread: float = 0.3
    inertia: float = 3.0


def nearest_per_view(
    disparity: NDArray[np.float32], grid: tuple[int, int], workers: Workers
) -> NDArray[np.float32]:
    """Disparity of the nearest surface at every pixel of every view, (V, U, H, W); `EMPTY` if unknown.

    Every pixel of the map is splatted to the nearest pixel of each view at its own disparity. Surfaces that
    the reference view does not see are unknown.
    """
    height, width = disparity.shape
    nearest = np.full((*grid, height, width), EMPTY, np.float32)
    flat = nearest.reshape(-1, height, width)
    workers.rows(len(flat), splat_kernel, disparity, flat, grid)
    return nearest


def decide_edges(
    disparity: NDArray[np.float32],
    views: NDArray[Any],
    present: NDArray[np.bool_],
    thresholds: NDArray[np.float32],
    rule: EdgeRule,
    workers: Workers,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Decide every pixel beside a depth edge between its two surfaces.

    Parameters
    ----------
    disparity
        (H, W) map of the reference view, px per view step.
    views
        (V, U, H, W, C) uint8, or float32 in 0…255.
    present
        (V, U) which views are there.
    thresholds
        (H, W) difference below which colours agree, as a fraction of full scale.
    rule
        Parameters.
    workers
        Threads.

    Returns
    -------
    The new map (H, W), and where edges were found (H, W).
    """
    at_edge = np.zeros(disparity.shape, np.bool_)
    for _ in range(rule.passes):
        nearest = nearest_per_view(disparity, present.shape, workers)
        decided = disparity.copy()
        workers.rows(
            disparity.shape[0],
            edge_kernel,
            disparity,
            views,
            present,
            nearest,
            thresholds * np.float32(255),
            np.float32(rule.jump),
            np.float32(rule.spread),
            np.float32(rule.inertia),
            decided,
            at_edge,
        )
        disparity = decided
    return disparity, at_edge
