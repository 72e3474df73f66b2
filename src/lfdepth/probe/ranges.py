"""The range of disparities of a light field, found from its views."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from lfdepth.engines import using
from lfdepth.engines.base import Engine
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField
from lfdepth.probe.matching import (
    IN_ORDER,
    Match,
    Order,
    Probe,
    make_probe,
    match,
    plane_range,
    shrink_to,
    widest,
)


@dataclass(frozen=True)
class Evidence:
    """What makes a surface at an end of the range.

    Attributes
    ----------
    share
        Smallest share of the pixels that lie close together in disparity; at least 8 pixels.
    neighbours
        How many of a pixel's 8 neighbours have to agree with it.
    """

    share: float
    neighbours: int

    def times(self, factor: float) -> Evidence:
        """The same with so many times as many pixels."""
        return replace(self, share=self.share * factor)


# Little of a thin structure is left in shrunk views, and an end too far out only costs time.
COARSE = Evidence(share=5e-4, neighbours=2)
_FINE = Evidence(share=1.5e-3, neighbours=6)
# Of a surface that is seen only through the gaps of another, no pixel has that many neighbours.
_GAPS = Evidence(share=5e-3, neighbours=3)
# Beyond the usual limit only large surfaces count: what is periodic puts others there.
_BEYOND = Evidence(share=1e-2, neighbours=6)
# Of views next to the reference view, which tell of surfaces that the outer ones no longer show.
_NEXT = Evidence(share=2e-2, neighbours=6)
_NEXT_VIEWS, _NEXT_IN_ROW = 3, 5
WIDER = 2.2
"""The wider limit, of the usual one."""

# The part of a limit from which on a range is thought to be cut off; shorter side of small pictures, px.
_CUT_OFF, _SMALL_SIDE = 0.95, 96
_FEWEST = 8
_RINGS = 1.0, 1 / 3
# Shorter side, px, of the views for either sweep.
_COARSE_SIDE, _FINE_SIDE = 256, 1024
# In `Probe.unit`: how well neighbours agree; by how much the fine sweep is wider; the margin of the result.
_AGREEMENT, _MARGIN = 0.25, 0.15
SLACK = 2.0
_NARROWEST, _WIDEST_MARGIN = 1.0, 0.05
# Nearly all pixels; from how far away, in `Probe.unit`, others are doubted; how much, in grey levels.
_BULK, _APART, _DOUBT = (0.05, 0.95), 4.0, 4.0
# How often neighbours are averaged: where the outermost view moves little, single pixels scatter far.
_CALMING = 2
# The `Probe.reach` of 5×5 views; where it is less, as many more pixels have to be at an end.
_USUAL_REACH = 2


def find_range(
    lf: LightField,
    *,
    limit: float | None = None,
    threads: int | None = None,
    engine: Engine | None = None,
) -> tuple[float, float]:
    """Estimate the range of disparities from the views.

    A coarse sweep of shrunk views over a wide range, then a fine one over what the first one found. Surfaces
    count if they have texture and cover at least 0.15 % of the reference view (0.3 % with 3×3 views, 0.5 %
    if they are seen only through gaps). Surfaces behind gaps are missed if the gaps are so narrow that most
    views see something else in them.

    Parameters
    ----------
    lf
        Light field with its views in order; its own range, if it has one, is not looked at.
    limit
        Largest absolute disparity to look for, px per view step; by default the one at which the outermost
        view moves by a quarter of the picture, or half of it where large surfaces lie beyond. Periodic
        texture is ambiguous in a wide range: if nothing is found, narrower ones are tried.
    threads
        Number of threads; None uses all processors. The result does not depend on it.
    engine
        Engine to use instead of the default one.

    Returns
    -------
    (min, max) disparity in px per view step, with a small margin.

    Raises
    ------
    LightFieldError
        If the views agree on no disparity, because there is no texture or their order is wrong; if
        disparities reach the limit, be it only in views next to the reference view; or if the limit is not
        positive.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("bars", size=96, views=5)
    >>> low, high = lfdepth.find_range(lf)
    >>> bool(low < lf.truth.min() + 0.3), bool(high > lf.truth.max() - 0.3)
    (True, True)
    """
    given = limit
    limit = widest(lf) if limit is None else limit
    if not (isfinite(limit) and limit > 0):
        raise LightFieldError(f"limit: found {limit}, expected a positive number of px per view step")
    with using(engine, threads=threads) as used:
        if given is None and _reaches_beyond(lf, limit, used):
            limit *= WIDER
        coarse = make_probe(lf, limit, shrink_to(lf, _COARSE_SIDE), _RINGS, engine=used)
        found = coarse_range(coarse, limit, used)
        hidden = given is None and _is_beyond_in_next(lf, limit, used)
        if found is not None:
            farthest = max(-found[0], found[1])
            probe = make_probe(lf, farthest, shrink_to(lf, _FINE_SIDE), _RINGS, engine=used)
            fine = match(probe, plane_range(*found, probe.unit / 2), used)
            found = _fine_ends(fine, probe.unit, max(1.0, _USUAL_REACH / probe.reach))
    if found is None:
        raise LightFieldError(
            f"{lf.name}: views agree on no disparity within {limit:g} px per view step; expected texture "
            "that moves with the views; give --range MIN MAX (range=(min, max) in Python), or check the order"
        )
    if hidden or max(-found[0], found[1]) > _CUT_OFF * limit:
        raise LightFieldError(
            f"{lf.name}: disparities reach the search limit of {limit:g} px per view step, at which the "
            f"outermost view moves by {limit * probe.reach:.0f} px; expected them within; "
            "give --range MIN MAX (range=(min, max) in Python)"
        )
    room = margin(lf)
    return found[0] - room, found[1] + room


def margin(lf: LightField) -> float:
    """How far beyond the outermost surfaces the range ends that is found, px per view step."""
    reach = float(np.abs(lf.offsets[lf.available]).max())
    return min(_MARGIN * shrink_to(lf, _FINE_SIDE) / reach, _WIDEST_MARGIN)


def _reaches_beyond(lf: LightField, limit: float, engine: Engine) -> bool:
    """Whether small pictures show surfaces beyond a limit."""
    wider = WIDER * limit
    probe = make_probe(lf, wider, shrink_to(lf, _SMALL_SIDE), _RINGS, engine=engine)
    found = ends(match(probe, plane_range(-wider, wider, probe.unit), engine), probe.unit, _BEYOND)
    return found is not None and max(-found[0], found[1]) > _CUT_OFF * limit - probe.unit


def _is_beyond_in_next(lf: LightField, limit: float, engine: Engine) -> bool:
    """Whether the views next to the reference view show surfaces that move too far for the others."""
    most = _NEXT_VIEWS if min(lf.shape[:2]) > 1 else _NEXT_IN_ROW
    v, u = (min(most, size) for size in lf.shape[:2])
    inner = lf.angular_crop(v, u)
    wider = WIDER * widest(inner)
    if inner.shape == lf.shape or wider <= limit or np.count_nonzero(inner.available) < 2:
        return False
    probe = make_probe(inner, wider, shrink_to(inner, _SMALL_SIDE), (1.0,), engine=engine)
    found = ends(match(probe, plane_range(-wider, wider, probe.unit), engine), probe.unit, _NEXT)
    return found is not None and max(-found[0], found[1]) > limit + probe.unit


def coarse_range(
    probe: Probe, limit: float, engine: Engine, order: Order = IN_ORDER
) -> tuple[float, float] | None:
    """Range that holds all surfaces and some more; None if none is found.

    Parameters
    ----------
    probe
        Shrunk views.
    limit
        Largest |D| to look for, px per view step; if nothing is found, it is halved.
    engine
        Engine.
    order
        How the views are taken.
    """
    while limit > _NARROWEST / 2:
        found = ends(match(probe, plane_range(-limit, limit, probe.unit), engine, order), probe.unit, COARSE)
        if found is not None:
            return found[0] - SLACK * probe.unit, found[1] + SLACK * probe.unit
        limit /= 2
    return None


def _fine_ends(found: Match, unit: float, scatter: float) -> tuple[float, float] | None:
    """Ends by the better evidence, unless the weaker one shows a surface that lies apart from them.

    `scatter` is above 1 for few views, where single pixels err more.
    """
    for _ in range(_CALMING):
        found = found.calmed(_AGREEMENT * unit)
    found = _doubted(found, unit, np.float32(_DOUBT * (scatter - 1)))
    weak, strong = ends(found, unit, _GAPS.times(scatter)), ends(found, unit, _FINE.times(scatter))
    if weak is None or strong is None:
        return weak
    low = weak[0] if weak[0] < strong[0] - unit else strong[0]
    high = weak[1] if weak[1] > strong[1] + unit else strong[1]
    return low, high


def _doubted(found: Match, unit: float, doubt: np.float32) -> Match:
    """The same with less trust in pixels far from nearly all others: periodic texture puts some there."""
    known = found.disparity[found.certain]
    if not (known.size and doubt):
        return found
    low, high = np.quantile(known, _BULK)
    apart = (found.disparity < low - _APART * unit) | (found.disparity > high + _APART * unit)
    return replace(found, runner_up=np.where(apart, found.runner_up - doubt, found.runner_up))


def ends(found: Match, unit: float, evidence: Evidence) -> tuple[float, float] | None:
    """Smallest and largest disparity of a surface; None if there is none.

    Wrong matches may lie anywhere in a wide range, but few of them close together; a surface puts many
    pixels within one `unit`. The inner end of the outermost such group counts: beside occlusion boundaries,
    pixels of neither surface are found a little outside.
    """
    disparity = np.sort(found.disparity[found.coherent(_AGREEMENT * unit, evidence.neighbours)])
    count = max(_FEWEST, round(evidence.share * found.disparity.size))
    groups = np.flatnonzero(disparity[count:] - disparity[:-count] <= unit)
    if not groups.size:
        return None
    low, high = float(disparity[groups[0] + count]), float(disparity[groups[-1]])
    return min(low, high), max(low, high)
