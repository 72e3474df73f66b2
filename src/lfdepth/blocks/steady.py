"""Maps of a video that keep still where the scene does.

Where the reference view shows what it showed before, up to noise, the map before is as good an estimate as
the new one, and made from other noise. Both are averaged, as a Kalman filter of a constant does, while they
are of one surface. Where they are not, the views of this frame choose; where they cannot tell, the estimate
that most frames agreed on stays (a majority vote: R. S. Boyer and J. S. Moore, MJRTY, 1991,
doi:10.1007/978-94-011-3488-0_5). Where the reference view changed, the new map stands; beside that, too, but
where a pixel looks as it did and lies at none of the disparities of what moved there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.noise import texture_weight
from lfdepth.blocks.photo import local_thresholds
from lfdepth.engines import using
from lfdepth.engines.base import Engine
from lfdepth.engines.boxes import box_mean, local_largest
from lfdepth.engines.layout import VISIBILITY_MARGIN
from lfdepth.lightfield import LightField

Map = NDArray[np.float32]


@dataclass(frozen=True)
class SteadyRule:
    """When a map of the past counts.

    Attributes
    ----------
    radius
        Of the windows in which reference views are compared, px.
    mean, absolute
        Largest mean difference, and largest mean absolute difference, over such a window, in noise levels
        (`blocks.noise.Residual.noise`): noise alone leaves less than 1 and about 2 in the brightest places.
    rounding
        What is added to both, of full scale.
    spread
        By how many px what changed is widened: filters and fits reach beyond it.
    plain_spread
        The same where there is no texture, so that a surface that moves shows it only farther away.
    close_radius, close_mean, close_absolute
        Within `spread` of what changed, as `radius`, `mean` and `absolute` for a pixel to look as it did. The
        fewer pixels a window has, the farther noise alone takes its means.
    apart
        How far such a pixel must be, in both maps, from all disparities of what moved within `plain_spread`,
        px per view step.
    gate
        Largest difference of two estimates of one surface, px per view step.
    sigmas, widest
        The gate is as many standard errors instead, where these are known and larger, up to `widest`.
    margin
        By how much more support of the views the new estimate replaces the one before, at once.
    most
        Number of frames that the past counts for, at most.
    least
        Weight of an estimate without confidence; that of a certain one is 1.
    """

    radius: int = 2
    mean: float = 2.0
    absolute: float = 3.0
    rounding: float = 0.002
    spread: int = 3
    plain_spread: int = 8
    close_radius: int = 1
    close_mean: float = 3.5
    close_absolute: float = 4.0
    apart: float = 0.15
    gate: float = 0.1
    sigmas: float = 3.0
    widest: float = 0.3
    margin: float = 0.1
    most: float = 12.0
    least: float = 0.05


@dataclass(frozen=True, eq=False)
class Past:
    """What is known before a frame.

    Attributes
    ----------
    disparity
        (H, W) float32, px per view step.
    weight
        (H, W) float32, in frames.
    reference
        (H, W, C) float32 in [0, 1], the mean of the reference views that count.
    """

    disparity: Map
    weight: Map
    reference: Map


def reference_of(lf: LightField) -> Map:
    """The reference view (H, W, C), as a fraction of full scale."""
    return np.asarray(lf.reference.astype(np.float32) / np.float32(lf.full_scale), np.float32)


def changed(reference: Map, past: Map, noise: float, rule: SteadyRule | None = None) -> NDArray[np.bool_]:
    """Where (H, W) two reference views (H, W, C) differ by more than noise, of full scale."""
    rule = rule or SteadyRule()
    return _differ(reference, past, noise, (rule.radius, rule.mean, rule.absolute), rule.rounding)


def _differ(
    reference: Map, past: Map, noise: float, limits: tuple[int, float, float], rounding: float
) -> NDArray[np.bool_]:
    """Where windows of two reference views differ: `limits` are radius, and means in noise levels."""
    radius, mean, absolute = limits
    difference = reference - past
    means = [
        np.abs(box_mean(difference[..., channel], radius, np.float32))
        for channel in range(difference.shape[-1])
    ]
    total = box_mean(np.abs(difference).mean(axis=-1), radius, np.float32)
    apart = np.maximum.reduce(means) > mean * noise + rounding
    return np.asarray(apart | (total > absolute * noise + rounding), np.bool_)


def steady(
    lf: LightField,
    disparity: Map,
    confidence: Map,
    sigma: Map | None,
    past: Past | None,
    noise: float,
    *,
    rule: SteadyRule | None = None,
    engine: Engine | None = None,
) -> tuple[Map, Past]:
    """Carry a map along.

    Parameters
    ----------
    lf
        This frame.
    disparity, confidence, sigma
        (H, W) of its own estimate; sigma in px per view step, None where it is unknown.
    past
        What is known before this frame; None for the first one.
    noise
        Mean absolute difference of views that noise makes, of full scale.
    rule
        When the past counts.
    engine
        Engine to use instead of the default one.

    Returns
    -------
    (H, W) float32 map of this frame, and what is known after it.
    """
    rule = rule or SteadyRule()
    reference, own = reference_of(lf), _weight(confidence, sigma, rule)
    if past is None:
        return disparity, Past(disparity, own, reference)
    still = _still(lf, disparity, reference, past, noise, rule)
    gate = np.float32(rule.gate)
    if sigma is not None:
        gate = np.clip(rule.sigmas * sigma, rule.gate, rule.widest).astype(np.float32)
    same = still & (np.abs(disparity - past.disparity) <= gate)
    kept, weight = disparity.copy(), own.copy()
    share = own / (own + past.weight)
    kept[same] = (past.disparity + share * (disparity - past.disparity))[same]
    weight[same] = np.minimum(past.weight + own, np.float32(rule.most))[same]
    apart = np.argwhere(still & ~same).astype(np.int64)
    if len(apart):
        at = tuple(apart.T)
        before = np.where(still, past.disparity, disparity)
        stays, left = _disputed(lf, (before, disparity), past, own, apart, rule, engine)
        kept[at] = np.where(stays, past.disparity[at], disparity[at])
        weight[at] = np.where(stays, left, own[at])
    mean = past.reference + share[..., None] * (reference - past.reference)
    return kept, Past(kept, weight, np.where(still[..., None], mean, reference))


def _still(
    lf: LightField, disparity: Map, reference: Map, past: Past, noise: float, rule: SteadyRule
) -> NDArray[np.bool_]:
    """Where (H, W) the past may count: away from what moved, and farther where no texture would show it."""
    moved = changed(reference, past.reference, noise, rule)
    plain = texture_weight(lf, noise) < 0.5
    still = ~_widened(moved, rule.spread) & ~(plain & _widened(moved, rule.plain_spread))
    limits = rule.close_radius, rule.close_mean, rule.close_absolute
    looks_alike = ~_differ(reference, past.reference, noise, limits, rule.rounding)
    return np.asarray(still | (looks_alike & ~_may_have_moved(moved, disparity, past, rule)), np.bool_)


def _may_have_moved(
    moved: NDArray[np.bool_], disparity: Map, past: Past, rule: SteadyRule
) -> NDArray[np.bool_]:
    """Where (H, W) a pixel lies at a disparity of what moved nearby: the nearer one, before and after.

    What moved is what changed, less the ring by which windows make it wider.
    """
    inside = ~_widened(~moved, rule.radius)
    nearer = np.maximum(past.disparity, disparity)
    unknown = np.float32(np.inf)
    highest = local_largest(np.where(inside, nearer, -unknown), rule.plain_spread)
    lowest = -local_largest(np.where(inside, -nearer, -unknown), rule.plain_spread)
    farther = np.minimum(past.disparity, disparity)
    return np.asarray((nearer >= lowest - rule.apart) & (farther <= highest + rule.apart), np.bool_)


def _weight(confidence: Map, sigma: Map | None, rule: SteadyRule) -> Map:
    """Weight (H, W) of an estimate, up to 1."""
    weight = np.clip(confidence, rule.least, 1)
    if sigma is not None:
        precise = np.float32(rule.gate / rule.sigmas)
        weight = weight / (1 + (np.nan_to_num(sigma, nan=1.0, posinf=1.0) / precise) ** 2)
    return np.asarray(np.maximum(weight, rule.least), np.float32)


def _disputed(
    lf: LightField,
    maps: tuple[Map, Map],
    past: Past,
    own: Map,
    places: NDArray[np.int64],
    rule: SteadyRule,
    engine: Engine | None,
) -> tuple[NDArray[np.bool_], Map]:
    """Whether the past stays at places (N, 2) where it differs, and the weight that is left of it.

    The views that each of the `maps`, that of the past and the new one, says to see a place vote for it.
    """
    at = tuple(places.T)
    thresholds = local_thresholds(lf.reference) * np.float32(255)
    support = []
    with using(engine) as used:
        views = used.views(lf)
        for each in maps:
            surfaces, candidates = used.surfaces_of(each, views), np.ascontiguousarray(each[at][:, None])
            support.append(
                used.support(views, surfaces, places, candidates, thresholds, margin=VISIBILITY_MARGIN)[:, 0]
            )
    left = past.weight[at] - own[at]
    stays = (left > -own[at] / 2) & (support[1] <= support[0] + rule.margin)
    return stays, np.maximum(left, np.float32(rule.least))


def _widened(where: NDArray[np.bool_], radius: int) -> NDArray[np.bool_]:
    return np.asarray(box_mean(where, radius, np.float32) > 0.5 / (2 * radius + 1) ** 2, np.bool_)
