"""The loop over planes of all methods of this family (algorithm 1): vote, smooth, hand on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.occlusion import SkipMask
from lfdepth.blocks.smoothing import GuidedFilter
from lfdepth.blocks.voting import VoteCount, VoteRule
from lfdepth.engines.base import Array, Engine
from lfdepth.lightfield import LightField
from lfdepth.trace import Trace


def smoothed_votes(
    lf: LightField,
    planes: NDArray[np.float64],
    rule: VoteRule,
    smoothing: GuidedFilter,
    *,
    normalise: bool,
    engine: Engine,
    trace: Trace,
    occlusion: SkipMask | None = None,
) -> Iterator[tuple[int, Array]]:
    """Smoothed votes of the signs, plane by plane from front to back.

    Parameters
    ----------
    lf
        Light field.
    planes
        (K,) disparities front to back.
    rule
        Which votes count.
    smoothing
        Filter of the votes.
    normalise
        Smooth sums of votes and their numbers apart and divide, or smooth the quotient.
    engine, trace
        What to work with. The trace may keep "votes" and "smoothed" of every plane, (H, W) in [−1, 1].
    occlusion
        Rule that masks views by the foreground found before; None lets all views vote.

    Yields
    ------
    Index of a plane, and the engine's slice (H, W) in [−1, 1], which the next plane overwrites. The grey
    views are let go of at the end.
    """
    with trace.block("preparation"):
        views = engine.grey_views(lf, float(np.abs(planes).max()))
        count = VoteCount(engine, views, rule)
        smoothed = engine.empty(views.size, np.float32)
    for index, plane in enumerate(planes):
        with trace.block("voting"):
            count.plane(float(plane), None if occlusion is None else occlusion.mask())
        with trace.block("smoothing"):
            if normalise:
                smoothing.smooth_quotient(count.votes, count.evidence, smoothed)
            else:
                smoothing.smooth(count.quotient(), smoothed)
        if occlusion is not None:
            occlusion.update(smoothed)
        trace.take("votes", lambda: engine.download(count.quotient()))
        trace.take("smoothed", lambda: engine.download(smoothed))
        yield index, smoothed
