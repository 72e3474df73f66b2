"""Where the frames of a video are: a path for each, a folder of them, or an array with a time axis."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.io import read
from lfdepth.io.hdf5 import read_hdf5
from lfdepth.io.layout import Layout
from lfdepth.io.limits import readable
from lfdepth.io.names import natural
from lfdepth.io.source import Selection, assemble
from lfdepth.io.stack import open_stack
from lfdepth.io.zarr_store import is_zarr, read_arrays
from lfdepth.lightfield import LightField

_FIELDS = (".npz", ".npy", ".h5", ".hdf5", ".mat", ".tif", ".tiff")
"""Endings of files that hold a light field each."""
_OF_ARRAYS = frozenset(
    ("views", "crop", "scale", "transpose", "flip_v", "flip_u", "serpentine", "white_level")
)
"""What may be said of how frames of an array are read."""
_TIME_AXES = 6


@dataclass(frozen=True)
class Frame:
    """One frame.

    Attributes
    ----------
    name
        What it is called: its path, or the array's and its place in it.
    read
        Reads it, with a value of white in place of what its samples suggest, or None.
    """

    name: str
    read: Callable[[float | None], LightField]


def find_frames(paths: Sequence[str | Path], reading: Mapping[str, Any]) -> list[Frame]:
    """The frames, in the order of the numbers in their names; nothing of them is read.

    Parameters
    ----------
    paths
        Light fields, one for each frame; or one folder of them; or one array (T, V, U, H, W, C).
    reading
        Arguments of `lfdepth.read`; for an array those that select and reorder views.

    Raises
    ------
    LightFieldError
        If there are no frames, one is missing in a numbered series, or an array is none of frames.
    """
    given = [Path(path) for path in paths]
    if len(given) == 1 and (array := _timed(given[0])) is not None:
        return _frames_of(array, given[0], reading)
    if len(given) == 1 and given[0].is_dir() and not is_zarr(given[0]):
        given = _inside(given[0])
    if not given:
        raise LightFieldError("video: no frames; expected light fields, one for each; name them")
    given.sort(key=lambda path: natural(str(path)))
    _check_numbers(given)

    def of(path: Path) -> Frame:
        return Frame(str(path), lambda white: read(path, **_with_white(reading, white)))

    return [of(path) for path in given]


def _inside(folder: Path) -> list[Path]:
    """The light fields in a folder."""
    found = [
        each
        for each in folder.iterdir()
        if not each.name.startswith(".") and (each.is_dir() or each.suffix.lower() in _FIELDS)
    ]
    if not found:
        raise LightFieldError(
            f"{folder}: holds no folders and no files such as .npz; expected a light field for each frame; "
            "name the frames one by one"
        )
    return found


def _check_numbers(paths: Sequence[Path]) -> None:
    """Raise LightFieldError where names that differ in one number skip one."""
    fields = [re.split(r"(\d+)", path.name) for path in paths]
    if len({len(each) for each in fields}) != 1:
        return
    differing = [i for i in range(len(fields[0])) if len({each[i] for each in fields}) > 1]
    if len(differing) != 1 or differing[0] % 2 == 0 or len({path.parent for path in paths}) != 1:
        return
    numbers = [int(each[differing[0]]) for each in fields]
    steps = np.diff(numbers)
    if not steps.size or steps.min() == 0 or (steps == steps.min()).all():
        return
    first = int(np.flatnonzero(steps != steps.min())[0])
    missing = fields[first].copy()
    missing[differing[0]] = str(numbers[first] + steps.min()).zfill(len(fields[first][differing[0]]))
    raise LightFieldError(
        f"{paths[first].with_name(''.join(missing))}: is missing between {paths[first].name} and "
        f"{paths[first + 1].name}; expected all frames of the series; add it, or rename those after it"
    )


# --- arrays


def _timed(path: Path) -> Any:
    """The array of six axes that a file or Zarr store holds, not read yet; None if it holds none."""
    if is_zarr(path):
        arrays = read_arrays(path)
    elif path.suffix.lower() == ".npy" and path.is_file():
        with readable(path):
            arrays = {"": np.load(path, mmap_mode="r", allow_pickle=False)}
    elif path.suffix.lower() in (".h5", ".hdf5") and path.is_file():
        arrays = read_hdf5(path)
    else:
        return None
    timed = [name for name, array in arrays.items() if len(array.shape) == _TIME_AXES]
    if len(timed) > 1:
        raise LightFieldError(
            f"{path}: holds {len(timed)} arrays with a time axis ({', '.join(timed)}); expected one; remove "
            "the others"
        )
    return arrays[timed[0]] if timed else None


def _frames_of(array: Any, path: Path, reading: Mapping[str, Any]) -> list[Frame]:
    if not array.shape[0]:
        raise LightFieldError(f"{path}: array of shape {array.shape}; expected at least one frame; check it")
    if other := sorted(reading.keys() - _OF_ARRAYS):
        raise LightFieldError(
            f"{path}: {other[0]} is given for an array with a time axis (T, V, U, H, W, C); expected only "
            f"{', '.join(sorted(_OF_ARRAYS))}; leave it out"
        )

    def frame(number: int, white: float | None) -> LightField:
        with readable(path):
            views = np.asarray(array[number])
        selection = Selection(**_with_white(reading, white))
        return assemble(open_stack(views, path, Layout(axes="VUHWC")), selection)

    def of(number: int) -> Frame:
        return Frame(f"{path}[{number}]", lambda white: frame(number, white))

    return [of(number) for number in range(array.shape[0])]


def _with_white(reading: Mapping[str, Any], white: float | None) -> dict[str, Any]:
    return {**reading} if white is None else {**reading, "white_level": white}
