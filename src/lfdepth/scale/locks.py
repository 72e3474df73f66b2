"""Locks on folders, by which processes that write to the same place share the work or take turns.

A lock ends with the process that holds it, however that ends. Where the system or the file system knows no
locks, there are none: then two processes may do the same work, and the last one's files stay.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import make_folder

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

LOCKS = ".lfdepth-locks"
_WHOLE = "whole"


@contextmanager
def alone(folder: Path, name: str) -> Iterator[None]:
    """Wait until no other process has the lock of this name in a folder, and hold it."""
    with _open(folder, name) as file:
        _locked(file)
        yield


@contextmanager
def only(folder: Path) -> Iterator[None]:
    """Hold a folder, so that no other process works there.

    Raises
    ------
    LightFieldError
        If another one does.
    """
    with _open(folder, _WHOLE) as file:
        if not _locked(file, wait=False):
            raise LightFieldError(
                f"{folder}: another process is writing there; expected one at a time; wait until it is "
                "done, or choose another folder"
            )
        yield


class Shared:
    """A folder in which several processes work on the same thing; the last one to be done removes it.

    Parameters
    ----------
    folder
        Made if it is missing.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._file = self._joined()

    def __enter__(self) -> Shared:
        return self

    def __exit__(self, *error: object) -> None:
        self._file.close()

    def _joined(self) -> IO[str]:
        """The lock of the folder, held together with others that work there."""
        while True:
            with suppress(FileNotFoundError):  # removed by one that was done: it will be made again
                file = _open(self.folder, _WHOLE)
                _locked(file, shared=True)
                if fcntl is None or _is_at(file, _path(self.folder, _WHOLE)):
                    return file
                file.close()

    def finish(self) -> None:
        """Remove the folder, unless others are at work in it."""
        if not _locked(self._file, wait=False):
            return
        if fcntl is None:
            self._file.close()
        shutil.rmtree(self.folder, ignore_errors=True)


def _path(folder: Path, name: str) -> Path:
    return folder / LOCKS / f"{name}.lock"


def _open(folder: Path, name: str) -> IO[str]:
    make_folder(folder / LOCKS)
    return _path(folder, name).open("a", encoding="utf-8")


def _locked(file: IO[str], *, shared: bool = False, wait: bool = True) -> bool:
    """Lock a file, with others or alone; False where another process has it and nobody waits."""
    if fcntl is not None:
        how = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        try:
            fcntl.flock(file, how if wait else how | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # a file system without locks
            pass
    return True


def _is_at(file: IO[str], path: Path) -> bool:
    """Whether an open file is still what its path leads to."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    return False
