"""Light fields that are one array: which axis is which, which of several arrays, and view by view access."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from math import isqrt
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io.alpha import without_alpha
from lfdepth.io.layout import Layout, size
from lfdepth.io.limits import readable
from lfdepth.io.limits import unreadable as unreadable
from lfdepth.io.notes import KEY, Notes, parse_notes
from lfdepth.io.record import checked_map
from lfdepth.io.source import ViewSource
from lfdepth.io.white import whole_samples

# What light field arrays are called, the likeliest first.
NAMES = ("LF", "lf", "views", "light_field", "lightfield", "lightField", "LightField")

# N is a running number of views. The first layout that fits is taken. The axes of MATLAB's arrays come out in
# reverse in other programs: colours first and the grid last.
_LAYOUTS = {
    5: ("VUHWC", "VUCHW", "HWCVU", "HWVUC", "CWHUV", "CVUHW"),
    4: ("NHWC", "NCHW", "HWCN", "VUHW", "HWVU", "CWHN"),
    3: ("NHW", "HWN"),
}
# Where MATLAB may have written the file: the same lengths, read as MATLAB's.
_REVERSED = {"HWVU": "WHUV", "HWN": "WHN"}
_ALPHA = 4
# Pictures are at most so many times longer than wide, where that decides.
_SLIMMEST = 4

# What the truth is called in others' files, and nothing after it but where and of what.
_TRUTH = re.compile(
    r"(gt_?|ground_?truth_?)?disp(arity)?(_(gt|lowres|all|center|centre|central))*|truth|gt", re.I
)


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
    stacks = [name for name, shape in shapes.items() if len(shape) in _LAYOUTS and not is_truth(name)]
    named = [name for own in NAMES for name in stacks if _last(name) == own]
    same = [name for name in named if _last(name) == _last(named[0])]
    candidates = same or [name for name in stacks if len(shapes[name]) > 3] or stacks
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
    *,
    matlab: bool = False,
) -> ViewSource:
    """The light field among the named arrays of a file, with what the file's notes say of it.

    Parameters
    ----------
    arrays : mapping
        Arrays by name.
    text : object
        What the file has under the name `notes.KEY`; None if nothing.
    path, layout, close, channels, matlab
        As for `open_stack`.

    Returns
    -------
    ViewSource
        With the truth of the reference view, where an array is called so and has its size.

    Raises
    ------
    LightFieldError
        If there is no light field, or several, or the notes are garbled.
    """
    notes = None if text is None else parse_notes(text, f"{path}: {KEY}")
    name = choose_array({name: array.shape for name, array in arrays.items()}, path)
    source = open_stack(arrays[name], path, layout, close, channels, notes, matlab=matlab)
    if notes is not None:
        return notes.annotate(source, arrays)
    axes = _order_of(arrays[name].shape, layout, channels, matlab)
    assert axes is not None  # or it could not have been opened
    return _with_truth(source, arrays, name, axes)


def open_stack(
    array: Array,
    path: Path,
    layout: Layout,
    close: Callable[[], None] = lambda: None,
    channels: int | None = None,
    notes: Notes | None = None,
    *,
    matlab: bool = False,
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
        Channels of the array that are read, if it has more. Otherwise, a fourth one has to be alpha that is
        opaque.
    notes : Notes, optional
        What is known of the array; else the order of its axes is found out by their lengths.
    matlab : bool
        Whether MATLAB, whose axes run in reverse, may have written the file, where lengths do not tell.

    Raises
    ------
    LightFieldError
        If the array is not the one that the notes are about, no order of axes fits, or the samples are
        neither whole numbers nor float.
    """
    if notes is not None:
        _check_notes(array.shape, notes, path)
    axes = "VUHWC" if notes else _order_of(array.shape, layout, channels, matlab)
    if axes is None:
        raise LightFieldError(
            f"{path}: array of shape {array.shape}; expected (V, U, H, W, C) with C = 1 or 3"
            f"{'' if layout.axes is None else f', or what {layout.axes} says'}; reorder the axes, or name "
            "them (--axes, such as WHUVC)"
        )
    _check_samples(array.dtype, path)
    lengths = dict(zip(axes, array.shape, strict=True))
    numbered = "N" in lengths
    stored = None if numbered else (lengths["V"], lengths["U"])
    grid = layout.grid or stored
    if stored is None or grid is None:
        grid = Layout(layout.grid).of_count(lengths["N"], str(path))
    elif grid != stored and (notes is not None or grid[0] * grid[1] != stored[0] * stored[1]):
        raise LightFieldError(
            f"{path}: a grid of {size(stored)}; expected {size(grid)} as asked for; "
            "change the grid or leave it out"
        )

    def read_part(v: int, u: int, rows: slice, columns: slice) -> npt.NDArray[Any]:
        number = v * grid[1] + u
        row, column = divmod(number, stored[1]) if stored else (v, u)
        at = {"N": number, "V": row, "U": column, "H": rows, "W": columns}
        with readable(path):
            view = np.asarray(array[tuple(at.get(axis, slice(None)) for axis in axes)])
        samples = _as_samples(_as_hwc(view, axes)[..., :channels], f"{path}: view ({v}, {u})")
        return without_alpha(samples, f"{path}: view ({v}, {u})") if samples.shape[2] == _ALPHA else samples

    return ViewSource(
        grid=grid,
        read_view=lambda v, u: read_part(v, u, slice(None), slice(None)),
        read_part=read_part,
        size=(lengths["H"], lengths["W"]),
        describe=lambda v, u: f"{path}: view ({v}, {u})",
        close=close,
        remarks=() if notes or axes == _LAYOUTS[len(axes)][0] or axes == "VUHW" else (_order_remark(axes),),
        name=path.stem,
    )


