"""Truth at a higher resolution than the views: what readers, procedural scenes and scores share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

FACTOR = 10
"""Pixels of the high-resolution truth per pixel of a view, along one axis."""


@dataclass(frozen=True, eq=False)
class HighResolution:
    """Truth at ten times the size of the views.

    Attributes
    ----------
    truth : (10 H, 10 W) array
        Disparity of the reference view, px of the *views* per view step.
    masks : mapping of str to array
        Named regions of the same size; labels (`boxes`, `dots_by_size`) are kept as whole numbers.
    unusable : mapping of str to str
        Masks that could not be used, with the reason.
    """

    truth: NDArray[Any]
    masks: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    unusable: Mapping[str, str] = field(default_factory=dict)
