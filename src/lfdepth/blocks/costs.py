"""Costs of planes by colour differences, and how large a difference two views may have."""

from __future__ import annotations

import numpy as np

from lfdepth.engines.base import Array, Engine
from lfdepth.lightfield import LightField


def drift_thresholds(lf: LightField, misplaced: float, low: float, high: float, *, engine: Engine) -> Array:
    """Colour difference (H, W) below which a view agrees, the engine's, in parts of full scale.

    The mean over all views of how much the reference view changes, as the mean of absolute differences over
    channels, where it is moved by `misplaced` px times the view's offset, clipped to [`low`, `high`] (Han et
    al., TPAMI 2022).
    """
    size = lf.height, lf.width
    views = engine.colour_views(lf, misplaced)
    found, anything = engine.empty(size, np.float32), engine.upload(np.full(size, 2, np.float32))
    engine.differences(views, misplaced, anything, found, beyond=1.0, itself=True)
    return engine.upload(np.clip(engine.download(found), low, high).astype(np.float32))