def _check_notes(shape: tuple[int, ...], notes: Notes, path: Path) -> None:
    if shape != notes.shape:
        raise LightFieldError(
            f"{path}: array of shape {shape}; expected {notes.shape}, as stated in the notes beside it; "
            "write the light field again, or remove the notes"
        )


def _order_of(shape: tuple[int, ...], layout: Layout, channels: int | None, matlab: bool) -> str | None:
    """The order of axes: as the caller says, else by the lengths; None if none fits.

    Of the layouts whose colours are colours, the first whose views are larger than their grid; four channels
    count as colours, with alpha, only where nothing else does.
    """
    rounds = [(1, 3), (1, 3, _ALPHA)] if channels is None else [(1, 3, channels + 1)]
    if layout.axes is not None:
        fits = len(layout.axes) == len(shape) and _fits(layout.axes, shape, rounds[-1])
        return layout.axes if fits else None
    known = _LAYOUTS.get(len(shape), ())
    for colours in rounds:
        for axes in known:
            if _fits(axes, shape, colours) and _is_likely(axes, shape, layout):
                return _by_matlab(axes, shape) if matlab and axes in _REVERSED else axes
    return next((axes for axes in known if axes[0] != "C" and _fits(axes, shape, rounds[-1])), None)


def _by_matlab(axes: str, shape: tuple[int, ...]) -> str:
    """Whether MATLAB wrote pixels before the grid: then x comes before y, and pictures are rarely upright."""
    return axes if shape[0] < shape[1] else _REVERSED[axes]


def _fits(axes: str, shape: tuple[int, ...], colours: tuple[int, ...]) -> bool:
    return "C" not in axes or shape[axes.index("C")] in colours


def _is_likely(axes: str, shape: tuple[int, ...], layout: Layout) -> bool:
    pixels = min(shape[axes.index(axis)] for axis in "HW")
    if "N" not in axes:
        return max(shape[axes.index(axis)] for axis in "VU") < pixels
    if "C" not in axes:
        return True
    count = shape[axes.index("N")]
    squares = layout.grid is None and isqrt(count) ** 2 == count
    longest = max(shape[axes.index(axis)] for axis in "HW")
    # Three rows and views that would be a few pixels wide: rather a grid of grey views.
    return (
        longest <= _SLIMMEST * pixels
        and pixels > _ALPHA
        and (squares or (layout.grid is not None and layout.grid[0] * layout.grid[1] == count))
    )


def _order_remark(axes: str) -> str:
    mirrored = axes.translate(str.maketrans("HWVU", "WHUV"))
    return (
        f"axes of the array taken as ({', '.join(axes)}), by their lengths; if the picture lies on its side, "
        f"use --axes {mirrored}"
    )


def is_truth(name: str) -> bool:
    """Whether an array is called as the truth usually is."""
    return _TRUTH.fullmatch(_last(name)) is not None


def _last(name: str) -> str:
    """The name of an array in a group."""
    return name.rpartition("/")[2]


def _with_truth(source: ViewSource, arrays: Mapping[str, Array], name: str, axes: str) -> ViewSource:
    """The same with the truth that lies beside the light field, in the same group or outside of any."""
    group = name.rpartition("/")[0]
    lengths = dict(zip(axes, arrays[name].shape, strict=True))
    for other, array in arrays.items():
        if not is_truth(other) or other.rpartition("/")[0] not in (group, "") or array.dtype.kind != "f":
            continue
        for order in (axes.replace("C", ""), "".join(axis for axis in axes if axis in "HW")):
            if array.shape == tuple(lengths[axis] for axis in order):
                number = source.grid[0] // 2 * source.grid[1] + source.grid[1] // 2
                row, column = divmod(number, lengths.get("U", 1))
                at = {"V": row, "U": column, "N": number}
                values = np.asarray(array[tuple(at.get(axis, slice(None)) for axis in order)])
                upright = values if order.index("H") < order.index("W") else values.T
                truth = checked_map(np.ascontiguousarray(upright), f"{source.name}: {other}", finite=False)
                remark = f"truth taken from {other}"
                return replace(source, truth=truth, remarks=(*source.remarks, remark))
    return source


def _as_hwc(view: npt.NDArray[Any], axes: str) -> npt.NDArray[Any]:
    left = [axis for axis in axes if axis in "HWC"]
    view = view.transpose([left.index(axis) for axis in "HWC" if axis in left])
    return view if "C" in left else view[..., None]


def _check_samples(dtype: np.dtype[Any], path: Path) -> None:
    if dtype.kind not in "uif":
        raise LightFieldError(f"{path}: samples are {dtype}; expected whole numbers or float; convert them")


def _as_samples(view: npt.NDArray[Any], what: str) -> npt.NDArray[Any]:
    """Native byte order; float32 for any float, 8 or 16 bits for whole numbers."""
    return view.astype(np.float32, copy=False) if view.dtype.kind == "f" else whole_samples(view, what)
