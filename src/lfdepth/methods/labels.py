"""What methods that fill a cost volume share: parameters and the estimate of memory."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.labels import Regulariser as RegulariserName
from lfdepth.methods.base import Shape
from lfdepth.methods.parameters import Real, Switch, Whole, Word

Labels = Annotated[int, Whole("Number of labels, evenly spaced over the range.", ge=3, symbol="K")]
Subplane = Annotated[
    bool,
    Switch("Interpolate between labels: a parabola through the least cost and its two neighbours."),
]
Regulariser = Annotated[
    RegulariserName,
    Word(
        "Smoothness term: minimised along scanlines (paths, where the original used graph cuts or a "
        "variational solver), or left out (none)."
    ),
]
GuideRadius = Annotated[
    int, Whole("Radius of the guided filter that smooths the costs.", ge=1, le=1000, unit="px")
]
GuideEpsilon = Annotated[
    float,
    Real(
        "Regularisation of the guided filter, for a guide with levels from 0 to 255.",
        gt=0,
        unit="8-bit levels²",
        symbol="ε",
    ),
]


def symmetric(searched: tuple[float, float]) -> tuple[float, float]:
    """±max|D|: the range over which some methods spread their labels."""
    farthest = max(abs(end) for end in searched)
    return -farthest, farthest


def volume_bytes(
    shape: Shape,
    planes: NDArray[np.float64],
    volumes: float,
    *,
    sample_bytes: int = 1,
    views: int | None = None,
) -> int:
    """Bytes of so many volumes (K, H, W) float32 at once, of padded views in colour, and of some maps.

    `views` is how many are kept; None: all.
    """
    v, u, height, width, channels = shape
    reach = min(float(np.abs(planes).max()) * (u // 2), width)
    padded = width + 31 + 2 * (reach + 3)
    kept = (v * u if views is None else views) * height * padded * channels * min(sample_bytes, 2)
    return int(kept + 4 * volumes * len(planes) * height * width + 300 * height * width)
