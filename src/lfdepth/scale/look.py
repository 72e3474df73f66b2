"""A look at a light field, of which next to nothing is read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lfdepth.io import read
from lfdepth.io.formats import find_format
from lfdepth.io.layout import Layout
from lfdepth.lightfield import FULL_SCALE


@dataclass(frozen=True)
class Look:
    """What is known of a light field before its pixels are read.

    Attributes
    ----------
    shape
        (V, U, H, W, C).
    itemsize
        Bytes of a sample.
    range
        (min, max) disparity, if the scene says so, px per view step.
    white
        Value of white, by two views; None for 8 bits.
    """

    shape: tuple[int, int, int, int, int]
    itemsize: int
    range: tuple[float, float] | None
    white: float | None


def look(path: Path, reading: Mapping[str, Any]) -> Look:
    """Look at a light field that would be read with these arguments of `lfdepth.read`; reads two views."""
    layout = Layout(
        reading.get("grid"), reading.get("partial", False), reading.get("pattern"), reading.get("axes")
    )
    source = find_format(path, reading.get("format")).open(path, layout)
    v, u = reading.get("views") or source.default_views or source.grid
    source.close()
    if reading.get("transpose") and not reading.get("views"):
        v, u = u, v
    few = read(path, **{**reading, "views": (1, 2) if u > 1 else (2, 1)})
    kind = few.views.dtype.name
    white = few.white_level or FULL_SCALE[kind]
    return Look((v, u, *few.shape[2:]), few.views.itemsize, few.disparity_range, white)
