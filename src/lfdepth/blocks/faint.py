"""Faint surfaces: what sign votes alone say of a disparity where colours say little.

On a plain, faintly shaded surface the photo votes of noisy views have broad peaks with ripples on them. A
ripple is as good a minimum as any to a parabola through three neighbouring planes, so the map stays where the
paths drew it, at the disparity of the surface's rim. The sign energy of such a pixel, which sums votes over
planes, is smooth and has its minimum at the surface, shallow as it is. So a parabola through planes that lie
0.28 px apart says how far the map is from it, with more weight the more curved it is. The mean over the
pixels around goes to the refinement, which fits planes to it.

Occluders drag signs. What a nearer surface may hide from some view, or in the window of the votes, is not
asked, and neither is what lies beside a depth edge.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.jumps import near_jumps
from lfdepth.blocks.noise import ramp
from lfdepth.engines import single
from lfdepth.engines.base import Array, Engine
from lfdepth.engines.boxes import local_largest

Map = NDArray[np.float32]

_SPAN = 0.28  # px per view step from the parabola's middle to its ends
_FARTHEST = 0.3  # px per view step that a minimum may lie from the map
_MOST = 500.0  # information per (px per view step)² of the most curved energy
_HALF = 0.05  # energy per (px per view step)² that has half of it
_TRUSTED = (0.4, 0.9)  # weights of photo votes between which signs lose all their say
_MEAN = 6.0  # px, standard deviation of the window whose minima are averaged
_WINDOW = 7  # px that sign votes reach beyond a pixel: two windows of their filter, and the gradient
_NEARER = 0.12  # px per view step by which a surface has to be nearer to hide another
_EDGE, _BESIDE = 0.15, 3  # px per view step of a depth edge, and px to either side that mix two surfaces


def ask_signs(
    signs: Array,
    planes: NDArray[np.float64],
    disparity: Map,
    photo: Map,
    reach: float,
    *,
    engine: Engine | None = None,
) -> tuple[Map, Map]:
    """How far sign energies around a pixel have their minima from a map.

    Parameters
    ----------
    signs
        (K, H, W) sign energies, px per view step; the engine's.
    planes
        (K,) disparities of the planes, front to back, evenly spaced.
    disparity
        (H, W) map, px per view step.
    photo
        (H, W) weight of the photo votes, ≥ 0: signs have a say where it is small.
    reach
        Distance of the farthest view from the reference view along either axis, in view steps, > 0.
    engine
        Engine; by default the processor's, on one thread.

    Returns
    -------
    The change of disparity that the signs ask for, px per view step, and the information it rests on, per (px
    per view step)²; (H, W) float32 each. Both are 0 where nothing can be said.
    """
    step = float(planes[0] - planes[1])
    span = max(round(_SPAN / step), 1)
    if len(planes) < 2 * span + 1:
        return np.zeros_like(disparity), np.zeros_like(disparity)
    used = engine or single()
    volume = used.download(signs).reshape(-1)
    place = ((planes[0] - disparity) / step).astype(np.float32)
    middle = np.clip(np.rint(place).astype(np.intp), span, len(planes) - 1 - span)
    at = middle * place.size + np.arange(place.size).reshape(place.shape)
    before, here, after = (volume.take(at + move * place.size) for move in (-span, 0, span))
    width = np.float32(span * step)
    curvature = np.maximum((before + after - 2 * here) / (2 * width**2), 0)
    asked = np.divide(after - before, 4 * width * curvature, out=np.zeros_like(here), where=curvature > 0)
    asked += np.float32(step) * (place - middle)
    say = (1 - ramp(photo, *_TRUSTED)) * ~partly_hidden(disparity, reach)
    say *= ~near_jumps(disparity, _EDGE, _BESIDE)
    information = (np.float32(_MOST) * say * curvature / (curvature + np.float32(_HALF))).astype(np.float32)
    bounded = np.clip(asked, -_FARTHEST, _FARTHEST)
    total = used.blur(information, _MEAN)
    mean = np.divide(
        used.blur(information * bounded, _MEAN), total, out=np.zeros_like(total), where=total > 0
    )
    return np.where(information > 0, mean, np.float32(0)), information


def partly_hidden(disparity: Map, reach: float) -> NDArray[np.bool_]:
    """What a nearer surface may hide from some view, or in the window of a vote, (H, W).

    A surface that is nearer by Δ covers what lies up to `reach`·Δ px beside it in the outermost view; a
    window notices it a few px farther away.
    """
    hidden = np.zeros(disparity.shape, np.bool_)
    nearest = disparity
    deepest = float(np.ptp(disparity))
    for distance in range(1, max(disparity.shape)):
        nearer = max(_NEARER, (distance - _WINDOW) / reach)
        if nearer >= deepest:
            break
        nearest = local_largest(nearest, 1)
        hidden |= nearest - disparity > np.float32(nearer)
    return hidden
