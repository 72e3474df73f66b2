"""TIFF: stacks with a page for each view, and float maps."""

from __future__ import annotations

import json
import re
import struct
from dataclasses import dataclass
from math import prod
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import signature, stack
from lfdepth.io.alpha import without_alpha
from lfdepth.io.atomic import atomic
from lfdepth.io.extras import need_tifffile
from lfdepth.io.layout import Layout
from lfdepth.io.notes import KEY, Notes, notes_of, parse_notes
from lfdepth.io.picture import check_page, decode_page, white_of_page
from lfdepth.io.record import Record
from lfdepth.io.source import ViewSource
from lfdepth.io.white import white_of_bits
from lfdepth.lightfield import LightField


def recognise(path: Path) -> bool:
    """True for a TIFF file."""
    return signature.starts_with(path, *signature.TIFF)


def open_tiff(path: Path, layout: Layout) -> ViewSource:
    """Open a TIFF with a page for each view, row by row, or for each colour of a view.

    The grid is that of the file's notes, else the one asked for, else what the file says of its axes, else a
    square. ImageJ's hyperstacks and OME-TIFF, which say what their axes are, may store colours as grey pages.

    Raises
    ------
    LightFieldError
        If tifffile is not installed, the file is truncated, has a single page, or channels that are no
        colours.
    """
    tifffile = need_tifffile(path)
    file = None
    try:
        file = tifffile.TiffFile(path, _multifile=False)  # what other files hold is not asked for
        _check_order(file)
        stored = _Stored.of(file)
        description = str(file.pages[0].description)
        windowed = stored.windowed()
    except Exception as error:  # tifffile raises many kinds on damaged files
        if file is not None:
            file.close()
        raise stack.unreadable(path, error) from None
    lock = Lock()  # the pages share one file handle

    def read_view(v: int, u: int) -> npt.NDArray[Any]:
        try:
            with lock:
                decoded = [
                    stored.page(each, f"{path}: page {each}") for each in stored.pages_of(v * grid[1] + u)
                ]
        except LightFieldError:  # a ValueError, too
            raise
        except Exception as error:
            raise stack.unreadable(path, error) from error
        if wrong := next((mode for _, mode in decoded if mode not in ("L", "RGB", "LA", "RGBA")), None):
            raise LightFieldError(f"{path}: page of {wrong}; expected grey or RGB pages; convert them")
        views = [pixels if pixels.ndim == 3 else pixels[..., None] for pixels, _ in decoded]
        view = views[0] if len(views) == 1 else np.concatenate(views, axis=-1)
        return without_alpha(view, f"{path}: page {v * grid[1] + u}") if view.shape[2] in (2, 4) else view

    def read_part(v: int, u: int, rows: slice, columns: slice) -> npt.NDArray[Any]:
        with lock:
            return stored.part(path, v * grid[1] + u, rows)[:, columns]

    try:
        if stored.pages < 2:
            raise LightFieldError(
                f"{path}: a single page; expected one page per view; copy it again if there were more, or, "
                "if it is an ESLF picture, a quilt or a mosaic of views, name the format (format)"
            )
        if stored.colours not in (1, 3):
            raise LightFieldError(
                f"{path}: {stored.colours} channels; expected grey views, or red, green and blue; keep a "
                "single channel"
            )
        notes = _notes_in(description, path)
        axes = stored.axes if notes is None else notes.shape[:2]
        grid = (
            (axes[0], axes[1])
            if len(axes) == 2 and axes[0] * axes[1] == stored.views and not layout.grid
            else Layout(layout.grid).of_count(stored.views, str(path))
        )
    except BaseException:
        file.close()
        raise
    source = ViewSource(
        grid=grid,
        read_view=read_view,
        read_part=None if windowed is None else read_part,
        size=windowed,
        describe=lambda v, u: f"{path}: page {v * grid[1] + u}",
        close=file.close,
        white=stored.white,
        name=path.stem,
    )
    return source if notes is None else notes.annotate(source)


