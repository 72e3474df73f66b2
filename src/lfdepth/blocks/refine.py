"""Sub-pixel refinement: what all views that see a pixel say about its disparity, to a hundredth of a pixel.

A map that is right to a few hundredths of a px says where every view shows the surface. If it is right, the
levels I(u, v) found there are alike; if it is off by δ, they change from view to view as I ≈ M + δ·(u·∂x M
+ v·∂y M), M being their mean. So over the views that see the pixel (`visibility`) the change of level with
u and v, less what is smooth over the picture (highlights and shading wander with disparities of their own),
is compared with the slopes of M: one Gauss–Newton step. It comes with its information Σ (u·∂x M + v·∂y M)²
/ σ², where σ² is how much the views differ around the pixel for whatever reason: noise, aliasing, an
occluder's rim. Planes fitted to these steps refine the map: wide ones say what a pixel without evidence is
drawn to, small ones what it gets. Where the evidence around a pixel speaks against the change, the pixel
keeps what it had. Beside jumps of the map nobody's evidence is good, so what lies there last takes the plane
of its own surface's inside.

How far the result may be off is told by three things that go with it (`standard_error`): the information
around a pixel, how much the refinement had to change, and how far the map is from a plane.

Views are sampled by cubic B-splines, whose response hardly depends on where between samples one looks, and
the centred sums over u and v are blind to much of what is left of that. Sampled linearly, disparities an
eighth beside whole pixels come out 0.004 px wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.jumps import near_jumps
from lfdepth.blocks.smoothing import guide_image
from lfdepth.engines import single
from lfdepth.engines.base import Engine
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField

_LEAST_NOISE = 0.3  # grey levels: what rounding to 8 bits leaves, about
_NOISE_BLUR = 2.0  # px, standard deviation of the window in which views' differences are measured
_FEWEST_VIEWS = 5
_SMALLEST = 5  # px: slopes take two neighbours on either side
_FARTHEST = 0.1  # px per view step that one step may go
_WIDE_RIDGE = 30.0  # information per px² of image that keeps wide planes level
_HEARING = 1.5  # px, standard deviation of the window whose views may refuse a change
_SHARPNESS = 10.0  # weights of a fit fall as exp(−_SHARPNESS · Σ_channels |ΔI|), I in [0, 1]
_KEPT = 2  # times the prior in later rounds: the map is better by then
_WITNESSES, _NEIGHBOURS = 3.0, 2.0  # px, standard deviations of the windows that tell how far a map is off
_PLANE_RADIUS, _PLANE_SPACING, _PLANE_GATE = 20, 4, 0.1  # px, px, px per view step: planes it is held against
_RIM = 2  # px from a jump within which evidence mixes two surfaces
_RIM_SPACING = 2  # px between the pixels that take part in a rim's plane
_RIM_WEIGHT = np.float32(0.01)  # of a rim among pixels farther inside: thin things have nothing else
_RIM_RIDGE = 1e-3  # keeps planes through pixels in a row level


@dataclass(frozen=True, kw_only=True)
class RefineRule:
    """How a map is refined.

    Parameters
    ----------
    radius, spacing
        Radius of the fitted planes, px, and the distance of the pixels in it that take part; even.
    wide_radius, wide_spacing
        The same for the planes to which a pixel without evidence of its own is drawn.
    level_radius, level_spacing
        The same for the planes fitted to what a second witness says before the views are asked.
    prior
        Information with which a pixel keeps its disparity, per (px per view step)².
    high_pass
        Standard deviation in px of the mean that is taken away from levels and their changes.
    halving
        Step in px per view step at which the evidence counts half: larger ones are rarely right.
    gate
        Difference of disparity beyond which another surface begins, px per view step.
    margin
        Surfaces hide others that are farther by more than this, px per view step.
    jump
        Change of disparity per px that makes a depth edge, px per view step.
    rims
        What evidence counts one, two, three … px from a depth edge: pixels there mix two surfaces.
    refusal
        A change of the map is taken back where the evidence around a pixel speaks against it by more than
        this, twice the logarithm of the likelihood.
    rounds
        How often views are asked; every round but the first starts from the map of the one before, which it
        keeps with twice the `prior`.
    rim_radius, rim_jump, rim_gate
        Within two px of a jump of `rim_jump` px per view step, a pixel takes the height of a plane through
        the pixels farther inside, up to `rim_radius` px away, that differ by at most `rim_gate` px per view
        step; 0 for the radius leaves them alone.
    """

    radius: int = 10
    spacing: int = 2
    wide_radius: int = 48
    wide_spacing: int = 12
    level_radius: int = 20
    level_spacing: int = 5
    prior: float = 150.0
    high_pass: float = 2.0
    halving: float = 0.05
    gate: float = 0.05
    margin: float = 0.15
    jump: float = 0.1
    rims: tuple[float, ...] = (0.05, 0.2, 0.5)
    refusal: float = 25.0
    rounds: int = 1
    rim_radius: int = 8
    rim_jump: float = 0.15
    rim_gate: float = 0.15


Witness = Callable[[NDArray[np.float32]], tuple[NDArray[np.float32], NDArray[np.float32]]]
"""Says of a map (H, W) by how much it should change, and on how much information that rests."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the views say at each pixel, all (H, W).

    `step` is the change of disparity that they ask for, px per view step; `weight` the information it rests
    on, per (px per view step)²; `trusted` what is left of that near depth edges. `typical` is the squared
    difference of views, in grey levels, that none counted as less than.
    """

    step: NDArray[np.float32]
    weight: NDArray[np.float32]
    trusted: NDArray[np.float32]
    typical: float


def refine_disparity(
    lf: LightField,
    disparity: NDArray[np.float32],
    rule: RefineRule | None = None,
    *,
    engine: Engine | None = None,
) -> NDArray[np.float32]:
    """Refine a disparity map that is right to a few hundredths of a px per view step.

    Parameters
    ----------
    lf
        Light field.
    disparity
        (H, W) map of the reference view, px per view step.
    rule
        Parameters.
    engine
        Engine; by default the processor's, on one thread.

    Returns
    -------
    (H, W) float32, px per view step.

    Raises
    ------
    LightFieldError
        For a map of another shape, or one with values that are not finite.
    """
    if disparity.shape != lf.shape[2:4]:
        raise LightFieldError(
            f"disparity: found shape {disparity.shape}, expected {lf.shape[2:4]} like the views; resize it"
        )
    if not np.isfinite(disparity).all():
        raise LightFieldError("disparity: found values that are not finite, expected none; fill them")
    contiguous = np.ascontiguousarray(disparity, np.float32)
    return refine_map(lf, contiguous, rule or RefineRule(), engine or single()).disparity


@dataclass(frozen=True, eq=False)
class Refined:
    """A refined map and its standard error, (H, W) each, px per view step; see `standard_error`.

    A map too small to be refined has none. `typical` is that of the evidence of each round.
    """

    disparity: NDArray[np.float32]
    sigma: NDArray[np.float32] | None
    typical: tuple[float, ...] = ()


def refine_map(
    lf: LightField,
    disparity: NDArray[np.float32],
    rule: RefineRule,
    engine: Engine,
    second: Witness | None = None,
    typical: Sequence[float] = (),
) -> Refined:
    """`refine_disparity` of a contiguous map, with its standard error.

    A second witness beside the views is heard before them, as they see only what is near, and with them when
    planes are fitted; it has no part in what is refused and in the standard error. `typical` is that of
    the evidence of each round, where the light field is a piece of the one that it was measured on.
    """
    if min(disparity.shape) < _SMALLEST:
        return Refined(disparity, None)
    guide = guide_image(lf, "colour")
    found = disparity if second is None else _levelled(disparity, second, guide, rule, engine)
    noted: list[float] = []
    for count in range(rule.rounds):
        evidence = gather_evidence(lf, found, rule, engine, typical[count] if typical else None)
        noted.append(evidence.typical)
        prior = rule.prior * (1 if count == 0 else _KEPT)
        heard = evidence if second is None else _joined(evidence, *second(found))
        fitted = _fit_planes(found, heard, guide, replace(rule, prior=prior), engine)
        kept = np.where(_refused(fitted - found, evidence, rule, engine), found, fitted)
        found = _draw_rims(kept, guide, rule, engine)
    return Refined(found, standard_error(disparity, found, evidence, guide, engine), tuple(noted))


def standard_error(
    before: NDArray[np.float32],
    refined: NDArray[np.float32],
    evidence: Evidence,
    guide: NDArray[np.float32],
    engine: Engine,
) -> NDArray[np.float32]:
    """How far a refined map may be off, (H, W), px per view step, where it is not wrong altogether.

    σ = 13·(A + 30)^(−0.215)·(c + 0.001)^0.45·(q + 0.0005)^0.71, where A is the mean information around a
    pixel, c the root mean square of the change by the refinement, and q that of the map's distance from
    planes fitted within 20 px. The form and its numbers are a regression, of the level below which 68 % of
    the errors under 0.07 px lie, on fourteen scenes (docs/research-log.md).
    """
    information = engine.blur(evidence.trusted, _WITNESSES)
    changed = np.sqrt(engine.blur(np.square(refined - before), _NEIGHBOURS))
    plane = engine.fit_steps(
        refined,
        refined,
        np.ones_like(refined),
        guide,
        radius=_PLANE_RADIUS,
        spacing=_PLANE_SPACING,
        gate=_PLANE_GATE,
        ridge=float(_PLANE_SPACING**2),
        sharpness=_SHARPNESS,
    )
    bent = np.sqrt(engine.blur(np.square(plane - refined), _NEIGHBOURS))
    sigma = 13 * (information + 30) ** -0.215 * (changed + 0.001) ** 0.45 * (bent + 0.0005) ** 0.71
    return np.asarray(sigma, np.float32)


def outer_views(lf: LightField) -> NDArray[np.bool_]:
    """The views (V, U) that tell disparity best, and the reference view.

    The information that a view holds grows with the square of its distance from the reference view: of 9×9
    views, the 57 in the outer half along either axis hold nine tenths.
    """
    away = np.abs(lf.offsets)
    far = np.asarray((2 * away > _nearer_end(lf)).any(axis=2))
    far[lf.centre] = True
    return lf.available & far


def _nearer_end(lf: LightField) -> NDArray[np.float64]:
    """How far views stand from the reference view on the side of the grid that is nearer to it, (2,)."""
    ends = lf.offsets.reshape(-1, 2)
    return np.asarray(np.minimum(ends.max(axis=0), -ends.min(axis=0)))


def gather_evidence(
    lf: LightField,
    disparity: NDArray[np.float32],
    rule: RefineRule,
    engine: Engine,
    typical: float | None = None,
) -> Evidence:
    """What the views that see a map's pixels (H, W) say of it; `typical` as `Evidence` has it."""
    found = engine.ask_views(
        engine.spline_views(lf, outer_views(lf)),
        disparity,
        margin=rule.margin,
        high_pass=rule.high_pass,
        noise_blur=_NOISE_BLUR,
        least_noise=_LEAST_NOISE**2,
        fewest=_FEWEST_VIEWS,
        farthest=_FARTHEST,
        halving=rule.halving,
        jump=rule.jump,
        rims=rule.rims,
        typical=typical,
    )
    return Evidence(*found)


