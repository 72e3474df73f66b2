"""Weights of learned systems: files of arrays, never unpickled.

A file is an NPZ of float16 or float32 arrays by name. Those in the package stand in `shipped`, each beside a
JSON file of its name that says how it was made.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.learned.shape import Weights

SHIPPED = Path(__file__).parent / "shipped"
LARGEST = 1 << 30
"""Bytes of arrays that a file may hold."""


def shipped(name: str) -> Path | None:
    """The file of weights that the package brings along for a method; None if it brings none."""
    path = SHIPPED / f"{name}.npz"
    return path if path.is_file() else None


def read_arrays(path: Path, *, exact: bool = False) -> Weights:
    """All arrays of an NPZ file, as float32; with `exact`, in the type that they have.

    Raises
    ------
    LightFieldError
        If the file cannot be read, is cut off, is no NPZ (a pickle, such as torch writes, is not opened), or
        holds anything but numbers.
    """
    remedy = "give an NPZ that lfdepth train or lfdepth weights import wrote"
    try:
        with zipfile.ZipFile(path) as file:
            members = file.infolist()
        size = sum(member.file_size for member in members)
        if any(not member.filename.endswith(".npy") for member in members) or size > LARGEST:
            found = "a zip of something else" if size <= LARGEST else f"{size} bytes of arrays"
            raise LightFieldError(f"{path}: found {found}, expected weights; {remedy}")
        with np.load(path, allow_pickle=False) as arrays:
            return {name: _numbers(path, name, arrays[name], exact) for name in arrays.files}
    except LightFieldError:
        raise
    except FileNotFoundError:
        raise LightFieldError(f"{path}: found no such file, expected weights; {remedy}") from None
    except zipfile.BadZipFile:
        raise LightFieldError(f"{path}: found no complete NPZ, expected weights; {remedy}") from None
    except (OSError, ValueError, EOFError, zipfile.error, NotImplementedError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise LightFieldError(f"{path}: cannot be read ({reason}), expected weights; {remedy}") from None


def _numbers(path: Path, name: str, array: np.ndarray, exact: bool) -> np.ndarray:
    if array.dtype not in (np.float16, np.float32, np.float64) or not np.isfinite(array).all():
        raise LightFieldError(
            f"{path}: {name} holds {array.dtype} values, not all finite numbers; expected weights; "
            "give another file"
        )
    return array if exact else np.ascontiguousarray(array, np.float32)


def check_arrays(path: Path, found: Weights, expected: Mapping[str, tuple[int, ...]], name: str) -> None:
    """Raise LightFieldError where arrays are not those of an architecture."""
    for key, shape in expected.items():
        if key not in found or found[key].shape != shape:
            held = f"{key} of shape {found[key].shape}" if key in found else f"no {key}"
            raise LightFieldError(
                f"{path}: found {held}, expected shape {shape}: these are not weights of {name}; give "
                "weights of the same architecture"
            )
    more = next((key for key in found if key not in expected), None)
    if more:
        raise LightFieldError(
            f"{path}: found {more}, which {name} does not have; expected the weights of {name}; give weights "
            "of the same architecture"
        )
