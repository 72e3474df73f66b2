"""The nets that can be trained, and what each looks at."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import nn

from lfdepth.learned.shape import EPINETS, EpinetShape
from lfdepth.learned.stacks import Position, stack_indices
from lfdepth.learned.torch_epinet import Epinet
from lfdepth.scenes.chance import cross, whole
from lfdepth.training.recipes import Recipe, recipe_of


@dataclass(frozen=True)
class Trainee:
    """A net to be trained.

    Attributes
    ----------
    build
        Makes the net with weights of chance.
    positions
        Views (v, u) that it looks at.
    arranged
        Grey views (N, positions, H, W) as the net takes them.
    border
        Px that the net takes from either side.
    recipe
        Sizes of the training.
    """

    build: Callable[[], nn.Module]
    positions: Sequence[Position]
    arranged: Callable[[torch.Tensor], torch.Tensor]
    border: int
    recipe: Recipe


def epinet_trainee(shape: EpinetShape, recipe: Recipe) -> Trainee:
    """An EPINET of any size."""
    positions = cross(shape.views)
    order = torch.as_tensor(stack_indices(shape.views, positions))
    return Trainee(
        lambda: Epinet(shape),
        positions,
        lambda grey: grey[:, order.to(grey.device)],
        shape.lost // 2,
        recipe,
    )


def trainee(name: str) -> Trainee:
    """The net of a name.

    Raises
    ------
    LightFieldError
        If there is none.
    """
    recipe = recipe_of(name)
    if name in EPINETS:
        return epinet_trainee(EPINETS[name], recipe)
    from lfdepth.learned.lfattnet import VIEWS
    from lfdepth.learned.torch_lfattnet import Lfattnet

    return Trainee(Lfattnet, whole(VIEWS), lambda grey: grey, 0, recipe)
