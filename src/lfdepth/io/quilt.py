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
from lfdepth.io.picture import ENDINGS, read_picture, stated_white, write_picture
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
    right and then upwards. C and R come from the name, or from a grid given as (R, C). Where the picture's
    size is no multiple of them, tiles are as large as whole pixels allow. They then lie side by side from the
    bottom left corner, as displays take them, or from the top left one, if the strip that is left over at the
    edge is of one colour; else each starts at the pixel next to its share of the picture.

    Raises
    ------
    LightFieldError
        If neither name nor grid says how many tiles there are, or the picture has not a pixel for each.
    """
    named = _NAME.fullmatch(path.stem)
    tiles = layout.grid or (named and (int(named[2]), int(named[1])))
    if not tiles or 0 in tiles:
        raise LightFieldError(
            f"{path}: the name states no tiles; expected NAME_qsCxRaA with C columns and R rows; rename it "
            "or give C x R (grid)"
        )
    rows, columns = tiles
    picture = read_picture(path)
    height, width = picture.shape[0] // rows, picture.shape[1] // columns
    if 0 in (height, width):
        raise LightFieldError(
            f"{path}: {picture.shape[1]}x{picture.shape[0]} px; expected at least one pixel for each of "
            f"{columns}x{rows} tiles; fix the name or the grid"
        )
    tops, where = _starts(picture, 0, rows)
    lefts, _ = _starts(picture, 1, columns)

    def read_view(_: int, u: int) -> npt.NDArray[Any]:
        top, left = tops[rows - 1 - u // columns], lefts[u % columns]
        return picture[top : top + height, left : left + width]

    exact = picture.shape[:2] == (height * rows, width * columns)
    remark = f"{picture.shape[1]}x{picture.shape[0]} px are not a multiple of {columns}x{rows} tiles: {where}"
    source = ViewSource(
        grid=(1, rows * columns),
        read_view=read_view,
        describe=lambda _, u: f"{path}: view {u}",
        white=stated_white(path),
        remarks=() if exact else (remark,),
        name=path.stem,
    )
    text = text_in(path)
    notes = read_notes(beside(path)) if text is None else parse_notes(text, f"{path}: {KEY}")
    return source if notes is None else notes.annotate(source)


def _starts(picture: npt.NDArray[Any], axis: int, count: int) -> tuple[list[int], str]:
    """Where each of `count` tiles starts, from the top (axis 0) or the left (axis 1), and why there."""
    length = picture.shape[axis] // count
    left_over = picture.shape[axis] - count * length
    from_start = [i * length for i in range(count)]
    strips = (picture[:left_over], picture[picture.shape[0] - left_over :])
    if axis == 1:  # views go from the left, and what is left over is at the right
        strips = (picture[:, :0], picture[:, picture.shape[1] - left_over :])
    if left_over == 0 or (axis == 1 and _plain(strips[1])):
        return from_start, "tiles lie side by side"
    if axis == 0 and _plain(strips[0]):
        return [left_over + start for start in from_start], "tiles lie side by side from the bottom"
    if axis == 0 and _plain(strips[1]):
        return from_start, "tiles lie side by side from the top"
    shares = [round(i * picture.shape[axis] / count) for i in range(count)]
    return [
        min(start, picture.shape[axis] - length) for start in shares
    ], "each was cut at the nearest pixels"


def _plain(strip: npt.NDArray[Any]) -> bool:
    """Whether a strip of a picture has a single colour."""
    return bool((strip == strip[:1, :1]).all())


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
