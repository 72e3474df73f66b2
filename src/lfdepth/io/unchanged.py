"""Files that change while they are read: an error, and never a mixture of old and new without a word."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import walk
from lfdepth.io.notes import beside
from lfdepth.io.picture import ENDINGS

_READ = {*ENDINGS, ".pfm", ".cfg", ".json"}
_MASKS = "masks"


@contextmanager
def unchanged(path: Path) -> Iterator[None]:
    """Raise LightFieldError if files that are read were changed, replaced or removed when the block ends.

    Of a folder these are pictures, maps and texts in it and in its folder of masks; or all of a Zarr store.
    """
    before = _state(path)
    yield
    after = _state(path)
    if changed := [name for name, state in before.items() if after.get(name) != state]:
        raise LightFieldError(
            f"{changed[0]}: changed while it was being read; expected it to stay unchanged; read it again"
        )


def _state(path: Path) -> dict[str, tuple[int, ...]]:
    """Identity, size and time of change of every file by its name."""
    found: dict[str, tuple[int, ...]] = {}
    for file in _files(path):
        with suppress(OSError):
            status = Path(file).stat()
            found[file] = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)
    return found


def _files(path: Path) -> Iterator[str]:
    if not path.is_dir():
        yield from (str(path), str(beside(path)))
        return
    if any((path / name).exists() for name in ("zarr.json", ".zarray", ".zgroup")):
        yield from (entry.path for entry in walk(path) if not entry.is_dir(follow_symlinks=False))
        return
    for folder in (path, path / _MASKS):
        if folder.is_dir():
            with os.scandir(folder) as entries:
                yield from sorted(entry.path for entry in entries if Path(entry.name).suffix.lower() in _READ)
