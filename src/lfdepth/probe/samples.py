"""What all views show at points of the reference view."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfdepth.lightfield import LightField

if TYPE_CHECKING:
    from lfdepth.engines.base import Engine

# A channel is idle if this share of the samples of the best one is neither black nor white.
_IDLE = 0.05


class Samples(NamedTuple):
    """Windows around N points of the reference view, in all views.

    Attributes
    ----------
    levels
        (V·U, N, C) mean levels, of full scale.
    valid
        (V·U, N, C) whether they are known: in the picture, neither black nor white.
    idle
        (C,) channels that are black or white throughout, as two of three often are under a microscope;
        `valid` is that of the others there.
    """

    levels: NDArray[np.float32]
    valid: NDArray[np.bool_]
    idle: NDArray[np.bool_]

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Whether all channels are known, (V·U, N)."""
        return np.asarray(self.valid.all(axis=-1))


def sample(
    lf: LightField,
    points: NDArray[np.int64],
    disparity: NDArray[np.float64],
    reach: int,
    engine: Engine,
) -> Samples:
    """Mean levels of windows of (2·reach + 1)² px, where views show points.

    Parameters
    ----------
    lf
        Light field.
    points, disparity
        (N, 2) pixels of the reference view, (N,) px per view step.
    reach
        Px around the nearest whole pixel.
    engine
        Engine.
    """
    levels, valid = engine.window_means(engine.views(lf), points, disparity, reach)
    known = valid.sum(axis=(0, 1))
    idle = np.asarray(known < _IDLE * known.max())
    if idle.any():
        valid[..., idle] = valid[..., ~idle].all(axis=-1, keepdims=True)
    return Samples(levels / np.float32(lf.full_scale), valid, idle)
