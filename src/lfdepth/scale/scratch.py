"""Maps of many views while they are worked on: in memory, or in files that no name leads to.

What is read and written row by row takes no memory. Where something has to be looked at all over, its file is
mapped into memory, and the pages that were looked at are given back from time to time.
"""

from __future__ import annotations

import mmap
import tempfile
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import numpy as np
from numpy.typing import DTypeLike, NDArray


class Scratch:
    """Room for maps, until the context is left.

    Parameters
    ----------
    folder
        Where files are put; None: everything is kept in memory. Files have no name where the system has such
        (Linux, macOS), and elsewhere go when they are closed: nothing of them stays, however a process ends.

    Raises
    ------
    OSError
        From all that writes: if the disk is full, or the folder cannot be written.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._open = ExitStack()

    @property
    def in_files(self) -> bool:
        """Whether maps are kept in files."""
        return self._folder is not None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def maps(self, shape: tuple[int, int, int], dtype: DTypeLike) -> Maps:
        """Maps (N, H, W) that are not set yet."""
        maps = _Held(shape, dtype) if self._folder is None else _Filed(shape, dtype, self._file())
        self._open.callback(maps.close)
        return maps

    def lists(self) -> Lists:
        """Lists that are kept one after the other."""
        return Lists(None if self._folder is None else self._file())

    def _file(self) -> IO[bytes]:
        return self._open.enter_context(tempfile.TemporaryFile(dir=self._folder, prefix=".lfdepth-"))


class Maps:
    """Maps (N, H, W): rows of one of them are written and read, and all of them looked at."""

    def put(self, index: int, rows: NDArray[Any], first: int = 0) -> None:
        """Write rows of a map, from `first` on."""
        raise NotImplementedError

    def get(self, index: int, first: int = 0, last: int | None = None) -> NDArray[Any]:
        """Rows of a map; what is changed in them counts when they are put back."""
        raise NotImplementedError

    def whole(self) -> NDArray[Any]:
        """All of them, to be looked at until something is put, or they are closed."""
        raise NotImplementedError

    def let_go(self) -> None:
        """Give back the memory of what was looked at, which may go on."""

    def close(self) -> None:
        """Forget the maps."""
        raise NotImplementedError


class _Held(Maps):
    """In memory."""

    def __init__(self, shape: tuple[int, int, int], dtype: DTypeLike) -> None:
        self._array: NDArray[Any] = np.empty(shape, dtype)

    def put(self, index: int, rows: NDArray[Any], first: int = 0) -> None:
        self._array[index, first : first + len(rows)] = rows

    def get(self, index: int, first: int = 0, last: int | None = None) -> NDArray[Any]:
        return self._array[index, first:last]

    def whole(self) -> NDArray[Any]:
        return self._array

    def close(self) -> None:
        self._array = np.empty((0, 0, 0), self._array.dtype)


class _Filed(Maps):
    """In a file."""

    def __init__(self, shape: tuple[int, int, int], dtype: DTypeLike, file: IO[bytes]) -> None:
        self._shape, self._dtype, self._file = shape, np.dtype(dtype), file
        self._mapped: mmap.mmap | None = None
        file.truncate(shape[0] * shape[1] * self._row)  # absent views are holes, which take no room

    @property
    def _row(self) -> int:
        return self._shape[2] * self._dtype.itemsize

    def put(self, index: int, rows: NDArray[Any], first: int = 0) -> None:
        self._file.seek((index * self._shape[1] + first) * self._row)
        self._file.write(np.ascontiguousarray(rows, self._dtype).data)

    def get(self, index: int, first: int = 0, last: int | None = None) -> NDArray[Any]:
        last = self._shape[1] if last is None else last
        rows = np.empty((last - first, self._shape[2]), self._dtype)
        self._file.seek((index * self._shape[1] + first) * self._row)
        self._file.readinto(rows.data)  # type: ignore[attr-defined]
        return rows

    def whole(self) -> NDArray[Any]:
        self._file.flush()
        # A private copy that nobody writes to takes no memory, and is an array like any other to kernels.
        self._mapped = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_COPY)
        return np.frombuffer(self._mapped, self._dtype).reshape(self._shape)

    def let_go(self) -> None:
        if self._mapped is not None and hasattr(self._mapped, "madvise"):
            self._mapped.madvise(mmap.MADV_DONTNEED)

    def close(self) -> None:
        self._mapped = None
        self._file.close()


class Lists:
    """Arrays of records, each under a number, of which parts are read."""

    def __init__(self, file: IO[bytes] | None) -> None:
        self._file = file
        self._held: dict[int, NDArray[Any]] = {}
        self._places: dict[int, tuple[int, np.dtype[Any]]] = {}
        self._end = 0

    def put(self, number: int, records: NDArray[Any]) -> None:
        """Keep an array (N,) of records."""
        if self._file is None:
            self._held[number] = records
            return
        self._places[number] = self._end, records.dtype
        self._file.seek(self._end)
        self._end += self._file.write(np.ascontiguousarray(records).data)

    def get(self, number: int, first: int, last: int) -> NDArray[Any]:
        """Records [first, last) of an array."""
        if self._file is None:
            return self._held[number][first:last]
        start, dtype = self._places[number]
        records = np.empty(last - first, dtype)
        if not len(records):
            return records
        self._file.seek(start + first * dtype.itemsize)
        self._file.readinto(records.view(np.uint8).data)  # type: ignore[attr-defined]
        return records

    def close(self) -> None:
        """Forget the records."""
        self._held.clear()
        if self._file is not None:
            self._file.close()
