"""Choice among maps: at every pixel the disparity on which the views that show it agree best.

Several maps of one view rarely err alike. At a disparity that is right, the views that show a pixel show its
colour; others are hidden from many views, which therefore have no say: of all views, the quarter that differs
least from the reference view is asked, in windows of 3x3 px. The choice is then smoothed by weighted medians,
in which a pixel weighs the less, the more even these views differ.

That views which see past an occluder are to be found by how well they agree is the idea of Kang, Szeliski and
Chai: Handling Occlusions in Dense Multi-view Stereo, CVPR 2001 (temporal selection, the best half).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.median import weighted_median
from lfdepth.engines import single
from lfdepth.engines.base import Engine
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField, unit

Map = NDArray[np.float32]
Position = tuple[int, int]

_ASKED = 0.25  # share of the views that is asked
_WINDOW = 3  # px, side of the windows over which differences are averaged
_STRIP = 32  # rows that are compared at a time, by one thread
_TRUSTED = 0.004  # difference, in full scale, at which a pixel's weight in the medians falls to 1/e
_LEAST = 1e-3  # weight of a pixel that no disparity fits
_MEDIANS, _RADIUS, _SPACE, _COLOUR = 2, 3, 3.0, 0.05  # how many, px, px, and full scale

REACH = _WINDOW // 2 + _MEDIANS * _RADIUS
"""How far the choice looks beyond a pixel, px."""


def choose(
    lf: LightField,
    maps: Sequence[Map],
    positions: Sequence[Position],
    *,
    engine: Engine | None = None,
) -> Map:
    """At every pixel, of the disparities of several maps, the one on which views agree best; then medians.

    Parameters
    ----------
    lf
        Light field.
    maps
        Maps of the reference view, (H, W) each, px per view step; at least one.
    positions
        Views (v, u) to ask, counted from the reference view; at least one besides that itself.
    engine
        Engine; by default the processor's, on one thread.

    Returns
    -------
    (H, W) float32, px per view step.

    Raises
    ------
    LightFieldError
        If there is no map, or no view to ask.
    """
    others = [position for position in positions if position != (0, 0)]
    if not maps or not others:
        raise LightFieldError(
            f"choose: found {len(maps)} maps and {len(others)} views beside the reference view, expected at "
            "least one of each; give more"
        )
    used = engine or single()
    guide = unit(lf.reference, lf.full_scale)
    disagreement = _disagreement(lf, guide, maps, others, used)
    best = disagreement.argmin(axis=0)[None]
    disparity: Map = np.take_along_axis(np.stack(maps), best, axis=0)[0]
    least = np.take_along_axis(disagreement, best, axis=0)[0]
    weight = np.clip(np.exp(-least / np.float32(_TRUSTED)), _LEAST, 1)
    for _ in range(_MEDIANS):
        disparity = weighted_median(
            disparity,
            guide,
            radius=_RADIUS,
            sigma_colour=_COLOUR,
            sigma_space=_SPACE,
            weight=weight,
            engine=used,
        )
    return disparity


def _disagreement(
    lf: LightField, reference: Map, maps: Sequence[Map], positions: Sequence[Position], engine: Engine
) -> NDArray[np.float32]:
    """How much the views that agree best differ from the reference view at the maps' disparities, (M, H, W).

    In full scale, the mean over channels, windows and these views.
    """
    v, u = lf.centre
    splines = engine.each(
        lambda position: _splines(unit(lf.views[v + position[0], u + position[1]], lf.full_scale)), positions
    )
    found = np.empty((len(maps), *reference.shape[:2]), np.float32)

    def compare(first: int) -> None:
        """Some rows; the windows reach one row further."""
        rows = slice(first, min(first + _STRIP, lf.height))
        around = slice(max(first - _WINDOW // 2, 0), min(rows.stop + _WINDOW // 2, lf.height))
        inner = slice(rows.start - around.start, rows.stop - around.start)
        for disparity, out in zip(maps, found, strict=True):
            differences = _differences(splines, positions, reference, disparity, around)
            out[rows] = _mean_of_least(differences)[inner]

    engine.each(compare, range(0, lf.height, _STRIP))
    return found


def _differences(
    splines: Sequence[Map], positions: Sequence[Position], reference: Map, disparity: Map, rows: slice
) -> NDArray[np.float32]:
    """Mean absolute differences between views and some rows of the reference view, (N, rows, W)."""
    from scipy import ndimage  # here, since listing the methods needs no SciPy

    down, across = np.mgrid[rows, : disparity.shape[1]].astype(np.float32)
    true, disparity = reference[rows], disparity[rows]
    found = np.zeros((len(positions), *disparity.shape), np.float32)
    for difference, (v, u), spline in zip(found, positions, splines, strict=True):
        places = down - disparity * np.float32(v), across - disparity * np.float32(u)
        for channel, coefficients in enumerate(spline):
            shown = ndimage.map_coordinates(coefficients, places, order=3, prefilter=False, mode="nearest")
            difference += np.abs(shown - true[..., channel])
        difference /= np.float32(len(spline))
    return found


def _mean_of_least(differences: NDArray[np.float32]) -> Map:
    """Mean over windows, then over the views that differ least, (rows, W)."""
    from scipy import ndimage  # here, since listing the methods needs no SciPy

    asked = max(1, round(_ASKED * len(differences)))
    means = ndimage.uniform_filter(differences, (0, _WINDOW, _WINDOW))
    return np.asarray(np.partition(means, asked - 1, axis=0)[:asked].mean(axis=0), np.float32)


def _splines(view: Map) -> Map:
    """Coefficients of cubic splines through a view, (C, H, W)."""
    from scipy import ndimage  # here, since listing the methods needs no SciPy

    return np.stack(
        [ndimage.spline_filter(channel, 3, output=np.float32) for channel in np.moveaxis(view, 2, 0)]
    )
