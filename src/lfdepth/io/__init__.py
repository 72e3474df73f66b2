"""Reading light fields, writing and reading back disparity maps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import benchmark
from lfdepth.io.atomic import check_target
from lfdepth.io.npy import read_npy, read_npz, write_npy, write_npz
from lfdepth.io.pfm import read_pfm, write_pfm
from lfdepth.io.png import read_png, write_png
from lfdepth.io.record import as_record, checked_map
from lfdepth.io.source import assemble
from lfdepth.lightfield import LightField

if TYPE_CHECKING:
    from lfdepth.sweep.run import Result

__all__ = ["check_writable", "read", "read_disparity", "write"]

_WRITERS = {".pfm": write_pfm, ".png": write_png, ".npy": write_npy, ".npz": write_npz}
_READERS = {".pfm": read_pfm, ".png": read_png, ".npy": read_npy, ".npz": read_npz}


def read(path: str | Path) -> LightField:
    """Read a light field.

    Parameters
    ----------
    path : str or Path
        A folder of the 4D Light Field Benchmark.

    Raises
    ------
    LightFieldError
        If the path does not exist, is no light field, or is damaged.
    """
    path = Path(path)
    if not path.exists():
        raise LightFieldError(f"{path}: no such file or folder; expected a light field; check the path")
    if not benchmark.recognise(path):
        raise LightFieldError(
            f"{path}: not recognised as a light field; expected a folder with input_Cam000.png and so on; "
            "check the path"
        )
    return assemble(benchmark.open_benchmark(path))


def write(path: str | Path, result: Result | npt.NDArray[Any]) -> None:
    """Write a disparity map in the format that the path's ending names.

    The file is complete or not there: it is written under a temporary name, then renamed.

    Parameters
    ----------
    path : str or Path
        Ends in `.pfm` or `.npy` (the map), `.png` (16 bits, its scale in a `.json` beside it) or
        `.npz` (disparity, confidence, range, runtime in s, and the method's parameters as JSON).
    result : Result or ndarray
        What `estimate` returned, or a disparity map (H, W) in px per view step.

    Raises
    ------
    LightFieldError
        If the ending is unknown, the map is not finite, or the file cannot be written.
    """
    path = Path(path)
    _check_ending(path)
    _WRITERS[path.suffix.lower()](path, as_record(result))


def check_writable(path: str | Path) -> None:
    """Raise LightFieldError, before long work, if `write` would refuse the path."""
    _check_ending(Path(path))
    check_target(path)


def read_disparity(path: str | Path, *, finite: bool = True) -> npt.NDArray[np.float32]:
    """Read a disparity map back.

    Parameters
    ----------
    path : str or Path
        A PFM, NPY, NPZ (array `disparity`) or 16-bit PNG file with its scale beside it.
    finite : bool
        Refuse maps with NaN or infinite values.

    Returns
    -------
    ndarray, shape (H, W)
        float32, px per view step.

    Raises
    ------
    LightFieldError
        If the ending is unknown, the file is missing or damaged, or the map is not finite.
    """
    path = Path(path)
    _check_ending(path)
    if not path.is_file():
        raise LightFieldError(f"{path}: no such file; expected a disparity map; check the path")
    return checked_map(_READERS[path.suffix.lower()](path), str(path), finite=finite)


def _check_ending(path: Path) -> None:
    if path.suffix.lower() not in _WRITERS:
        raise LightFieldError(
            f"{path}: unknown ending {path.suffix or '(none)'}; expected one of {', '.join(_WRITERS)}; "
            "choose one of these"
        )
