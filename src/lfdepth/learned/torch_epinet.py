"""EPINET in PyTorch, for training."""

from __future__ import annotations

import torch
from torch import nn

from lfdepth.learned.shape import EPSILON, EpinetShape


class Block(nn.Module):
    """Conv, ReLU, conv, batch normalisation, ReLU."""

    def __init__(self, inside: int, outside: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(inside, outside, 2)
        self.second = nn.Conv2d(outside, outside, 2)
        self.norm = nn.BatchNorm2d(outside, eps=EPSILON, momentum=0.01)  # Keras' momentum 0.99

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, inside, H, W) to (N, outside, H - 2, W - 2)."""
        found: torch.Tensor = torch.relu(self.norm(self.second(torch.relu(self.first(x)))))
        return found


class Last(nn.Module):
    """Conv, ReLU, conv to one channel."""

    def __init__(self, inside: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(inside, inside, 2)
        self.second = nn.Conv2d(inside, 1, 2)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, inside, H, W) to (N, 1, H - 2, W - 2)."""
        found: torch.Tensor = self.second(torch.relu(self.first(x)))
        return found


class Epinet(nn.Module):
    """EPINET of any size; its weights have the names and shapes that `EpinetShape.arrays` lists."""

    def __init__(self, shape: EpinetShape) -> None:
        super().__init__()
        self.shape = shape
        f = shape.filters
        for stream in range(4):
            blocks = [Block(shape.views if i == 0 else f, f) for i in range(shape.stream_blocks)]
            setattr(self, f"stream{stream}", nn.Sequential(*blocks))
        self.merged = nn.Sequential(*[Block(4 * f, 4 * f) for _ in range(shape.merged_blocks)])
        self.last = Last(4 * f)
        for part in self.modules():
            if isinstance(part, nn.Conv2d):
                nn.init.kaiming_normal_(part.weight, nonlinearity="relu")
                nn.init.zeros_(part.bias)
        nn.init.normal_(self.last.second.weight, std=0.01)

    def forward(self, stacks: torch.Tensor) -> torch.Tensor:
        """Disparity (N, H - lost, W - lost), px per view step.

        Parameters
        ----------
        stacks
            (N, 4, views, H, W), grey in 0..1, in the order of `lfdepth.learned.stacks.stacks`.
        """
        streams = [getattr(self, f"stream{i}")(stacks[:, i]) for i in range(4)]
        found: torch.Tensor = self.last(self.merged(torch.cat(streams, 1)))
        return found[:, 0]
