"""Depth edges decided pixel by pixel with exact visibility.

Most of what is wrong in a smoothed map lies within one pixel of a depth edge, and most of that is foreground
too fat, because a pixel that mixes both surfaces moves with the nearer one. There, however, the other views
know more, and exact visibility (`visibility`) says which of them see past the edge. Their mean colour at the
background's disparity is the colour `B` that the background has at this very pixel; the foreground's colour
`F` comes from the nearest pixels inside it. The pixel belongs to the background if its own colour is nearer
to B than to F, each distance measured by that surface's spread. In doubt a pixel keeps its side: the more
views agree with it at its present disparity, the more the colours must say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.median import weighted_median
from lfdepth.blocks.photo import local_thresholds
from lfdepth.engines import single
from lfdepth.engines.base import Engine
from lfdepth.engines.boxes import local_range
from lfdepth.lightfield import LightField, unit
from lfdepth.trace import Trace

_MEDIAN_RADIUS, _MEDIAN_COLOUR, _MEDIAN_SPACE = 1, 0.05, 2.0  # px, and standard deviations
_SURE_PASSES, _LATE = 2, 3.0  # later passes, into wide bands, must be surer by this factor
_EDGE_TRUST = 0.3
_UNSTEADY = 0.15  # px per view step within two pixels that cost a pixel a third of its trust


@dataclass(frozen=True, kw_only=True)
class EdgeRule:
    """How depth edges are decided.

    Parameters
    ----------
    passes
        Passes over the edges; each can move an edge by one pixel, from the third on with three times the
        inertia; 0 leaves the map as it is.
    jump
        Least difference of disparity between neighbours that makes an edge, px per view step.
    spread
        Spread of either surface's colour at least, as a share of the distance between their colours.
    inertia
        How much more the colours must say when all views agree with the present side.
    """

    passes: int = 3
    jump: float = 0.15
    spread: float = 0.3
    inertia: float = 3.0


class DepthEdges:
    """Decides the depth edges of maps of one light field.

    Parameters
    ----------
    lf
        Light field.
    rule
        Parameters.
    engine
        Engine; by default the processor's, on one thread.
    trace
        May keep "median", the map (H, W) without isolated values, before edges are decided.
    """

    def __init__(
        self,
        lf: LightField,
        rule: EdgeRule,
        *,
        engine: Engine | None = None,
        trace: Trace | None = None,
    ) -> None:
        self.rule = rule
        self._engine = engine or single()
        self._trace = trace or Trace()
        self._views = self._engine.views(lf)
        self._guide = np.ascontiguousarray(unit(lf.reference, lf.full_scale))
        self._thresholds = local_thresholds(lf.reference) * np.float32(255)
        self._found = np.zeros((lf.height, lf.width), np.bool_)
        self._spare: Any = None

    def decide(self, disparity: NDArray[np.float32], *, passes: int | None = None) -> NDArray[np.float32]:
        """Remove isolated values from a map (H, W), then decide every pixel beside a depth edge.

        `passes` replaces the rule's if it is smaller.
        """
        decided = weighted_median(
            disparity,
            self._guide,
            radius=_MEDIAN_RADIUS,
            sigma_colour=_MEDIAN_COLOUR,
            sigma_space=_MEDIAN_SPACE,
            engine=self._engine,
        )
        self._trace.take("median", lambda: decided)
        self._found[:] = False
        for count in range(self.rule.passes if passes is None else min(passes, self.rule.passes)):
            decided = self.move(decided, 1.0 if count < _SURE_PASSES else _LATE)
        self._spare = None  # as large as the views
        return decided

    def move(self, disparity: NDArray[np.float32], caution: float = 1.0) -> NDArray[np.float32]:
        """Decide every pixel beside a depth edge once; `caution` is a factor on the rule's inertia."""
        self._spare = self._engine.surfaces_of(disparity, self._views, self._spare)
        return self._engine.decide_edges(
            self._views,
            disparity,
            self._spare,
            self._thresholds,
            self._found,
            jump=self.rule.jump,
            spread=self.rule.spread,
            inertia=self.rule.inertia * caution,
        )

    @property
    def found(self) -> NDArray[np.bool_]:
        """(H, W), the pixels at depth edges of the map that was decided last."""
        return self._found

    def lower_confidence(
        self, confidence: NDArray[np.float32], disparity: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Lower a map's confidence (H, W) where the map just decided has edges, or changes fast."""
        trust = 1 / np.sqrt(1 + (local_range(disparity, 2) / np.float32(_UNSTEADY)) ** 2)
        trust[self._found] *= np.float32(_EDGE_TRUST)
        return np.asarray(confidence * trust, np.float32)
