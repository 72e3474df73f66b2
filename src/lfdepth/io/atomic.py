"""Writing that leaves either the whole file or nothing."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
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


@contextmanager
def atomic_folder(path: str | Path, replaceable: Callable[[Path], bool]) -> Iterator[Path]:
    """Like `atomic` for formats that are folders; yields an empty one.

    An existing folder gives way only if `replaceable` says that it holds the same kind of thing.
    """
    path = Path(path)
    temporary = _create(path, folder=True, replaceable=replaceable)
    old = temporary.with_suffix(".old")
    try:
        yield temporary
        target = _target(path)
        if target.exists():
            target.rename(old)
        temporary.rename(target)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)


def check_target(path: str | Path, replaceable: Callable[[Path], bool] | None = None) -> None:
    """Raise LightFieldError unless `path` can be written: a check before long work.

    With `replaceable` the target is a folder, and an existing one gives way only if that says so.
    """
    if replaceable is None:
        _create(Path(path)).unlink()
    else:
        _create(Path(path), folder=True, replaceable=replaceable).rmdir()


def _create(path: Path, *, folder: bool = False, replaceable: Callable[[Path], bool] | None = None) -> Path:
    """Create an empty file or folder beside the target, with the permissions that a new one gets."""
    try:
        target = _target(path)
        if target.is_dir() and not (replaceable and replaceable(target)):
            if folder:
                raise LightFieldError(
                    f"{path}: is a folder that holds something else; expected a new name; choose another"
                )
            raise LightFieldError(f"{path}: is a folder; expected a file name; add one")
        if folder and target.is_file():
            raise LightFieldError(
                f"{path}: is a file; expected to write a folder; remove it or choose another"
            )
        if path.exists() and not (target.is_file() or target.is_dir()):
            raise LightFieldError(
                f"{path}: is a device or a pipe; expected a file that can be replaced; choose another"
            )
        temporary = target.with_name(f".{target.stem[:100]}-{uuid4().hex[:8]}{target.suffix}")
        if folder:
            temporary.mkdir()
        else:
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


def make_folder(folder: Path) -> Path:
    """Make a folder and those above it; LightFieldError where that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LightFieldError(
            f"{folder}: cannot be made ({error.strerror}); expected a writable folder; choose another"
        ) from None
    return folder