def _levelled(
    disparity: NDArray[np.float32],
    second: Witness,
    guide: NDArray[np.float32],
    rule: RefineRule,
    engine: Engine,
) -> NDArray[np.float32]:
    """Planes fitted to what the second witness asks for."""
    asked, strength = _asked(disparity, *second(disparity), rule)
    return engine.fit_steps(
        disparity,
        asked,
        strength,
        guide,
        radius=rule.level_radius,
        spacing=rule.level_spacing,
        gate=rule.gate,
        ridge=rule.prior * rule.level_spacing**2,
        sharpness=_SHARPNESS,
    )


def _asked(
    disparity: NDArray[np.float32],
    step: NDArray[np.float32],
    information: NDArray[np.float32],
    rule: RefineRule,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Disparity that evidence asks for beside the map's own weight, and the weight of both."""
    strength = information + np.float32(rule.prior)
    return disparity + information * step / strength, strength


def _joined(evidence: Evidence, asked: NDArray[np.float32], information: NDArray[np.float32]) -> Evidence:
    """The views' evidence, and what a second witness asks for."""
    trusted = evidence.trusted + information
    both = evidence.trusted * evidence.step + information * asked
    step = np.divide(both, trusted, out=np.zeros_like(both), where=trusted > 0)
    return replace(evidence, step=step, trusted=trusted)


def _fit_planes(
    disparity: NDArray[np.float32],
    evidence: Evidence,
    guide: NDArray[np.float32],
    rule: RefineRule,
    engine: Engine,
) -> NDArray[np.float32]:
    """Planes fitted to the evidence around every pixel, of the pixel's own surface.

    A pixel without evidence keeps its disparity in the fit of wide planes, and in the fit of small ones takes
    that of the wide plane.
    """
    asked, strength = _asked(disparity, evidence.step, evidence.trusted, rule)

    def fit(target: NDArray[np.float32], radius: int, spacing: int, ridge: float) -> NDArray[np.float32]:
        return engine.fit_steps(
            disparity,
            target,
            strength,
            guide,
            radius=radius,
            spacing=spacing,
            gate=rule.gate,
            ridge=ridge * spacing**2,
            sharpness=_SHARPNESS,
        )

    wide = fit(asked, rule.wide_radius, rule.wide_spacing, _WIDE_RIDGE)
    drawn = np.clip(wide - disparity, -_FARTHEST, _FARTHEST) * (np.float32(rule.prior) / strength)
    fitted = fit(asked + drawn, rule.radius, rule.spacing, rule.prior)
    return engine.even_lattices(fitted, guide, gate=rule.gate, sharpness=_SHARPNESS)


def _draw_rims(
    disparity: NDArray[np.float32], guide: NDArray[np.float32], rule: RefineRule, engine: Engine
) -> NDArray[np.float32]:
    """Pixels beside jumps on the planes of what lies farther inside their surfaces."""
    if rule.rim_radius == 0:
        return disparity
    rims = near_jumps(disparity, rule.rim_jump, _RIM)
    fitted = engine.fit_steps(
        disparity,
        disparity,
        np.where(rims, _RIM_WEIGHT, np.float32(1)),
        guide,
        radius=rule.rim_radius,
        spacing=_RIM_SPACING,
        gate=rule.rim_gate,
        ridge=_RIM_RIDGE,
        sharpness=_SHARPNESS,
    )
    return np.where(rims, fitted, disparity)


def _refused(
    change: NDArray[np.float32], evidence: Evidence, rule: RefineRule, engine: Engine
) -> NDArray[np.bool_]:
    """Where the views around a pixel speak against a change of the map, (H, W)."""
    asked = engine.blur(evidence.weight * evidence.step, _HEARING)
    weight = engine.blur(evidence.weight, _HEARING)
    # A Gaussian's weights sum to one, its window holds the evidence of 4π times its variance in pixels.
    gain = change * (2 * asked - weight * change) * np.float32(4 * np.pi * _HEARING**2)
    return np.asarray(gain < -rule.refusal)
