"""NumPy's own files: NPY with the map alone, NPZ with all that is known of it."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic
from lfdepth.io.record import Record


def write_npy(path: Path, record: Record) -> None:
    """Write the map, float32 (H, W)."""
    with atomic(path) as temporary:
        np.save(temporary, record.values)


def write_npz(path: Path, record: Record) -> None:
    """Write the map under its quantity's name, beside confidence, range, runtime and parameters if known."""
    known = {
        "confidence": record.confidence,
        "range": record.range,
        "runtime": record.runtime,
        "parameters": record.parameters,
    }
    arrays = {key: np.asarray(value) for key, value in known.items() if value is not None}
    arrays[record.quantity] = record.values
    with atomic(path) as temporary:
        np.savez(temporary, allow_pickle=False, **arrays)


def read_npy(path: Path) -> npt.NDArray[Any]:
    """Read the array of an NPY file.

    Raises
    ------
    LightFieldError
        If the file is missing, truncated, no NPY file, or holds Python objects.
    """
    try:
        return np.asarray(np.load(path, allow_pickle=False))
    except (OSError, ValueError, EOFError) as error:
        raise _unreadable(path, "NPY", error) from None


def read_npz(path: Path) -> npt.NDArray[Any]:
    """Read the array `disparity` of an NPZ file.

    Raises
    ------
    LightFieldError
        If the file is missing, truncated, no NPZ file, or holds no such array.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise LightFieldError(f"{path}: a single array; expected an NPZ archive; name it .npy")
            if "disparity" not in archive:
                raise LightFieldError(
                    f"{path}: holds {', '.join(archive.files) or 'nothing'}; expected an array 'disparity'; "
                    "save it under that name"
                )
            return np.asarray(archive["disparity"])
    except LightFieldError:
        raise
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise _unreadable(path, "NPZ", error) from None


def _unreadable(path: Path, kind: str, error: Exception) -> LightFieldError:
    reason = " ".join(str(error).split())[:100]
    return LightFieldError(f"{path}: not readable ({reason}); expected a complete {kind} file; copy it again")