@dataclass(frozen=True, eq=False)
class _Stored:
    """How the pages of a TIFF make up views.

    Attributes
    ----------
    series
        What has the pages: tifffile's description of the first image in the file, or the file.
    pages
        How many planes of pixels there are.
    colours
        Pages for each view.
    axes
        Lengths of the axes of views, without colours.
    apart
        Distance between the pages of a view's colours.
    white
        Value of white that the file states.
    planes
        All pixels, (pages, ...), where the file describes one page and leaves all others right behind it, as
        ImageJ does with large stacks.
    """

    series: Any
    pages: int
    colours: int
    axes: tuple[int, ...]
    apart: int
    white: float | None
    planes: Any = None

    @staticmethod
    def of(file: Any) -> _Stored:
        series = file.series[0]
        outer = [
            (axis, int(n)) for axis, n in zip(series.axes, series.shape, strict=True) if axis not in "YXS"
        ]
        names, lengths = [axis for axis, _ in outer], [length for _, length in outer]
        count = prod(lengths)
        described = file.is_imagej or file.is_ome
        if not described and count != len(file.pages):  # several images: take them one by one
            return _Stored(file, len(file.pages), 1, (), 1, white_of_page(file.pages[0]))
        at = names.index("C") if described and "C" in names and "S" not in series.axes else None
        colours = lengths.pop(at) if at is not None else 1
        apart = 1 if at is None else prod(length for _, length in outer[at + 1 :])
        planes = None
        if len(series.pages) != count:
            first, order = series.pages[0], file.byteorder
            shape = (count, *first.shape)
            kind = np.dtype(first.dtype).newbyteorder(order)
            planes = np.memmap(file.filehandle.path, kind, "r", series.dataoffset, shape)
        return _Stored(series, count, colours, tuple(lengths), apart, _white(file), planes)

    @property
    def views(self) -> int:
        """How many views there are."""
        return self.pages // self.colours

    def pages_of(self, view: int) -> list[int]:
        """The pages of a view's colours."""
        block, rest = divmod(view, self.apart)
        first = block * self.colours * self.apart + rest
        return [first + colour * self.apart for colour in range(self.colours)]

    def windowed(self) -> tuple[int, int] | None:
        """(H, W) of pages that lie in the file as they are, so that some of their rows can be read alone."""
        if self.planes is not None or self.colours != 1:
            return None
        pages = list(self.series.pages)
        first = pages[0].keyframe
        plain = (
            first.compression == first.predictor == first.fillorder == 1
            and first.photometric.name in ("MINISBLACK", "RGB")
            and first.planarconfig in (None, 1)
            and first.dtype in (np.uint8, np.uint16, np.float32)
            and first.bitspersample == 8 * first.dtype.itemsize
            and first.samplesperpixel in (1, 3)
        )
        if not plain or any(page.keyframe.hash != first.hash or not page.is_contiguous for page in pages):
            return None
        return first.imagelength, first.imagewidth

    def part(self, path: Path, number: int, rows: slice) -> npt.NDArray[Any]:
        """Some rows of a page, where pages are `windowed`."""
        page = self.series.pages[number]
        first = page.keyframe
        start, stop, _ = rows.indices(first.imagelength)
        shape = (stop - start, first.imagewidth, first.samplesperpixel)
        order = np.dtype(first.dtype).newbyteorder(first.parent.byteorder)
        offset = page.dataoffsets[0] + start * prod(shape[1:]) * order.itemsize
        block = np.fromfile(path, order, prod(shape), offset=offset)
        if block.size != prod(shape):
            raise stack.unreadable(path, ValueError("the file has become shorter"))
        return block.astype(order.newbyteorder("="), copy=False).reshape(shape)

    def page(self, number: int, what: str) -> tuple[npt.NDArray[Any], str]:
        """Pixels of a page, called `what` in messages, and their mode."""
        if self.planes is None:
            return decode_page(self.series.pages[number], what)
        return decode_page(_Plane(self.series.pages[0], self.planes[number]), what)


class _Plane:
    """A page without tags of its own."""

    def __init__(self, first: Any, pixels: npt.NDArray[Any]) -> None:
        self.keyframe, self._pixels = first.keyframe, pixels

    def asarray(self) -> npt.NDArray[Any]:
        return self._pixels


def _check_order(file: Any) -> None:
    """Raise ValueError where a page comes after itself: tifffile would go round and round."""
    form, handle = file.tiff, file.filehandle
    seen: set[int] = set()
    at = file.pages[0].offset
    while 0 < at < handle.size:
        if at in seen:
            raise ValueError("its pages form a loop")
        seen.add(at)
        handle.seek(at)
        tags = handle.read(form.tagnosize)
        if len(tags) < form.tagnosize:
            return
        handle.seek(struct.unpack(form.tagnoformat, tags)[0] * form.tagsize, 1)
        following = handle.read(form.offsetsize)
        at = struct.unpack(form.offsetformat, following)[0] if len(following) == form.offsetsize else 0


def _white(file: Any) -> float | None:
    """The value of white that a TIFF states: by its tags, or by what OME calls significant bits."""
    if file.is_ome and (bits := re.search(r'SignificantBits="(\d+)"', str(file.ome_metadata))):
        return white_of_bits(int(bits[1])) if 8 <= int(bits[1]) < 16 else None
    return white_of_page(file.pages[0])


def pages_of_tiff(path: Path) -> int:
    """How many pages a TIFF has."""
    tifffile = need_tifffile(path)
    try:
        with tifffile.TiffFile(path) as file:
            _check_order(file)
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
