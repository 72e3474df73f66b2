"""Light fields that are one array: which axis is which, which of several arrays, and view by view access."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io.layout import Layout, size
from lfdepth.io.limits import readable
from lfdepth.io.limits import unreadable as unreadable
from lfdepth.io.notes import KEY, Notes, parse_notes
from lfdepth.io.source import ViewSource

# What light field arrays are called, the likeliest first.
NAMES = ("LF", "lf", "views", "light_field", "lightfield", "lightField", "LightField")

# N is a running number of views. The first layout that fits is taken.
_LAYOUTS = {
    5: ("VUHWC", "VUCHW", "HWCVU", "HWVUC"),
    4: ("NHWC", "NCHW", "VUHW", "HWVU"),
    3: ("NHW", "HWN"),
}


class Array(Protocol):
    """What arrays in memory, in a mapped file, in HDF5 and in Zarr have in common."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of each axis."""

    @property
    def dtype(self) -> Any:
        """Sample type."""

    def __getitem__(self, index: Any, /) -> Any:
        """Part of the array, read when asked for."""


def choose_array(shapes: Mapping[str, tuple[int, ...]], path: Path) -> str:
    """Name of the array that is a light field: by its own name, else the only one with enough axes.

    Raises
    ------
    LightFieldError
        If there is none, or several.
    """
    stacks = [name for name, shape in shapes.items() if len(shape) in _LAYOUTS]
    named = [name for name in NAMES if name in stacks]
    candidates = named[:1] or [name for name in stacks if len(shapes[name]) > 3] or stacks
    if len(candidates) == 1:
        return candidates[0]
    found = ", ".join(f"{name} {shape}" for name, shape in list(shapes.items())[:8]) or "no arrays"
    raise LightFieldError(f"{path}: holds {found}; expected one light field (V, U, H, W, C); name it LF")


def open_arrays(
    arrays: Mapping[str, Array],
    text: object,
    path: Path,
    layout: Layout,
    close: Callable[[], None] = lambda: None,
    channels: int | None = None,
) -> ViewSource:
    """The light field among the named arrays of a file, with what the file's notes say of it.

    Parameters
    ----------
    arrays : mapping
        Arrays by name.
    text : object
        What the file has under the name `notes.KEY`; None if nothing.
    path, layout, close, channels
        As for `open_stack`.

    Raises
    ------
    LightFieldError
        If there is no light field, or several, or the notes are garbled.
    """
    notes = None if text is None else parse_notes(text, f"{path}: {KEY}")
    name = choose_array({name: array.shape for name, array in arrays.items()}, path)
    source = open_stack(arrays[name], path, layout, close, channels, notes)
    return source if notes is None else notes.annotate(source, arrays)


def open_stack(
    array: Array,
    path: Path,
    layout: Layout,
    close: Callable[[], None] = lambda: None,
    channels: int | None = None,
    notes: Notes | None = None,
) -> ViewSource:
    """Views of an array.

    Parameters
    ----------
    array : array-like
        Five axes, (V, U, H, W, C) or another usual order; four, without C or with one running number for V
        and U; or three, a running number and no C.
    path : Path
        For messages.
    layout : Layout
        The grid of views that are only numbered.
    close : callable
        Called when all views are read.
    channels : int, optional
        Channels of the array that are read, if it has more.
    notes : Notes, optional
        What is known of the array; else the order of its axes is found out by their lengths.

    Raises
    ------
    LightFieldError
        If the array is not the one that the notes are about, no order of axes fits, or the samples are
        neither 8-bit, 16-bit nor float.
    """
    if notes is not None:
        _check_notes(array.shape, notes, path)
    axes = "VUHWC" if notes else _axes(array.shape, (1, 3) if channels is None else (1, 3, channels + 1))
    if axes is None:
        raise LightFieldError(
            f"{path}: array of shape {array.shape}; expected (V, U, H, W, C) with C = 1 or 3; reorder the "
            "axes"
        )
    _check_samples(array.dtype, path)
    lengths = dict(zip(axes, array.shape, strict=True))
    numbered = "N" in lengths
    grid = Layout(layout.grid).of_count(lengths["N"], str(path)) if numbered else (lengths["V"], lengths["U"])
    if not numbered and layout.grid not in (None, grid):
        raise LightFieldError(
            f"{path}: a grid of {size(grid)}; expected {size(layout.grid or grid)} as asked for; "
            "leave the grid out or correct it"
        )

    def read_part(v: int, u: int, rows: slice, columns: slice) -> npt.NDArray[Any]:
        at = {"N": v * grid[1] + u, "V": v, "U": u, "H": rows, "W": columns}
        with readable(path):
            view = np.asarray(array[tuple(at.get(axis, slice(None)) for axis in axes)])
        return _as_samples(_as_hwc(view, axes)[..., :channels])

    return ViewSource(
        grid=grid,
        read_view=lambda v, u: read_part(v, u, slice(None), slice(None)),
        read_part=read_part,
        describe=lambda v, u: f"{path}: view ({v}, {u})",
        close=close,
        name=path.stem,
    )


def _check_notes(shape: tuple[int, ...], notes: Notes, path: Path) -> None:
    if shape != notes.shape:
        raise LightFieldError(
            f"{path}: array of shape {shape}; expected {notes.shape}, as the notes that belong to it say; "
            "write the light field again, or remove the notes"
        )


def _axes(shape: tuple[int, ...], colours: tuple[int, ...]) -> str | None:
    """First layout whose colours are colours and whose views are larger than their grid."""
    fitting = [axes for axes in _LAYOUTS.get(len(shape), ()) if _fits(axes, shape, colours)]
    return next((axes for axes in fitting if _is_likely(axes, shape)), fitting[0] if fitting else None)


def _fits(axes: str, shape: tuple[int, ...], colours: tuple[int, ...]) -> bool:
    return "C" not in axes or shape[axes.index("C")] in colours


def _is_likely(axes: str, shape: tuple[int, ...]) -> bool:
    pixels = min(shape[axes.index(axis)] for axis in "HW")
    return "N" in axes or max(shape[axes.index(axis)] for axis in "VU") < pixels


def _as_hwc(view: npt.NDArray[Any], axes: str) -> npt.NDArray[Any]:
    left = [axis for axis in axes if axis in "HWC"]
    view = view.transpose([left.index(axis) for axis in "HWC" if axis in left])
    return view if "C" in left else view[..., None]


def _check_samples(dtype: np.dtype[Any], path: Path) -> None:
    if dtype.newbyteorder("=") not in (np.uint8, np.uint16) and dtype.kind != "f":
        raise LightFieldError(f"{path}: samples are {dtype}; expected uint8, uint16 or float; convert them")


def _as_samples(view: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Native byte order, and float32 for any float."""
    return view.astype(np.float32 if view.dtype.kind == "f" else view.dtype.newbyteorder("="), copy=False)
