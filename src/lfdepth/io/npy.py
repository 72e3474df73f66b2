"""NumPy's own files, for light fields and for maps: NPY with one array, NPZ with several."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from lfdepth.io import limits, signature, stack
from lfdepth.io.atomic import atomic
from lfdepth.io.beside import notes_beside, write_with_notes
from lfdepth.io.layout import Layout
from lfdepth.io.notes import KEY, Bundle
from lfdepth.io.record import Record
from lfdepth.io.source import ViewSource
from lfdepth.lightfield import LightField


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
        If the file is truncated or is no light field, or the notes beside it are garbled or about another.
    """
    with limits.readable(path):
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    notes = notes_beside(path)
    on_disk = _OnDisk(path, array.shape, array.dtype, array.offset) if array.flags.c_contiguous else array
    source = stack.open_stack(on_disk, path, layout, notes=notes)
    return source if notes is None else notes.annotate(source)


def open_npz(path: Path, layout: Layout) -> ViewSource:
    """Open the light field in an NPZ archive; where it is not compressed, only the views asked for are read.

    Raises
    ------
    LightFieldError
        If the archive is damaged, holds no light field, or unpacks to more than `limits.MAX_BYTES`.
    """
    members = _read_members(path)
    text = members[KEY][()] if KEY in members and members[KEY].nbytes < limits.MOST_TEXT else None
    return stack.open_arrays(members, text, path, layout)


def read_npy(path: Path) -> npt.NDArray[Any]:
    """Read the array of an NPY file.

    Raises
    ------
    LightFieldError
        If the file is truncated, no NPY file, or holds Python objects.
    """
    with limits.readable(path):
        return np.array(np.load(path, mmap_mode="r", allow_pickle=False))


def axes_of_npy(path: Path) -> int:
    """How many axes the array of an NPY file has."""
    with limits.readable(path):
        return int(np.load(path, mmap_mode="r", allow_pickle=False).ndim)


def read_npz(path: Path) -> dict[str, Any]:
    """The arrays of an NPZ file, which are read when they are asked for.

    Raises
    ------
    LightFieldError
        If the file is truncated or no NPZ file; when an array is read, also if that is larger than
        `limits.MAX_BYTES`.
    """
    return dict(_read_members(path))


def write_npy(path: Path, record: Record) -> None:
    """Write the map, float32 (H, W)."""
    with atomic(path) as temporary:
        _save(temporary, record.values)


def _save(path: Path, array: npt.NDArray[Any]) -> None:
    """`numpy.save`, but through Python's files.

    NumPy writes to real files through a C stream and does not look at whether closing that succeeds: where
    the disk is full, the last block is missing without an error.
    """
    with path.open("wb") as file:
        np.save(_Writable(file.write), array)


@dataclass(frozen=True)
class _Writable:
    """Nothing but `write`, so that NumPy takes it for no real file."""

    write: Callable[[bytes], int]


def write_npz(path: Path, record: Record) -> None:
    """Write the map under its quantity's name, beside it what else is known of it."""
    known = {
        "confidence": record.confidence,
        "sigma": record.sigma,
        "range": record.range,
        "runtime": record.runtime,
        "parameters": record.parameters,
    }
    arrays = {key: np.asarray(value) for key, value in known.items() if value is not None}
    arrays[record.quantity] = record.values
    with atomic(path) as temporary:
        np.savez(temporary, allow_pickle=False, **arrays)


def write_views_npy(path: Path, lf: LightField) -> None:
    """Write the views (V, U, H, W, C), and beside them what NPY cannot hold, as `NAME.json`."""
    write_with_notes(path, lf, lambda temporary: _save(temporary, lf.views))


def write_views_npz(path: Path, lf: LightField) -> None:
    """Write `LF` (V, U, H, W, C), not compressed; truth, masks and notes as arrays beside it."""
    bundle = Bundle.of(lf)
    with atomic(path) as temporary:
        np.savez(temporary, allow_pickle=False, **{KEY: np.asarray(bundle.text)}, **bundle.arrays)


