"""Disparity signs and their vote (eq. 2-6).

Where the product of a spatial and an angular gradient of the reparameterised light field is positive the
surface lies in front of the plane, where it is negative behind. Only signs enter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.reparam import FULL_SCALE, UNIT, Shifts, ViewStack, round_width, shifts, stack_views
from lfdepth.engines.cpu.voting import sign_kernel, vote_kernel
from lfdepth.engines.cpu.workers import Workers
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField

Delta = Literal["photo", "sign", "none"]
Gradient = Literal["central", "sobel"]

DELTAS: tuple[Delta, ...] = ("photo", "sign", "none")
GRADIENTS: tuple[Gradient, ...] = ("central", "sobel")


@dataclass(frozen=True)
class VoteRule:
    """Which votes count.

    Parameters
    ----------
    delta
        The relaxed Lambertian indicator δ of eq. 4-5: "photo" keeps views whose level differs from the
        reference view's by less than `threshold`; "sign" keeps views whose two signs agree; "none" keeps all.
    threshold
        For "photo", as a fraction of full scale, in (0, 1] (τ).
    gradient
        Spatial gradient: "central" differences or 3×3 "sobel". Angular gradients are central differences,
        one-sided at the outermost views and beside absent ones.

    Raises
    ------
    LightFieldError
        For an unknown name or a threshold outside (0, 1].
    """

    delta: Delta = "photo"
    threshold: float = 0.03
    gradient: Gradient = "central"

    def __post_init__(self) -> None:
        if self.delta not in DELTAS:
            raise LightFieldError(f"delta: found {self.delta!r}, expected one of {', '.join(DELTAS)}")
        if self.gradient not in GRADIENTS:
            raise LightFieldError(
                f"gradient: found {self.gradient!r}, expected one of {', '.join(GRADIENTS)}"
            )
        if not 0 < self.threshold <= 1:
            raise LightFieldError(
                f"threshold: found {self.threshold}, expected a fraction of full scale in (0, 1] such as 0.03"
            )


@dataclass(frozen=True, eq=False)
class Mask:
    """A foreground map of the reference view, to be carried to another plane for every view (eq. 7).

    Parameters
    ----------
    foreground
        (H, W) bool: `BW` at the plane where it was found.
    offset
        Disparity of the plane that is voted on, minus that of the plane where the map was found, in px per
        view step (−J·step in the paper's scheme, front to back).
    """

    foreground: NDArray[np.bool_]
    offset: float


def disparity_signs(
    lf: LightField, disparity: float, *, gradient: Gradient = "central"
) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Signs `S_xu` and `S_yv` of every view's pixels at one plane (eq. 2 and 3).

    Parameters
    ----------
    lf
        Light field with V, U views.
    disparity
        Plane in px per view step.
    gradient
        Spatial gradient operator, "central" or "sobel".

    Returns
    -------
    Two (V, U, H, W) int8 arrays: +1 nearer than the plane, −1 farther, 0 no evidence.
    """
    stack = stack_views(lf, disparity)
    shape = (*stack.grid, *stack.size)
    signs_xu, signs_yv = np.zeros(shape, np.int8), np.zeros(shape, np.int8)
    rule = VoteRule(delta="none", gradient=gradient)
    sign_kernel(0, stack.size[0], signs_xu, signs_yv, *_sampling(stack, disparity), rule.gradient == "sobel")
    return signs_xu, signs_yv


def vote(
    lf: LightField,
    disparity: float,
    *,
    rule: VoteRule | None = None,
    mask: Mask | None = None,
    threads: int | None = 1,
) -> NDArray[np.float32]:
    """Vote of all views on one plane: a slice of the initial volume (eq. 4-6).

    Parameters
    ----------
    lf
        Light field.
    disparity
        Plane in px per view step.
    rule
        Which votes count; default `VoteRule()`.
    mask
        Foreground found at an earlier plane. Pixels inside are voted on by views that see foreground, the
        others by views that do not; None votes with all views.
    threads
        Number of threads.

    Returns
    -------
    (H, W) float32 in [−1, 1]: positive where the surface is nearer than the plane; 0 without evidence.

    Raises
    ------
    LightFieldError
        If the mask has another size than the views.
    """
    stack = stack_views(lf, disparity)
    votes, evidence = np.empty(stack.size, np.float32), np.empty(stack.size, np.float32)
    with Workers(threads) as workers:
        vote_plane(stack, disparity, rule or VoteRule(), mask, workers, votes, evidence)
    return quotient(votes, evidence)


def quotient(votes: NDArray[np.float32], evidence: NDArray[np.float32]) -> NDArray[np.float32]:
    """Votes over evidence, 0 where there is none (the fractions of eq. 4 and 5)."""
    return np.divide(votes, evidence, out=np.zeros_like(votes), where=evidence > 0)


def vote_plane(
    stack: ViewStack,
    disparity: float,
    rule: VoteRule,
    mask: Mask | None,
    workers: Workers,
    votes: NDArray[np.float32],
    evidence: NDArray[np.float32],
) -> None:
    """Count one plane: sum of votes, and number of votes that count, as shares of all possible votes (H, W).

    This is what an engine for other hardware replaces.
    """
    # Levels are whole numbers, so |difference| < τ is |difference| ≤ ceil(τ) − 1.
    tolerance = (
        math.ceil(rule.threshold * FULL_SCALE * UNIT) - 1 if rule.delta == "photo" else FULL_SCALE * UNIT
    )
    padded, reach, placing = _placed_mask(stack, mask)
    options = (rule.gradient == "sobel", rule.delta == "sign", mask is not None)
    workers.rows(
        stack.size[0],
        vote_kernel,
        votes,
        evidence,
        padded,
        reach,
        (placing.down, placing.across, placing.weights.astype(np.int16)),
        *_sampling(stack, disparity),
        tolerance,
        options,
        np.int16(1),
    )


def _sampling(stack: ViewStack, disparity: float) -> tuple[Any, ...]:
    """The kernels' arguments that say how a plane samples the views."""
    plane = shifts(stack.grid, disparity).limited(stack.size)
    shape = (*stack.grid, *stack.size, stack.row_length, stack.margin)
    return stack.data, shape, plane.down, plane.across, plane.weights.astype(np.int16), stack.present


def _placed_mask(stack: ViewStack, mask: Mask | None) -> tuple[NDArray[np.int16], int, Shifts]:
    """The mask, padded as far as the views sample it, the padding, and the sampling."""
    if mask is None:
        return np.empty(0, np.int16), 0, shifts(stack.grid, 0.0)
    if mask.foreground.shape != stack.size:
        raise LightFieldError(
            f"mask: found shape {mask.foreground.shape}, expected {stack.size} like the views; "
            "resize the mask"
        )
    placing = shifts(stack.grid, mask.offset).limited(stack.size)
    reach, width = placing.reach, stack.size[1]
    border = ((reach, reach), (reach, reach + round_width(width) - width))
    return np.pad(mask.foreground.astype(np.int16), border, "edge").reshape(-1), reach, placing
