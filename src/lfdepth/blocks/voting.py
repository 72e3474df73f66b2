"""Disparity signs and their vote (eq. 2-6).

Where the product of a spatial and an angular gradient of the reparameterised light field is positive the
surface lies in front of the plane, where it is negative behind. Only signs enter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import single
from lfdepth.engines.base import Array, Delta, Engine, Gradient, GreyViews
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField

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

    foreground: Array
    offset: float


def disparity_signs(
    lf: LightField, disparity: float, *, gradient: Gradient = "central", engine: Engine | None = None
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
    engine
        Engine; by default the processor's, on one thread.

    Returns
    -------
    Two (V, U, H, W) int8 arrays: +1 nearer than the plane, −1 farther, 0 no evidence.
    """
    rule, used = VoteRule(delta="none", gradient=gradient), engine or single()
    along_x, along_y = used.signs(used.grey_views(lf, disparity), disparity, gradient=rule.gradient)
    return used.download(along_x), used.download(along_y)


def vote(
    lf: LightField,
    disparity: float,
    *,
    rule: VoteRule | None = None,
    mask: Mask | None = None,
    engine: Engine | None = None,
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
    engine
        Engine; by default the processor's, on one thread.

    Returns
    -------
    (H, W) float32 in [−1, 1]: positive where the surface is nearer than the plane; 0 without evidence.

    Raises
    ------
    LightFieldError
        If the mask has another size than the views.
    """
    used = engine or single()
    count = VoteCount(used, used.grey_views(lf, disparity), rule or VoteRule())
    count.plane(disparity, mask)
    return np.asarray(used.download(count.quotient()), np.float32)


class VoteCount:
    """Votes of one plane after the other, in slices that are used again.

    Parameters
    ----------
    engine
        Engine.
    views
        Grey views, prepared for all planes to come.
    rule
        Which votes count.

    Attributes
    ----------
    votes, evidence
        The engine's slices (H, W): sum of votes, and of votes that count, as shares of all possible votes.
    """

    def __init__(self, engine: Engine, views: GreyViews, rule: VoteRule) -> None:
        self._engine, self._views, self._rule = engine, views, rule
        self.votes: Any = engine.empty(views.size, np.float32)
        self.evidence: Any = engine.empty(views.size, np.float32)

    def plane(self, disparity: float, mask: Mask | None = None) -> None:
        """Count one plane."""
        self._engine.vote(
            self._views,
            disparity,
            self.votes,
            self.evidence,
            gradient=self._rule.gradient,
            delta=self._rule.delta,
            threshold=self._rule.threshold,
            mask=None if mask is None else (mask.foreground, mask.offset),
        )

    def quotient(self) -> Array:
        """Votes over evidence, 0 where there is none (the fractions of eq. 4 and 5)."""
        return self._engine.quotient(self.votes, self.evidence)
