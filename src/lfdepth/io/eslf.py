"""Lytro pictures in ESLF layout: the views of a lenslet picture, interleaved."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import signature
from lfdepth.io.layout import Layout, size
from lfdepth.io.picture import read_picture
from lfdepth.io.source import ViewSource
from lfdepth.lightfield import reference_index

_ILLUM_GRID = (14, 14)
# What publications on Lytro pictures use: the views that are sharp and free of vignetting.
_USUAL_VIEWS = (9, 9)
# A view is dark if its mean is below this share of the reference view's. On Illum pictures, usable views have
# 0.8 or more, and those beyond the aperture 0.2 or less.
_DARK = 0.5


def recognise(path: Path) -> bool:
    """True for a PNG named `*eslf*`, or with 14 × 14 interleaved views of which the corner ones are dark."""
    if not signature.starts_with(path, signature.PNG):
        return False
    if "eslf" in path.stem.lower():
        return True
    with path.open("rb") as file:
        header = file.read(24)
    width, height = (int.from_bytes(header[at : at + 4], "big") for at in (16, 20))
    if width % _ILLUM_GRID[1] or height % _ILLUM_GRID[0]:
        return False
    try:
        bright = _bright(read_picture(path, drop_alpha=True), _ILLUM_GRID)
    except LightFieldError:
        return False
    return not bright[[0, 0, -1, -1], [0, -1, 0, -1]].any()


def open_eslf(path: Path, layout: Layout) -> ViewSource:
    """Open an ESLF picture: view (v, u) is ``picture[v::V, u::U]``, V = U = 14 unless a grid is given.

    Views beyond the aperture are dark; they count as absent. By default 9 × 9 views around the reference
    view are read. An alpha channel, which marks pixels between the lenses, is left out.

    Raises
    ------
    LightFieldError
        If the picture cannot be read, or its size is no multiple of the grid.
    """
    grid = layout.grid or _ILLUM_GRID
    picture = read_picture(path, drop_alpha=True)
    height, width, _ = picture.shape
    if height % grid[0] or width % grid[1]:
        raise LightFieldError(
            f"{path}: {width}x{height} px; expected multiples of {size(grid)} interleaved views; change the "
            "grid"
        )
    return ViewSource(
        grid=grid,
        read_view=partial(_view, picture, grid),
        describe=lambda v, u: f"{path}: view ({v}, {u})",
        present=_bright(picture, grid),
        default_views=(min(_USUAL_VIEWS[0], grid[0]), min(_USUAL_VIEWS[1], grid[1])),
        name=path.stem,
    )


def _view(picture: npt.NDArray[Any], grid: tuple[int, int], v: int, u: int) -> npt.NDArray[Any]:
    return picture[v :: grid[0], u :: grid[1]]


def _bright(picture: npt.NDArray[Any], grid: tuple[int, int]) -> npt.NDArray[np.bool_]:
    means = np.empty(grid)
    for index in np.ndindex(*grid):
        means[index] = _view(picture, grid, *index).mean(dtype=np.float64)
    bright: npt.NDArray[np.bool_] = means >= _DARK * means[reference_index(grid)]
    return bright
