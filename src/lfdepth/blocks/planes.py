"""The disparity planes of a sweep, front to back."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lfdepth.errors import LightFieldError
from lfdepth.lightfield import check_range

MAX_PLANES = 2000
"""More planes than this are almost always a mistyped step; `force=True` allows them."""


def disparity_planes(
    disparity_range: tuple[float, float],
    *,
    step: float | None = None,
    count: int | None = None,
    force: bool = False,
) -> NDArray[np.float64]:
    """Disparities of the planes, from the nearest to the farthest.

    The first plane lies at the range's upper end (nearest to the camera: the paper's `d_min`, whose sign
    is the opposite of ours); the last one lies on or just beyond the lower end.

    Parameters
    ----------
    disparity_range
        (min, max) in px per view step.
    step
        Distance between planes in px per view step (the paper's `d_step`); exclusive with `count`.
    count
        Number of planes, at least 2, spread evenly over the range (the paper's `K`).
    force
        Allow more than `MAX_PLANES` planes.

    Returns
    -------
    (K,) array, strictly decreasing, evenly spaced.

    Raises
    ------
    LightFieldError
        If the range is reversed, empty or not finite, the step is not positive, the count is below 2,
        or there are too many planes.
    """
    low, high = check_range(disparity_range)
    if (step is None) == (count is None):
        raise LightFieldError(
            f"planes: found step={step} and count={count}, expected exactly one of them; "
            "give a step in px per view step or a number of planes"
        )
    if count is not None:
        if count < 2:
            raise LightFieldError(f"planes: found {count} planes, expected at least 2; raise the number")
        step = (high - low) / (count - 1)
    assert step is not None
    if not (math.isfinite(step) and step > 0):
        raise LightFieldError(
            f"step: found {step}, expected a positive number of px per view step such as 0.05"
        )
    number = count or math.ceil((high - low) / step - 1e-9) + 1
    if number > MAX_PLANES and not force:
        raise LightFieldError(
            f"step: range [{low:g}, {high:g}] with step {step:g} makes {number} planes, expected at most "
            f"{MAX_PLANES}; choose a larger step, or use --force (force=True in Python)"
        )
    return high - step * np.arange(max(number, 2), dtype=np.float64)
