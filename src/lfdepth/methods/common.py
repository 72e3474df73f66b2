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
        without="set by the number of planes",
    ),
]
Planes = Annotated[
    int | None,
    Whole(
        "Number of planes, evenly spaced over the range; replaces the distance between planes.",
        ge=2,
        symbol="K",
        without="set by the distance between planes",
    ),
]
Skip = Annotated[int, Whole("Planes between a foreground mask and its use.", ge=1, unit="planes", symbol="J")]
Delta = Annotated[
    DeltaName,
    Word(
        "Which votes count: those of views whose grey level is within the threshold of the reference view's "
        "(photo), those whose two signs agree (sign), or all (none).",
        symbol="δ",
    ),
]
Threshold = Annotated[
    float,
    Real(
        "With photo: largest difference in grey level at which a view still votes.",
        gt=0,
        le=1,
        unit="full scale",
        symbol="τ",
    ),
]
Gradient = Annotated[GradientName, Word("Spatial gradient: central differences, or 3×3 Sobel.")]
Guide = Annotated[
    Literal["colour", "grey"],
    Word("Guide of the smoothing filter: the reference view in colour, or in grey."),
]
Radius = Annotated[
    int, Whole("Radius of the guided filter that smooths the sign votes.", ge=1, le=1000, unit="px")
]
Epsilon = Annotated[
    float,
    Real(
        "Regularisation of the guided filter; larger values smooth across stronger edges.",
        gt=0,
        unit="full scale²",
        symbol="ε",
    ),
]
Normalise = Annotated[
    bool,
    Switch(
        "Smooth the sum of the votes and their number separately, then divide, so that pixels without "
        "evidence do not pull their neighbours towards zero; off smooths the quotient, as the paper does."
    ),
]
Subplane = Annotated[bool, Switch("Interpolate between planes: place the disparity at the zero crossing.")]


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
