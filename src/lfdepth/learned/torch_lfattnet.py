"""LFAttNet in PyTorch (Tsai, Liu, Ouhyoung and Chuang, AAAI 2020, doi:10.1609/aaai.v34i07.6888).

Features of every view, shared by all; a volume of the views moved to nine planes; an attention that weighs
views; three-dimensional convolutions; the expectation over the planes.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from lfdepth.learned.lfattnet import (
    CHANNELS,
    FEATURES,
    HIDDEN,
    PLANES,
    POOLS,
    VIEWS,
    WEIGHTS,
    mirrored,
)
from lfdepth.learned.shape import EPSILON


def _normed(inside: int, outside: int, kernel: int, dilation: int = 1) -> nn.Sequential:
    """Convolution without bias, then batch normalisation."""
    padding = dilation * (kernel // 2)
    conv = nn.Conv2d(inside, outside, kernel, padding=padding, dilation=dilation, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(outside, eps=EPSILON, momentum=0.01))


def _normed3(inside: int, outside: int) -> nn.Sequential:
    conv = nn.Conv3d(inside, outside, 3, padding=1, bias=False)
    return nn.Sequential(conv, nn.BatchNorm3d(outside, eps=EPSILON, momentum=0.01))


class Residual(nn.Module):
    """Two convolutions beside a skip; nothing after the sum."""

    def __init__(self, inside: int, outside: int, dilation: int, projected: bool) -> None:
        super().__init__()
        self.first = _normed(inside, outside, 3, dilation)
        self.second = _normed(outside, outside, 3, dilation)
        self.skip = _normed(inside, outside, 1) if projected else nn.Identity()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Same height and width."""
        found: torch.Tensor = self.second(torch.relu(self.first(x))) + self.skip(x)
        return found


def _stage(inside: int, outside: int, blocks: int, dilation: int = 1) -> nn.Sequential:
    return nn.Sequential(
        *[
            Residual(inside if i == 0 else outside, outside, dilation, projected=i == 0 and outside != 4)
            for i in range(blocks)
        ]
    )


class Features(nn.Module):
    """Four features of a grey view."""

    def __init__(self) -> None:
        super().__init__()
        self.first, self.second = _normed(1, 4, 3), _normed(4, 4, 3)
        self.stages = nn.ModuleList(
            [_stage(4, 4, 2), _stage(4, 8, 8), _stage(8, 16, 2), _stage(16, 16, 2, 2)]
        )
        self.pools = nn.ModuleList([_normed(16, 4, 1) for _ in POOLS])
        self.joined = _normed(8 + 16 + 4 * len(POOLS), 16, 3)
        self.last = nn.Conv2d(16, FEATURES, 1, bias=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, 1, H, W) to (N, 4, H, W)."""
        x = torch.relu(self.second(torch.relu(self.first(x))))
        kept = []
        for stage in self.stages:
            x = stage(x)
            kept.append(x)
        pooled = [
            functional.interpolate(
                torch.relu(pool(functional.avg_pool2d(x, size))),
                size=x.shape[2:],
                mode="bilinear",
                align_corners=True,
            )
            for pool, size in zip(self.pools, POOLS, strict=True)
        ]
        joined = torch.cat([kept[1], kept[3], *pooled[::-1]], 1)
        found: torch.Tensor = self.last(torch.relu(self.joined(joined)))
        return found


class Attention(nn.Module):
    """A weight for each view, alike for views that are mirror images of each other."""

    def __init__(self) -> None:
        super().__init__()
        channels = VIEWS * VIEWS * FEATURES
        self.first, self.second = nn.Linear(channels, HIDDEN), nn.Linear(HIDDEN, WEIGHTS)
        self.register_buffer("index", torch.tensor(mirrored()), persistent=False)

    def forward(self, volume: torch.Tensor) -> torch.Tensor:
        """Weights (N, 81) of a volume (N, 324, D, H, W)."""
        hidden = torch.relu(self.first(volume.mean((2, 3, 4))))
        found: torch.Tensor = torch.sigmoid(self.second(hidden))[:, self.index]
        return found


class Residual3(nn.Module):
    """Two three-dimensional convolutions beside a skip."""

    def __init__(self) -> None:
        super().__init__()
        self.first, self.second = _normed3(CHANNELS, CHANNELS), _normed3(CHANNELS, CHANNELS)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Same size."""
        found: torch.Tensor = self.second(torch.relu(self.first(x))) + x
        return found


class Lfattnet(nn.Module):
    """LFAttNet of nine by nine views."""

    def __init__(self) -> None:
        super().__init__()
        self.features, self.attention = Features(), Attention()
        self.begin = nn.ModuleList(
            [_normed3(VIEWS * VIEWS * FEATURES, CHANNELS), _normed3(CHANNELS, CHANNELS)]
        )
        self.middle = nn.Sequential(Residual3(), Residual3())
        self.end = _normed3(CHANNELS, CHANNELS)
        self.last = nn.Conv3d(CHANNELS, 1, 3, padding=1, bias=False)

    def forward(self, views: torch.Tensor) -> torch.Tensor:
        """Disparity (N, H, W), px per view step.

        Parameters
        ----------
        views
            (N, 81, H, W), grey in 0..1, row by row; H and W multiples of 16.
        """
        volume = self.volume(views)
        weights = self.attention(volume).repeat_interleave(FEATURES, 1)
        x = volume * weights[:, :, None, None, None]
        for part in self.begin:
            x = torch.relu(part(x))
        x = torch.relu(self.end(self.middle(x)))
        likely = torch.softmax(self.last(x)[:, 0], 1)
        planes = torch.tensor(PLANES, dtype=likely.dtype, device=likely.device)
        return (likely * planes[:, None, None]).sum(1)

    def volume(self, views: torch.Tensor) -> torch.Tensor:
        """Features (N, 324, 9, H, W) of all views, moved so that what lies on a plane coincides."""
        count, grid, height, width = views.shape
        seen = self.features(views.reshape(count * grid, 1, height, width))
        seen = seen.reshape(count, grid, FEATURES, height, width)
        reach = VIEWS // 2
        planes = []
        for plane in PLANES:
            moved = [
                _moved(seen[:, i], plane * (i // VIEWS - reach), plane * (i % VIEWS - reach))
                for i in range(grid)
            ]
            planes.append(torch.cat(moved, 1))
        return torch.stack(planes, 2)


def _moved(picture: torch.Tensor, down: int, right: int) -> torch.Tensor:
    """Values found `down` and `right` px up and left of each pixel; zero beyond the border."""
    height, width = picture.shape[-2:]
    down, right = max(-height, min(height, down)), max(-width, min(width, right))
    padded = functional.pad(picture, (max(right, 0), max(-right, 0), max(down, 0), max(-down, 0)))
    top, left = max(-down, 0), max(-right, 0)
    return padded[..., top : top + height, left : left + width]
