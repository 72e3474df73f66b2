"""How far files are trusted, which may come from anybody: what memory they may ask for, and where they lead.

Every reader asks here before it unpacks or opens anything, so that a small file cannot fill the memory, and a
folder cannot make its reader open files outside of it.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path

from lfdepth.errors import LightFieldError

MAX_BYTES = 8 << 30
"""Largest array that is unpacked as a whole; a larger one is a bomb or a mistake."""

FREE_BYTES = 256 << 20
"""Arrays up to this size may be packed as well as anybody likes."""

MAX_VIEWS = 1 << 20
"""Most views of a grid, there or absent."""

MAX_RATIO = 200
"""How many times the bytes stored of it a larger array may have. Those of scenes have less than 10 times."""

MOST_TEXT = 16 << 20
"""Bytes that notes take at most; those of 1000×1000 views take 4 MB."""


def check_unpacked(
    path: Path, shape: Iterable[int], itemsize: int, *, stored: int | None = None, whole: bool = True
) -> None:
    """Raise LightFieldError if an array asks for more memory than it may.

    Parameters
    ----------
    path : Path
        The file, for the message.
    shape : iterable of int
        Lengths that the file states.
    itemsize : int
        Bytes of a sample.
    stored : int, optional
        Bytes that the file stores of the array; those of the whole file by default.
    whole : bool
        The array is unpacked as a whole, and not the parts of it that are asked for.
    """
    size = prod(map(int, shape)) * itemsize
    if whole and size > MAX_BYTES:
        raise LightFieldError(
            f"{path}: unpacks to {_amount(size)}; expected at most {_amount(MAX_BYTES)}; "
            "store the array uncompressed, as NPY"
        )
    packed = path.stat().st_size if stored is None else stored
    if size > FREE_BYTES and size > MAX_RATIO * packed:
        raise LightFieldError(
            f"{path}: unpacks to {_amount(size)} from {_amount(packed)}; expected at most {MAX_RATIO} times "
            "what is stored, since more suggests a damaged or malicious file; copy it again, or store the "
            "array uncompressed, as NPY"
        )


def check_grid(path: Path, grid: tuple[int, int]) -> None:
    """Raise LightFieldError if a grid of views is larger than any that there is."""
    if grid[0] * grid[1] > MAX_VIEWS:
        raise LightFieldError(
            f"{path}: a grid of {grid[1]}x{grid[0]} views; expected at most {MAX_VIEWS}; renumber the views"
        )


def read_text(path: Path, most: int = MOST_TEXT) -> str:
    """The text of a small file, UTF-8.

    Raises
    ------
    OSError, UnicodeDecodeError
        As `Path.read_text`; OSError also for what is no regular file, or too long.
    """
    if path.exists() and not path.is_file():
        raise OSError(f"not a regular file: {path.name}")
    if path.stat().st_size > most:
        raise OSError(f"more than {_amount(most)} of text")
    return path.read_bytes().decode("utf-8")


@contextmanager
def readable(what: Path | str) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file into one line."""
    try:
        yield
    except (LightFieldError, MemoryError):
        raise
    except Exception as error:  # libraries let errors of many kinds through
        raise unreadable(what, error) from error


def unreadable(what: Path | str, error: Exception) -> LightFieldError:
    """The error for a file that a library gave up on."""
    reason = " ".join(str(error).split())[:100] or type(error).__name__
    return LightFieldError(f"{what}: not readable ({reason}); expected a complete file; copy it again")


def check_file(path: Path) -> None:
    """Raise LightFieldError for pipes and devices, which may have no end."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise LightFieldError(f"{path}: is a device or a pipe; expected a file; copy its content into one")


def check_inside(folder: Path, files: Iterable[Path]) -> None:
    """Raise LightFieldError for links that lead out of a folder, and for pipes and devices in it.

    The folder itself may be a link. What a link leads to would be read as if it had come with the folder.
    """
    home = None
    for file in files:
        if file.is_symlink():
            home = home or os.path.realpath(folder)
            if not Path(os.path.realpath(file)).is_relative_to(home):
                raise LightFieldError(
                    f"{file}: is a link out of its folder; expected a file in it; if you trust it, copy the "
                    "folder with the files it links to (cp -rL)"
                )
        check_file(file)


def _amount(size: int) -> str:
    return f"{size / 2**30:.1f} GiB" if size >= 2**30 else f"{size / 2**20:.1f} MiB"
