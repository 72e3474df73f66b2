"""Mosaics: all views tiled in one picture, the top left view at the top left."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io.layout import Layout, size
from lfdepth.io.picture import read_picture, stated_white
from lfdepth.io.source import ViewSource


def recognise(path: Path) -> bool:
    """False: nothing tells a mosaic from any other picture; ``format="mosaic"`` does."""
    del path
    return False


def open_mosaic(path: Path, layout: Layout) -> ViewSource:
    """Open a picture of V rows and U columns of views; a column of views for each row of tiles is transposed.

    Raises
    ------
    LightFieldError
        If no grid is given, or the picture does not divide into it.
    """
    if layout.grid is None:
        raise LightFieldError(f"{path}: a mosaic of views; expected its grid; give columns x rows (grid)")
    rows, columns = layout.grid
    picture = read_picture(path)
    height, width = picture.shape[0] // rows, picture.shape[1] // columns
    if picture.shape[:2] != (height * rows, width * columns):
        raise LightFieldError(
            f"{path}: {picture.shape[1]}x{picture.shape[0]} px; expected multiples of "
            f"{size(layout.grid)} views; "
            "change the grid, or crop the picture's margins"
        )

    def read_view(v: int, u: int) -> npt.NDArray[Any]:
        return picture[v * height : (v + 1) * height, u * width : (u + 1) * width]

    return ViewSource(
        grid=layout.grid,
        read_view=read_view,
        describe=lambda v, u: f"{path}: view ({v}, {u})",
        white=stated_white(path),
        name=path.stem,
    )
