"""What the methods of foreground-background separation share: parameters and estimates of memory."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.smoothing import check_window
from lfdepth.engines.base import Delta as DeltaName
from lfdepth.engines.base import Gradient as GradientName
from lfdepth.methods.base import Shape
from lfdepth.methods.parameters import Real, Switch, Whole, Word

_BYTES_PER_PIXEL = 250
"""Statistics of a colour guide while they are computed in double precision, and all slices."""

Step = Annotated[
    float | None,
    Real(
        "Distance between planes.",
        gt=0,
        unit="px per view step",
        symbol="d_step",
        without="the number of planes is given instead",
    ),
]
Planes = Annotated[
    int | None,
    Whole(
        "Number of planes, spread evenly over the range, instead of a distance between them.",
        ge=2,
        symbol="K",
        without="the distance between planes decides",
    ),
]
Skip = Annotated[int, Whole("Planes between a foreground mask and its use.", ge=1, unit="planes", symbol="J")]
Delta = Annotated[
    DeltaName,
    Word(
        "Which votes count: those of views whose level is within the threshold of the reference view's "
        "(photo), "
        "whose two signs agree (sign), or all (none).",
        symbol="δ",
    ),
]
Threshold = Annotated[
    float,
    Real(
        "With photo: difference of levels up to which a view votes.",
        gt=0,
        le=1,
        unit="full scale",
        symbol="τ",
    ),
]
Gradient = Annotated[GradientName, Word("Spatial gradient: central differences, or 3×3 Sobel.")]
Guide = Annotated[
    Literal["colour", "grey"], Word("Guide of the smoothing: the reference view in colour, or grey.")
]
Radius = Annotated[
    int, Whole("Radius of the guided filter for the votes of the signs.", ge=1, le=1000, unit="px")
]
Epsilon = Annotated[
    float,
    Real(
        "Regularisation of the guided filter; larger smooths across weaker edges.",
        gt=0,
        unit="full scale²",
        symbol="ε",
    ),
]
Normalise = Annotated[
    bool,
    Switch(
        "Smooth the sum of votes and their number apart and divide, so that pixels without evidence do not "
        "pull "
        "their neighbours to zero; off smooths the quotient, as the paper does."
    ),
]
Subplane = Annotated[bool, Switch("Place disparities between planes, at the zero crossing.")]


def check_windows(shape: Shape, *radii: int) -> None:
    """Raise LightFieldError unless windows of these radii fit the views."""
    for radius in radii:
        check_window(radius, (shape[2], shape[3]))


def sweep_bytes(shape: Shape, planes: NDArray[np.float64]) -> int:
    """Bytes of padded grey views, of the guide's statistics, and of the slices of a plane."""
    v, u, height, width, _ = shape
    reach = min(float(np.abs(planes).max()) * (u // 2), width)
    padded = width + 2 * (reach + 20) + 31
    return int(2 * v * u * height * padded + _BYTES_PER_PIXEL * height * width)
