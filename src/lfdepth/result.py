"""What an estimate gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lfdepth.methods.base import Method
    from lfdepth.probe.brightness import Equalisation
    from lfdepth.probe.checks import Checks


@dataclass(frozen=True, eq=False)
class Result:
    """A disparity map with its evidence.

    Attributes
    ----------
    disparity
        (H, W) float32, px per view step, positive nearer.
    confidence
        (H, W) float32 in [0, 1]: how well the evidence supports the disparity.
    range
        (min, max) disparity that was searched.
    planes
        Number of planes that were searched; 0 for a method without planes.
    runtime
        Seconds for the estimate, without reading, and without compiling if that was done before.
    method
        The method with all its parameters.
    engine
        Name of the engine.
    version
        Version of lfdepth.
    range_found
        Whether the range was estimated from the views because none was given.
    equalisation
        How the brightness of the views differed; None if it was not measured.
    sigma
        (H, W) float32, standard error in px per view step: the errors of about 68 % of the pixels that are
        not outliers lie within it; None if the method gives none, or without refinement.
    checks
        Whether the views agree with the map, and what may be wrong; None if that was not checked.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> result = lfdepth.estimate(scenes.render("bars", size=64, views=5), effort="fast")
    >>> result.disparity.shape, result.disparity.dtype
    ((64, 64), dtype('float32'))
    >>> result.method.name, result.planes
    ('fbs-vis', 51)
    """

    disparity: NDArray[np.float32]
    confidence: NDArray[np.float32]
    range: tuple[float, float]
    planes: int
    runtime: float
    method: Method
    engine: str
    version: str
    range_found: bool = False
    equalisation: Equalisation | None = None
    sigma: NDArray[np.float32] | None = None
    checks: Checks | None = None
