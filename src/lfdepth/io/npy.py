"""NumPy's own files, for light fields and for maps: NPY with one array, NPZ with several."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import limits, signature, stack
from lfdepth.io.atomic import atomic
from lfdepth.io.layout import Layout
from lfdepth.io.record import Record
from lfdepth.io.source import ViewSource


def recognise_npy(path: Path) -> bool:
    """True for an NPY file."""
    return signature.starts_with(path, signature.NPY)


def recognise_npz(path: Path) -> bool:
    """True for a ZIP archive that is named as NumPy's."""
    return path.suffix.lower() == ".npz" and signature.starts_with(path, signature.ZIP)


def open_npy(path: Path, layout: Layout) -> ViewSource:
    """Open the array of an NPY file, mapped, so that only the views asked for are read.

    Raises
    ------
    LightFieldError
        If the file is truncated or is no light field.
    """
    with _readable(path):
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    return stack.open_stack(array, path, layout)


def open_npz(path: Path, layout: Layout) -> ViewSource:
    """Open the light field in an NPZ archive.

    Raises
    ------
    LightFieldError
        If the archive is damaged, holds no light field, or unpacks to more than `limits.MAX_BYTES`.
    """
    headers = _read_headers(path)
    name = stack.choose_array({name: shape for name, (shape, _) in headers.items()}, path)
    return stack.open_stack(_read_member(path, name, headers), path, layout)


def read_npy(path: Path) -> npt.NDArray[Any]:
    """Read the array of an NPY file.

    Raises
    ------
    LightFieldError
        If the file is truncated, no NPY file, or holds Python objects.
    """
    with _readable(path):
        return np.asarray(np.load(path, allow_pickle=False))


def read_npz(path: Path, name: str = "disparity") -> npt.NDArray[Any]:
    """Read an array of an NPZ file.

    Raises
    ------
    LightFieldError
        If the file is truncated, no NPZ file, holds no such array, or one larger than `limits.MAX_BYTES`.
    """
    headers = _read_headers(path)
    if name not in headers:
        raise LightFieldError(
            f"{path}: holds {', '.join(headers) or 'nothing'}; expected an array {name!r}; "
            "save it under that name"
        )
    return _read_member(path, name, headers)


def holds(path: Path, name: str) -> bool:
    """Whether an NPZ file has an array of that name.

    Raises
    ------
    LightFieldError
        If the file is truncated or no NPZ file.
    """
    return name in _read_headers(path)


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


def _read_headers(path: Path) -> dict[str, tuple[tuple[int, ...], np.dtype[Any]]]:
    """Shape and sample type of each array in an archive, without unpacking any."""
    headers = {}
    with _readable(path), zipfile.ZipFile(path) as archive:
        for member in archive.namelist():
            if member.endswith(".npy"):
                with archive.open(member) as file:
                    headers[member.removesuffix(".npy")] = _read_header(file)
    return headers


def _read_header(file: Any) -> tuple[tuple[int, ...], np.dtype[Any]]:
    if np.lib.format.read_magic(file) == (1, 0):
        shape, _, dtype = np.lib.format.read_array_header_1_0(file)
    else:
        shape, _, dtype = np.lib.format.read_array_header_2_0(file)
    return shape, dtype


def _read_member(
    path: Path, name: str, headers: dict[str, tuple[tuple[int, ...], np.dtype[Any]]]
) -> npt.NDArray[Any]:
    shape, dtype = headers[name]
    limits.check_unpacked(path, prod(shape) * dtype.itemsize)
    with _readable(path), np.load(path, allow_pickle=False) as archive:
        return np.asarray(archive[name])


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turn what NumPy and zipfile raise on damaged files into one line."""
    try:
        yield
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError) as error:
        raise stack.unreadable(path, error) from None
