"""How each learned system is trained."""

from __future__ import annotations

from dataclasses import dataclass

from lfdepth.errors import LightFieldError


@dataclass(frozen=True)
class Recipe:
    """Sizes of a training.

    Attributes
    ----------
    batch, crop
        Crops of a step, and their side, px.
    rate
        Largest learning rate of Adam; it rises over `warm` steps and falls as half a cosine to a
        thousandth.
    scenes, size, pace
        Scenes at a time, their side in px, and the steps after which the oldest is replaced.
    validation
        Scenes that the loss is measured on and that nothing is trained on.
    every
        Steps between checkpoints, at each of which the validation scenes are scored.
    """

    batch: int = 16
    crop: int = 64
    rate: float = 1e-3
    warm: int = 200
    scenes: int = 64
    size: int = 160
    pace: int = 4
    validation: int = 8
    every: int = 500


RECIPES = {
    "epinet": Recipe(),
    "epinet-s": Recipe(batch=32),
    "lfattnet": Recipe(batch=12, crop=32, scenes=48, size=96),
}
"""By the name of the method."""


def recipe_of(name: str) -> Recipe:
    """How a learned system is trained.

    Raises
    ------
    LightFieldError
        If there is none of that name.
    """
    if name not in RECIPES:
        raise LightFieldError(f"training: found {name!r}, expected one of {', '.join(RECIPES)}; choose one")
    return RECIPES[name]
