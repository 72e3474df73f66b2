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
        (H, W) float32 in [0, 1]: how far the evidence speaks for the disparity.
    range
        (min, max) disparity that was searched.
    planes
        Number of planes that were searched; 0 for a method without planes.
    runtime
        Seconds for the estimate, reading and compiling excluded where they came before.
    method
        The method with all its parameters.
    engine
        Name of the engine.
    version
        Version of lfdepth.
    range_found
        Whether the range was found from the views, for want of a given one.
    equalisation
        How the brightness of the views differed; None if it was not looked at.
    sigma
        (H, W) float32, standard error in px per view step: about 68 % of the pixels that are not outliers
        lie within it; None from a method that does not tell, or without refinement.
    checks
        Whether the views agree with the map, and what may be wrong; None if that was not looked at.
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


@dataclass(frozen=True, eq=False)
class ViewMaps:
    """Disparity of every view of a light field.

    Attributes
    ----------
    disparity
        (V, U, H, W) float32, px per view step, positive nearer; NaN for absent views.
    confidence
        (V, U, H, W) float32 in [0, 1]; 0 for absent views.
    visible
        (V, U, H, W) bool: pixels whose surface the reference view shows as well.
    reference
        The reference view's own estimate, from which the maps were made.
    consistency
        Share of the pixels that hold in the views they were compared with: some pixel around the place they
        land on has their disparity within 0.1 px per view step. Where something nearer is there, a pixel is
        hidden and does not count.
    runtime
        Seconds for all of it.
    """

    disparity: NDArray[np.float32]
    confidence: NDArray[np.float32]
    visible: NDArray[np.bool_]
    reference: Result
    consistency: float
    runtime: float
