"""Writing that leaves either the whole file or nothing."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from lfdepth.errors import LightFieldError


@contextmanager
def atomic(path: str | Path) -> Iterator[Path]:
    """Yield a temporary file beside `path` that takes its place when the block ends well.

    If the block raises, Ctrl-C included, the temporary file is removed and `path` is as it was.

    Parameters
    ----------
    path : str or Path
        The file to write; its folder has to exist.

    Yields
    ------
    Path
        An empty file in the same folder and with the same ending, to be written by name.

    Raises
    ------
    LightFieldError
        If the folder is missing or not writable, `path` is a folder, or the disk is full.
    """
    path = Path(path)
    temporary = _create(path)
    try:
        yield temporary
        temporary.replace(_target(path))
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


def check_target(path: str | Path) -> None:
    """Raise LightFieldError unless a file can be written at `path`: a check before long work."""
    _create(Path(path)).unlink()


def _create(path: Path) -> Path:
    """Create an empty file beside the target, with the permissions that a new file gets."""
    try:
        target = _target(path)
        if target.is_dir():
            raise LightFieldError(f"{path}: is a folder; expected a file name; add one")
        temporary = target.with_name(f".{target.stem[:100]}-{uuid4().hex[:8]}{target.suffix}")
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as error:
        raise _unwritable(path, error) from error
    return temporary


def _target(path: Path) -> Path:
    """Follow links, so that the file they lead to is replaced and not the link."""
    try:
        return path.resolve()
    except RuntimeError:  # Python < 3.13 reports loops so
        raise LightFieldError(
            f"{path}: loop of symbolic links; expected a file name; choose another"
        ) from None


def _unwritable(path: Path, error: OSError) -> LightFieldError:
    if not path.parent.is_dir():
        return LightFieldError(
            f"{path}: folder {path.parent} does not exist; expected an existing folder; create it"
        )
    reason = error.strerror or str(error)
    return LightFieldError(
        f"{path}: cannot be written ({reason}); expected a writable folder with free space; choose another"
    )
