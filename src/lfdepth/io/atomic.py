"""Writing that leaves either the whole file or folder, or what was there before.

What is written goes under a temporary name beside its target, is flushed to the disk, and takes the
target's name in one step. A process that is killed leaves at most that temporary, ``.NAME-xxxxxxxx.ENDING``,
which can be deleted.
"""

from __future__ import annotations

import ctypes
import errno
import json
import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from lfdepth.errors import LightFieldError

MANIFEST = ".lfdepth.json"
"""Name of the list of files by which a folder is known to be ours: see `foreign_entry`."""

_MARK = "written by lfdepth"
_TRIES = 20
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2
# What file systems and kernels answer that cannot swap two names, or flush a folder.
_UNSUPPORTED = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EXDEV, errno.EBADF}


@contextmanager
def atomic(path: str | Path) -> Iterator[Path]:
    """Yield a temporary file beside `path` that takes its place when the block ends well.

    If the block raises, Ctrl-C included, the temporary file is removed and `path` is as it was. After a power
    cut, too, `path` is the old file or the whole new one.

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
        _flush(temporary)
        target = _target(path)
        temporary.replace(target)
        _flush_folder(target.parent)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: str | Path, *, manifest: str = MANIFEST) -> Iterator[Path]:
    """Like `atomic` for formats that are folders; yields an empty one.

    An existing folder gives way only if it is empty, or was written so and holds nothing else
    (`foreign_entry`). That is asked before the work and again when the folders change places.

    Parameters
    ----------
    path : str or Path
        The folder to write; the one that it is in has to exist.
    manifest : str
        Where in the folder the list of its files goes: ``.lfdepth.json``, or that name in a subfolder.
    """
    path = Path(path)
    temporary = _create(path, folder=True)
    try:
        yield temporary
        _write_manifest(temporary, manifest)
        _flush_tree(temporary)
        target = _target(path)
        _place(temporary, target, path)
        _flush_folder(target.parent)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        _remove(temporary)


def check_target(path: str | Path, *, folder: bool = False) -> None:
    """Raise LightFieldError unless `path` can be written, as a file or folder: a check before long work."""
    temporary = _create(Path(path), folder=folder)
    if folder:
        temporary.rmdir()
    else:
        temporary.unlink()


def foreign_entry(folder: Path) -> str | None:
    """The first thing in a folder that `atomic_folder` did not put there; None if there is nothing.

    A file is ours if the folder's manifest lists it with the size that it has. So neither a file that was
    added, nor one that somebody wrote over, is taken for ours; nor are links.
    """
    if not any(folder.iterdir()):
        return None
    manifest = _find_manifest(folder)
    if manifest is None:
        return f"no {MANIFEST}, which lfdepth puts into its folders"
    try:
        known = json.loads(manifest.read_text(encoding="utf-8"))
        listed = {str(name): int(size) for name, size in known[_MARK].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        return manifest.name
    parents = {str(parent) for name in listed for parent in Path(name).parents}
    for entry in walk(folder):
        name = Path(entry.path).relative_to(folder).as_posix()
        if entry.is_dir(follow_symlinks=False):
            ours = name in parents or name == manifest.parent.relative_to(folder).as_posix()
        else:
            ours = entry.is_file(follow_symlinks=False) and (
                Path(entry.path) == manifest or listed.get(name) == entry.stat(follow_symlinks=False).st_size
            )
        if not ours:
            return name
    return None


def _remove(folder: Path) -> None:
    """Remove a folder of ours; again if threads of a library that failed were still writing into it."""
    for _ in range(_TRIES):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            return
        time.sleep(0.02)


def _write_manifest(folder: Path, manifest: str) -> None:
    files = sorted(
        (Path(entry.path).relative_to(folder).as_posix(), entry.stat(follow_symlinks=False).st_size)
        for entry in walk(folder)
        if not entry.is_dir(follow_symlinks=False)
    )
    (folder / manifest).write_text(json.dumps({_MARK: dict(files)}) + "\n", encoding="utf-8")


def _find_manifest(folder: Path) -> Path | None:
    """The manifest of a folder: in it, or, for formats that know what each entry is, one level below."""
    places = (folder / MANIFEST, *sorted(folder.glob(f"*/{MANIFEST}")))
    return next((file for file in places if file.is_file()), None)


def walk(folder: Path) -> Iterator[os.DirEntry[str]]:
    """Everything in a folder and below, folders before what is in them; links are not followed."""
    with os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda entry: entry.name):
            yield entry
            if entry.is_dir(follow_symlinks=False):
                yield from walk(Path(entry.path))


def _place(temporary: Path, target: Path, path: Path) -> None:
    """Give a finished folder its name; what had the name is then at `temporary`, or gone.

    Another process may write to the same name: then the one that comes last wins.
    """
    for _ in range(_TRIES):
        try:
            if not target.exists():
                temporary.rename(target)
                return
            _check_ours(target, path)
            if not _exchange(temporary, target):
                _replace_in_two_steps(temporary, target, path)
                return
            try:
                _check_ours(temporary, path)  # what was put there until the names were swapped
            except LightFieldError:
                _exchange(temporary, target)
                raise
            return
        except OSError as error:
            # Made or taken away by another process between two of the steps above.
            if error.errno not in (errno.ENOENT, errno.EEXIST, errno.ENOTEMPTY) or not temporary.exists():
                raise
    raise OSError(errno.EBUSY, "other processes keep writing there")


def _replace_in_two_steps(temporary: Path, target: Path, path: Path) -> None:
    """Where names cannot be swapped: the old folder is kept until the new one has its place."""
    old = temporary.with_name(f"{temporary.name}.old")
    try:
        target.rename(old)
        temporary.rename(target)
    except BaseException:
        if old.exists() and not _put_back(old, target):  # another process has put its own there
            _check_ours(old, path)
            shutil.rmtree(old, ignore_errors=True)
        raise
    _check_ours(old, path)
    shutil.rmtree(old, ignore_errors=True)


def _put_back(old: Path, target: Path) -> bool:
    """Give a folder its name again; False if the name has been taken."""
    try:
        old.rename(target)
    except OSError as error:
        if error.errno not in (errno.EEXIST, errno.ENOTEMPTY):
            raise
        return False
    return True


def _exchange(first: Path, second: Path) -> bool:
    """Swap the names of two folders in one step; False where the system or the file system cannot."""
    if sys.platform != "linux":
        return False
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if renameat2 is None:
        return False
    if renameat2(_AT_FDCWD, os.fsencode(first), _AT_FDCWD, os.fsencode(second), _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in _UNSUPPORTED:
        return False
    raise OSError(code, os.strerror(code), str(second))


def _check_ours(folder: Path, path: Path) -> None:
    """Raise LightFieldError unless a folder may be replaced; what is not there may be."""
    if folder.is_file():
        raise LightFieldError(f"{path}: is a file; expected to write a folder; remove it or choose another")
    if found := _settled_foreign_entry(folder):
        raise LightFieldError(
            f"{path}: is a folder with other content ({found}); expected an empty one, or one written by "
            "lfdepth and not changed since; choose another"
        )


def _settled_foreign_entry(folder: Path) -> str | None:
    """`foreign_entry` of one folder, and not of two that another process swaps while they are looked at."""
    found = None
    for _ in range(_TRIES):
        try:
            before = folder.stat().st_ino
            found = foreign_entry(folder)
            if found is None or folder.stat().st_ino == before:
                return found
        except FileNotFoundError:
            if not folder.exists():
                return None
    return found


def _create(path: Path, *, folder: bool = False) -> Path:
    """Create an empty file or folder beside the target, with the permissions that a new one gets."""
    try:
        target = _target(path)
        if folder and (target.is_dir() or target.is_file()):
            _check_ours(target, path)
        elif target.is_dir():
            raise LightFieldError(f"{path}: is a folder; expected a file; add a file name")
        elif path.exists() and not target.is_file():
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


def _flush(file: Path) -> None:
    """Wait until a file is on the disk."""
    with file.open("rb+") as opened:
        os.fsync(opened.fileno())


def _flush_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk, where systems offer that."""
    if os.name == "nt":
        return
    try:
        opened = os.open(folder, os.O_RDONLY)
    except PermissionError:  # a folder that may be written but not listed
        return
    try:
        os.fsync(opened)
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise
    finally:
        os.close(opened)


def _flush_tree(folder: Path) -> None:
    for entry in walk(folder):
        if entry.is_dir(follow_symlinks=False):
            _flush_folder(Path(entry.path))
        else:
            _flush(Path(entry.path))
    _flush_folder(folder)


def _target(path: Path) -> Path:
    """Follow links, so that the file they lead to is replaced and not the link."""
    # What resolves to a link is in a loop of links, which Python up to 3.12 reports, and later ones do not.
    with suppress(RuntimeError):
        target = path.resolve()
        if not target.is_symlink():
            return target
    raise LightFieldError(f"{path}: loop of symbolic links; expected a file name; choose another")


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
            f"{folder}: cannot be created ({error.strerror}); expected a writable folder; choose another"
        ) from None
    return folder
