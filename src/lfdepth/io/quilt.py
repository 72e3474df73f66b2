"""Quilts: one row of views, tiled into one picture, as light field displays take them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic
from lfdepth.io.layout import Layout
from lfdepth.io.notes import KEY, beside, notes_of, parse_notes, read_notes
from lfdepth.io.picture import ENDINGS, read_picture, write_picture
from lfdepth.io.png_text import text_in
from lfdepth.io.source import ViewSource
from lfdepth.lightfield import LightField

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

    source = ViewSource(
        grid=(1, rows * columns),
        read_view=read_view,
        describe=lambda _, u: f"{path}: view {u}",
        name=path.stem,
    )
    text = text_in(path)
    notes = read_notes(beside(path)) if text is None else parse_notes(text, f"{path}: {KEY}")
    return source if notes is None else notes.annotate(source)


def write_quilt(path: Path, lf: LightField) -> None:
    """Write a row of views as `NAME_qsCxRaA.png`, and what pixels cannot hold as a text in it.

    Raises
    ------
    LightFieldError
        If the name gives no tiles or not as many as there are views, the views are not one row, or float.
    """
    named = _NAME.fullmatch(path.stem)
    v, u, height, width, channels = lf.shape
    columns, rows = (int(named[1]), int(named[2])) if named else (0, 0)
    if (v, u) != (1, columns * rows):
        raise LightFieldError(
            f"{path}: {u}x{v} views; expected a single row of them, and a name NAME_qsCxRaA.png with C "
            f"times R tiles; if there are more rows, read them with --views {u}x1 (views=(1, {u}) in "
            f"Python); call it {_suggestion(path, lf)}"
        )
    if lf.views.dtype == np.float32:
        raise LightFieldError(f"{path}: float views; expected 8 or 16 bits; convert them (--samples uint16)")
    tiles = lf.views[0].reshape(rows, columns, height, width, channels)[::-1]
    picture = tiles.transpose(0, 2, 1, 3, 4).reshape(rows * height, columns * width, channels)
    with atomic(path) as temporary:
        write_picture(temporary, picture, text=notes_of(lf).text())


def _suggestion(path: Path, lf: LightField) -> str:
    name = re.sub(r"_qs[^_]*$", "", path.stem)
    return f"{name}_qs{lf.shape[1]}x1a{round(lf.width / lf.height, 3):g}.png"
