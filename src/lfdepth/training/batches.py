"""Crops of rendered scenes, varied by chance as the papers do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from lfdepth.learned.stacks import Position, turned
from lfdepth.lightfield import LUMA


@dataclass(frozen=True)
class Variation:
    """How crops are varied.

    Attributes
    ----------
    crop
        Side of a crop, px.
    border
        Px that a net takes from either side; the truth is that much smaller.
    scaled
        Share of crops taken from every second pixel, their disparities halved.
    noisy
        Share of crops with noise of the sensor.
    """

    crop: int
    border: int
    scaled: float = 0.12
    noisy: float = 0.6


class Batches:
    """Random crops of scenes that lie on a device.

    Parameters
    ----------
    positions
        Views (v, u) that the scenes have.
    variation
        How crops are varied.
    generator
        Source of chance; on the scenes' device.
    """

    def __init__(
        self, positions: Sequence[Position], variation: Variation, generator: torch.Generator
    ) -> None:
        self.variation, self.generator = variation, generator
        self.device = generator.device
        turns = [turned(positions, bool(g & 1), bool(g & 2), bool(g & 4)) for g in range(8)]
        self._luma = torch.tensor(LUMA, device=self.device)
        self.turns = torch.as_tensor([list(map(int, turn)) for turn in turns], device=self.device)

    def draw(
        self, views: torch.Tensor, truth: torch.Tensor, count: int, scene: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Draw crops: grey views (count, N, crop, crop) in 0..1, and truth (count, crop - 2·border, ...).

        Parameters
        ----------
        views
            (scenes, N, H, W, 3) uint8.
        truth
            (scenes, H, W).
        count
            Crops.
        scene
            (count,) scene of each crop; left to chance by default.
        """
        rule = self.variation
        scale = 1 + (self._uniform(count) < rule.scaled).long()
        scale = torch.where(scale * (rule.crop - 1) < views.shape[2], scale, 1)
        if scene is None:
            scene = self._whole(count, views.shape[0])
        rows, columns, turn = self._pixels(count, scale, views.shape[2], views.shape[3])
        which = self.turns[turn][:, :, None, None]
        colours = views[scene[:, None, None, None], which, rows[:, None], columns[:, None]]
        inner = slice(rule.border, rule.crop - rule.border)
        target = truth[scene[:, None, None], rows[:, inner, inner], columns[:, inner, inner]].float()
        return self._exposed(colours), target / scale[:, None, None]

    def _pixels(
        self, count: int, scale: torch.Tensor, height: int, width: int
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Rows and columns (count, crop, crop) of the crops, mirrored and transposed, and which turn of 8."""
        crop, turn = self.variation.crop, self._whole(count, 8)
        along = torch.arange(crop, device=self.device)
        i, j = along[None, :, None].expand(count, crop, crop), along[None, None, :].expand(count, crop, crop)
        swap, flip_v, flip_u = ((turn & bit > 0)[:, None, None] for bit in (4, 1, 2))
        i, j = torch.where(swap, j, i), torch.where(swap, i, j)
        i, j = torch.where(flip_v, crop - 1 - i, i), torch.where(flip_u, crop - 1 - j, j)
        reach = scale * (crop - 1)
        first_row, first_column = (
            (self._uniform(count) * (n - reach)).long().clamp(max=n - 1) for n in (height, width)
        )
        step = scale[:, None, None]
        return i * step + first_row[:, None, None], j * step + first_column[:, None, None], turn

    def _exposed(self, colours: torch.Tensor) -> torch.Tensor:
        """Grey of random weights, gamma, contrast, a little gain by view, and noise."""
        count = colours.shape[0]
        weights = 0.05 + self._uniform(count, 3)
        weights = weights / weights.sum(1, keepdim=True)
        weights = torch.where(self._uniform(count, 1) < 0.3, self._luma, weights)
        grey = (colours.float() * (weights / 255)[:, None, None, None]).sum(-1)
        shape = (count, 1, 1, 1)
        grey = grey.clamp(1e-4, 1) ** (0.8 + 0.4 * self._uniform(*shape))
        contrast, level = 0.5 + 0.7 * self._uniform(*shape), 0.3 * (self._uniform(*shape) - 0.5)
        mean = grey.mean((1, 2, 3), keepdim=True)
        grey = (grey - mean) * contrast + mean + level
        gains = torch.randn(count, grey.shape[1], 1, 1, generator=self.generator, device=self.device)
        grey = grey * (1 + 0.004 * gains * (self._uniform(*shape) < 0.2))
        strength = 10 ** (2.0 * self._uniform(*shape) - 1.0) / 255  # 0.1 to 10 grey levels
        strength = strength * (self._uniform(*shape) < self.variation.noisy)
        chance = torch.randn(grey.shape, generator=self.generator, device=self.device)
        return (grey + strength * chance).clamp(0, 1)

    def _uniform(self, *shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=self.generator, device=self.device)

    def _whole(self, count: int, below: int) -> torch.Tensor:
        return torch.randint(below, (count,), generator=self.generator, device=self.device)