@dataclass(frozen=True)
class _OnDisk:
    """An array (C order) that lies in a file as it is; parts of it are read when they are asked for.

    Mapped into memory, a file that somebody cuts short while it is read would end the process.
    """

    path: Path
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    offset: int

    def __getitem__(self, index: Any, /) -> Any:
        first = index if isinstance(index, tuple) else (index,)
        fixed = tuple(takewhile(lambda each: isinstance(each, (int, np.integer)), first))
        inner = self.shape[len(fixed) :]
        if not fixed and first != (...,):  # pixels before views: parts are spread over all of the file
            return np.memmap(self.path, self.dtype, "r", self.offset, self.shape)[index]
        place = sum(int(i) * prod(self.shape[axis + 1 :]) for axis, i in enumerate(fixed))
        rest = list(first[len(fixed) :])
        if inner and rest and isinstance(rest[0], slice) and rest[0].step in (None, 1):  # some rows
            start, stop, _ = rest[0].indices(inner[0])
            place += start * prod(inner[1:])
            inner, rest[0] = (max(stop - start, 0), *inner[1:]), slice(None)
        count = prod(inner)
        block = np.fromfile(self.path, self.dtype, count, offset=self.offset + place * self.dtype.itemsize)
        if block.size != count:
            raise ValueError("the file has become shorter")
        return block.reshape(inner)[tuple(rest)]


@dataclass(frozen=True)
class _Member:
    """An array of an archive, read when a part of it is asked for.

    Attributes
    ----------
    path, name
        The archive, and the array's name in it.
    shape, dtype, fortran_order
        From its header.
    stored
        Bytes that the archive stores of it.
    start
        Where the samples start in the archive, if they are not compressed.
    """

    path: Path
    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    fortran_order: bool
    stored: int
    start: int | None

    def __getitem__(self, index: Any, /) -> Any:
        return self._values[index]

    @property
    def nbytes(self) -> int:
        """Bytes that it takes in memory."""
        return prod(self.shape) * self.dtype.itemsize

    @cached_property
    def _values(self) -> Any:
        if self.start is not None and self.shape and 0 not in self.shape and not self.dtype.hasobject:
            if not self.fortran_order:
                return _OnDisk(self.path, self.shape, self.dtype, self.start)
            with limits.readable(self.path):
                return np.memmap(self.path, self.dtype, "r", self.start, self.shape, "F")
        limits.check_unpacked(self.path, self.shape, self.dtype.itemsize, stored=self.stored)
        with (
            limits.readable(self.path),
            zipfile.ZipFile(self.path) as archive,
            archive.open(f"{self.name}.npy") as file,
        ):
            return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


def _read_members(path: Path) -> dict[str, _Member]:
    """The arrays of an archive, without unpacking any."""
    members = {}
    with limits.readable(path), zipfile.ZipFile(path) as archive, path.open("rb") as raw:
        for info in archive.infolist():
            if info.filename.endswith(".npy"):
                name = info.filename.removesuffix(".npy")
                if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise ValueError(f"{name} is packed in a way that NumPy does not use")
                with archive.open(info) as file:
                    shape, fortran_order, dtype = _read_header(file)
                    header = file.tell()
                whole = header + prod(shape) * dtype.itemsize == info.file_size
                stored = whole and info.compress_type == zipfile.ZIP_STORED
                start = _data_start(raw, info) + header if stored else None
                members[name] = _Member(path, name, shape, dtype, fortran_order, info.compress_size, start)
    return members


def _data_start(archive: IO[bytes], info: zipfile.ZipInfo) -> int:
    """Where the bytes of a member start: behind its local header, whose last two fields have any length."""
    archive.seek(info.header_offset + 26)
    name, extra = (int.from_bytes(archive.read(2), "little") for _ in "12")
    return info.header_offset + 30 + name + extra


def _read_header(file: Any) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    if np.lib.format.read_magic(file) == (1, 0):
        return np.lib.format.read_array_header_1_0(file)
    return np.lib.format.read_array_header_2_0(file)
