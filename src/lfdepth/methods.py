"""The named methods: frozen combinations of an occlusion rule, a decoder and parameters."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Literal

from lfdepth.errors import LightFieldError

_CHOICES: dict[str, tuple[str, ...]] = {
    "occlusion": ("none", "skip-mask", "visibility"),
    "decoder": ("accumulate", "sfa", "joint"),
    "delta": ("photo", "sign", "none"),
    "gradient": ("central", "sobel"),
    "guide": ("colour", "grey"),
}


@dataclass(frozen=True, kw_only=True)
class Method:
    """A method: what it is called, what it is made of, and its parameters.

    Attributes
    ----------
    name
        What the method is called in tables.
    summary
        One sentence.
    occlusion
        "none", "skip-mask" (the paper's mask from J planes in front), or "visibility" (depth edges decided
        by the views that see past them).
    decoder
        "accumulate" (FBS), "sfa" (sign function approximation), or "joint" (signs and photo-consistency in
        one energy, made smooth along scanlines).
    step
        Distance between planes, px per view step (`d_step`); None where `planes` is given.
    planes
        Number of planes instead of a step (`K`).
    skip
        The paper's J, planes between a mask and its use.
    delta
        Which votes count (δ): "photo" (level within `threshold` of the reference view's), "sign" (both signs
        agree), "none".
    threshold
        For "photo", fraction of full scale (τ).
    gradient
        Spatial gradient, "central" or "sobel" (3×3).
    guide
        Guide of the smoothing, "colour" or "grey" reference view.
    radius
        Radius of the guided filter, px.
    photo_radius
        Radius of the guided filter for photo-consistency, px ("joint").
    epsilon
        ε of the guided filter, squared full scale.
    normalise
        Smooth the sum of votes and their number apart and divide (normalised convolution), so that pixels
        without evidence do not pull their neighbours to zero; False smooths the quotient, as the paper does.
    subplane
        Place disparities between planes at the zero crossing ("sfa").
    photo_weight
        Weight of the photo-consistency votes, px per view step ("joint"; λ).
    slope_penalty
        Cost of a change by one plane between neighbouring pixels ("joint").
    jump_penalty
        Cost of any larger change between neighbouring pixels ("joint").
    fit_radius
        Radius in px of the planes that place disparities between planes ("joint"); even; 0: none.
    gloss
        Where highlights wander over a surface, decide by high-passed views ("joint" with "visibility").
    edge_passes
        Passes over the depth edges; each moves them by at most a pixel ("visibility").
    """

    name: str
    summary: str = ""
    occlusion: Literal["none", "skip-mask", "visibility"] = "none"
    decoder: Literal["accumulate", "sfa", "joint"] = "sfa"
    step: float | None = 0.05
    planes: int | None = None
    skip: int = 5
    delta: Literal["photo", "sign", "none"] = "photo"
    threshold: float = 0.03
    gradient: Literal["central", "sobel"] = "central"
    guide: Literal["colour", "grey"] = "colour"
    radius: int = 4
    photo_radius: int = 2
    epsilon: float = 1e-4
    normalise: bool = True
    subplane: bool = True
    photo_weight: float = 1.0
    slope_penalty: float = 0.3
    jump_penalty: float = 2.0
    fit_radius: int = 8
    gloss: bool = True
    edge_passes: int = 3

    def __post_init__(self) -> None:
        for field, choices in _CHOICES.items():
            found = getattr(self, field)
            if found not in choices:
                raise LightFieldError(f"{field}: found {found!r}, expected one of {', '.join(choices)}")
        if self.skip < 1:
            raise LightFieldError(f"skip: found J = {self.skip}, expected at least 1 plane")
        for field in ("photo_weight", "slope_penalty", "jump_penalty", "edge_passes"):
            found = getattr(self, field)
            if not 0 <= found <= 100:
                raise LightFieldError(f"{field}: found {found}, expected a number from 0 to 100")
        if self.photo_radius < 1:
            raise LightFieldError(f"photo_radius: found {self.photo_radius}, expected at least 1 px")
        if self.edge_passes != int(self.edge_passes):
            raise LightFieldError(f"edge_passes: found {self.edge_passes:g}, expected a whole number")
        if not 0 <= self.fit_radius <= 50 or self.fit_radius % 2 != 0:
            raise LightFieldError(
                f"fit_radius: found {self.fit_radius}, expected an even number of px from 0 to 50"
            )
        if self.jump_penalty > 2:
            raise LightFieldError(f"jump_penalty: found {self.jump_penalty:g}, expected at most 2")


_REGISTRY = {
    method.name: method
    for method in (
        Method(
            name="fbs",
            summary="Foreground-background separation: vote, smooth, accumulate (Lee and Park, 2017).",
            decoder="accumulate",
        ),
        Method(
            name="fbs-sfa",
            summary="FBS with sign function approximation along the planes (Lee and Park, 2018).",
        ),
        Method(
            name="fbsocc-sfa",
            summary="FBS-SFA that excludes the foreground found J planes in front (IEEE Access, 2021).",
            occlusion="skip-mask",
        ),
        Method(
            name="fbs-vis",
            summary="Signs and photo-consistency in one energy, with exact visibility (the default).",
            occlusion="visibility",
            decoder="joint",
            step=0.07,
            radius=3,
            epsilon=2e-6,
        ),
    )
}

NAMES: tuple[str, ...] = tuple(_REGISTRY)
"""Names of the methods, oldest first."""

PRESETS: dict[str, dict[str, Any]] = {
    "paper-synthetic": {"step": 0.02, "skip": 7},
    "paper-real": {"step": 0.05, "skip": 5},
}
"""Parameters by the name of the paper's experiment."""


def method(name: str | Method, **options: Any) -> Method:
    """Look a method up by name and change some of its parameters.

    Parameters
    ----------
    name
        One of `NAMES`, or a `Method`.
    **options
        Fields to change; `planes` replaces `step`. `preset` names an entry of `PRESETS`.

    Returns
    -------
    Method

    Raises
    ------
    LightFieldError
        For an unknown name, option, preset or value.
    """
    if isinstance(name, str):
        if name not in _REGISTRY:
            raise LightFieldError(f"method: found {name!r}, expected one of {', '.join(NAMES)}")
        name = _REGISTRY[name]
    preset = options.pop("preset", None)
    if options.get("planes") is not None:
        options.setdefault("step", None)  # the preset's step, too
    if preset is not None:
        if preset not in PRESETS:
            raise LightFieldError(f"preset: found {preset!r}, expected one of {', '.join(PRESETS)}")
        options = {**PRESETS[preset], **options}
    known = {field.name for field in fields(Method)}
    for option in options:
        if option not in known:
            raise LightFieldError(f"option: found {option!r}, expected one of {', '.join(sorted(known))}")
    return replace(name, **options)
