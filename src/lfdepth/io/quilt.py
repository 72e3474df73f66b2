"""Quilts: one row of views, tiled into one picture, as light field displays take them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io.layout import Layout
from lfdepth.io.picture import ENDINGS, read_picture
from lfdepth.io.source import ViewSource

_NAME = re.compile(r".*_qs(\d+)x(\d+)(?:a\d+(?:\.\d+)?)?")


def recognise(path: Path) -> bool:
    """True for a picture named `NAME_qsCxR.png` or `NAME_qsCxRaASPECT.png`."""
    return path.suffix.lower() in ENDINGS and path.is_file() and _NAME.fullmatch(path.stem) is not None


def open_quilt(path: Path, layout: Layout) -> ViewSource:
    """Open a quilt of C columns and R rows of tiles.

    Its tiles are one row of C·R views: the bottom left tile is the leftmost view, the next ones follow to the
    right and then upwards. C and R come from the name, or from a grid given as (R, C).

    Raises
    ------
    LightFieldError
        If neither name nor grid says how many tiles there are, or the picture does not divide into them.
    """
    named = _NAME.fullmatch(path.stem)
    tiles = layout.grid or (named and (int(named[2]), int(named[1])))
    if not tiles or 0 in tiles:
        raise LightFieldError(
            f"{path}: name gives no tiles; expected NAME_qsCxRaA with C columns and R rows; rename it or "
            "give C x R "
            "(grid)"
        )
    rows, columns = tiles
    picture = read_picture(path)
    height, width = picture.shape[0] // rows, picture.shape[1] // columns
    if picture.shape[:2] != (height * rows, width * columns):
        raise LightFieldError(
            f"{path}: {picture.shape[1]}x{picture.shape[0]} px; expected multiples of {columns}x{rows} "
            "tiles; "
            "correct the name or the grid"
        )

    def read_view(_: int, u: int) -> npt.NDArray[Any]:
        row, column = rows - 1 - u // columns, u % columns
        return picture[row * height : (row + 1) * height, column * width : (column + 1) * width]

    return ViewSource(
        grid=(1, rows * columns),
        read_view=read_view,
        describe=lambda _, u: f"{path}: view {u}",
        name=path.stem,
    )
