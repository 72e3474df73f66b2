"""Edges in a picture, and which way they run: Canny's, and the line through the edge pixels around one.

Canny: A Computational Approach to Edge Detection, TPAMI 1986, doi:10.1109/TPAMI.1986.4767851. Thresholds that
are not given are chosen as MATLAB chooses them.

Angles are those of the edge's tangent, in radians from −π/2 to π/2, anticlockwise from the rows as one sees
them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

_QUIET = 0.7
"""Part of all pixels whose gradient stays below the upper threshold where none is given."""

_LEVELS = 64
"""Levels of gradients among which that threshold is chosen."""

_LOWER = 0.4
"""The lower threshold as a part of the upper one."""

_EIGHT = np.ones((3, 3), bool)


def canny(image: NDArray[Any], *, sigma: float = math.sqrt(2), upper: float | None = None) -> Bool:
    """Edges of a picture.

    Parameters
    ----------
    image
        (H, W), any unit.
    sigma
        Spread of the Gaussian, px.
    upper
        Upper threshold as a part of the largest gradient; an edge begins above it and goes on above 0.4 of
        it. None: seven tenths of the pixels lie below it.

    Returns
    -------
    (H, W), True on edges.
    """
    from scipy import ndimage

    levels = image.astype(np.float64)
    down, across = (
        ndimage.gaussian_filter(levels, sigma, order=order, mode="nearest") for order in ((1, 0), (0, 1))
    )
    strength = np.hypot(down, across)
    largest = strength.max()
    # What rounding leaves where nothing changes is no edge.
    if largest <= 1e-9 * max(np.abs(levels).max(), 1e-300):
        return np.zeros(levels.shape, np.bool_)
    strength /= largest
    if upper is None:
        upper = _quiet_threshold(strength)
    crest = _crest(strength, down, across) & (strength > _LOWER * upper)
    pieces, count = ndimage.label(crest, _EIGHT)
    strong = np.zeros(count + 1, np.bool_)
    strong[pieces[crest & (strength > upper)]] = True
    strong[0] = False
    return np.asarray(strong[pieces])


def _quiet_threshold(strength: Float) -> float:
    counts = np.bincount(np.rint(strength * (_LEVELS - 1)).astype(np.int64).ravel(), minlength=_LEVELS)
    return float(np.argmax(np.cumsum(counts) > _QUIET * strength.size) + 1) / _LEVELS


def _crest(strength: Float, down: Float, across: Float) -> Bool:
    """Where the gradient is no weaker than on either side along it, between pixels interpolated."""
    from scipy import ndimage

    steepest = np.maximum(np.abs(down), np.abs(across))
    steepest[steepest == 0] = 1
    y, x = np.indices(strength.shape)
    move = down / steepest, across / steepest
    sides = [
        ndimage.map_coordinates(strength, (y + way * move[0], x + way * move[1]), order=1, mode="nearest")
        for way in (-1, 1)
    ]
    # Either side of an even step is as steep but for rounding.
    return np.asarray(strength >= np.maximum(*sides) - 1e-9)


def colour_edges(picture: NDArray[Any]) -> Bool:
    """Edges in any channel of (H, W, C)."""
    return np.asarray(np.logical_or.reduce([canny(channel) for channel in np.moveaxis(picture, 2, 0)]))


def orientations(edges: Bool, radius: int = 2) -> Float:
    """Angle of the edge through every edge pixel.

    That of the larger axis of the second moments of those edge pixels that hang together with it within a
    window.

    Parameters
    ----------
    edges
        (H, W).
    radius
        Radius of the window, px.

    Returns
    -------
    (H, W) in (−π/2, π/2]; NaN where there is no edge.
    """
    from scipy import ndimage

    side = 2 * radius + 1
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(edges, radius), (side, side))[edges]
    seeds = np.zeros_like(windows)
    seeds[:, radius, radius] = True
    held = ndimage.binary_propagation(seeds, structure=_EIGHT[None], mask=windows)
    y, x = np.mgrid[radius : -radius - 1 : -1, -radius : radius + 1]  # up and right
    count = held.sum(axis=(1, 2))

    def mean(values: NDArray[Any]) -> Float:
        return np.asarray((held * values).sum(axis=(1, 2)) / count)

    middle_x, middle_y = mean(x), mean(y)
    xx, yy = mean(x * x) - middle_x**2, mean(y * y) - middle_y**2
    xy = mean(x * y) - middle_x * middle_y
    angles = np.full(edges.shape, np.nan)
    found = 0.5 * np.arctan2(2 * xy, xx - yy)
    angles[edges] = np.where(found <= -np.pi / 2, np.pi / 2, found)
    return angles


def spread(angles: Float, radius: float) -> Float:
    """Angles of the nearest edge pixel within a radius; NaN where there is none."""
    from scipy import ndimage

    none = np.isnan(angles)
    if none.all():
        return angles.copy()
    distance, nearest = ndimage.distance_transform_edt(none, return_indices=True)
    return np.asarray(np.where(distance <= radius, angles[tuple(nearest)], np.nan))


def spread_largest(angles: Float, radius: int) -> Float:
    """Angles spread to the pixels of a disc around each; where several meet the largest; NaN: none."""
    from scipy import ndimage

    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    known = np.nan_to_num(angles, nan=-np.inf)
    wide = ndimage.grey_dilation(known, footprint=x**2 + y**2 <= radius**2, mode="constant", cval=-np.inf)
    found = np.where(np.isnan(angles), wide, angles)
    return np.asarray(np.where(np.isinf(found), np.nan, found))
