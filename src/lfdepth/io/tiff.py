"""TIFF: stacks with a page for each view, and float maps."""

from __future__ import annotations

import json
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import signature, stack
from lfdepth.io.atomic import atomic
from lfdepth.io.extras import need_tifffile
from lfdepth.io.layout import Layout
from lfdepth.io.notes import KEY, Notes, notes_of, parse_notes
from lfdepth.io.picture import check_page, decode_page
from lfdepth.io.record import Record
from lfdepth.io.source import ViewSource
from lfdepth.lightfield import LightField


def recognise(path: Path) -> bool:
    """True for a TIFF file."""
    return signature.starts_with(path, *signature.TIFF)


def open_tiff(path: Path, layout: Layout) -> ViewSource:
    """Open a TIFF with a page for each view, row by row.

    The grid is that of the file's notes, else the one asked for, else what the file says of its axes, else a
    square.

    Raises
    ------
    LightFieldError
        If tifffile is not installed, the file is truncated, or has a single page.
    """
    tifffile = need_tifffile(path)
    try:
        file = tifffile.TiffFile(path, _multifile=False)  # what other files hold is not asked for
        count, axes = len(file.pages), tuple(file.series[0].shape)
        description = str(file.pages[0].description)
    except Exception as error:  # tifffile raises many kinds on damaged files
        raise stack.unreadable(path, error) from None
    lock = Lock()  # the pages share one file handle

    def read_view(v: int, u: int) -> npt.NDArray[Any]:
        try:
            with lock:
                pixels, mode = decode_page(file.pages[v * grid[1] + u])
        except LightFieldError:  # a ValueError, too
            raise
        except Exception as error:
            raise stack.unreadable(path, error) from error
        if mode not in ("L", "RGB"):
            raise LightFieldError(f"{path}: page of {mode}; expected grey or RGB pages; convert them")
        return pixels if pixels.ndim == 3 else pixels[..., None]

    try:
        if count < 2:
            raise LightFieldError(
                f"{path}: a single page; expected a page for each view; copy it again if there were more, "
                "or if it is an ESLF picture or a "
                "quilt, say so "
                "(format)"
            )
        notes = _notes_in(description, path)
        if notes is not None:
            axes = notes.shape
        shaped = len(axes) > 3 and axes[0] * axes[1] == count
        grid = (
            (axes[0], axes[1])
            if shaped and not layout.grid
            else Layout(layout.grid).of_count(count, str(path))
        )
    except BaseException:
        file.close()
        raise
    source = ViewSource(
        grid=grid,
        read_view=read_view,
        describe=lambda v, u: f"{path}: page {v * grid[1] + u}",
        close=file.close,
        name=path.stem,
    )
    return source if notes is None else notes.annotate(source)


def pages_of_tiff(path: Path) -> int:
    """How many pages a TIFF has."""
    tifffile = need_tifffile(path)
    try:
        with tifffile.TiffFile(path) as file:
            return len(file.pages)
    except Exception as error:
        raise stack.unreadable(path, error) from None


def read_tiff(path: Path) -> npt.NDArray[Any]:
    """Read a map.

    Raises
    ------
    LightFieldError
        If tifffile is not installed, or the file is damaged.
    """
    tifffile = need_tifffile(path)
    try:
        with tifffile.TiffFile(path) as file:
            check_page(file.pages[0])  # and not a series, whose pages may be in other files
            return np.asarray(file.pages[0].asarray())
    except LightFieldError:  # a ValueError, too
        raise
    except Exception as error:
        raise stack.unreadable(path, error) from None


def write_views_tiff(path: Path, lf: LightField) -> None:
    """Write a page for each view, row by row; the notes are in the description of the first.

    Raises
    ------
    LightFieldError
        If tifffile is not installed, or views are 1 px wide, which it takes for another order of axes.
    """
    tifffile = need_tifffile(path)
    if lf.width == 1:
        raise LightFieldError(f"{path}: views 1 px wide; expected at least 2 px; write another format")
    grey = lf.shape[4] == 1
    with atomic(path) as temporary:
        tifffile.imwrite(
            temporary,
            lf.views[..., 0] if grey else lf.views,
            photometric="minisblack" if grey else "rgb",
            planarconfig=None if grey else "contig",
            metadata={KEY: notes_of(lf).text()},
        )


def _notes_in(description: str, path: Path) -> Notes | None:
    try:
        text = json.loads(description)[KEY]
    except (ValueError, TypeError, KeyError):  # somebody else's description
        return None
    return parse_notes(text, f"{path}: {KEY}")


def write_tiff(path: Path, record: Record) -> None:
    """Write the map as 32-bit float; quantity and unit are in the description."""
    tifffile = need_tifffile(path)
    description = json.dumps({"quantity": record.quantity, "unit": record.unit})
    with atomic(path) as temporary:
        tifffile.imwrite(temporary, record.values, description=description, metadata=None)
