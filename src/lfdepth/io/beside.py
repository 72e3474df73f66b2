"""Notes beside a file that cannot hold them: two files, of which each says which other one it belongs to.

Two files cannot be replaced in one step. So the notes name the samples that they are about by a checksum, and
while both are replaced they hold the old notes as well: whenever the process ends, one of them fits.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic
from lfdepth.io.limits import read_text
from lfdepth.io.notes import Notes, beside, notes_of, parse_notes, read_notes
from lfdepth.lightfield import LightField

_SAMPLES, _BEFORE, _NOTES = "samples", "before", "notes"
# Of files up to this size every byte counts; of larger ones as many in blocks that are spread over them.
_WHOLE, _BLOCK = 64 << 20, 64 << 10


def checksum(path: Path) -> str:
    """SHA-256 of a file's size and content; of more than 64 MiB, of 1024 blocks of it."""
    size = path.stat().st_size
    digest = hashlib.sha256(str(size).encode())
    count = _WHOLE // _BLOCK
    with path.open("rb") as file:
        for number in range(count if size > _WHOLE else -(-size // _BLOCK)):
            if size > _WHOLE:
                file.seek(number * (size - _BLOCK) // (count - 1))
            digest.update(file.read(_BLOCK))
    return digest.hexdigest()


def write_with_notes(path: Path, lf: LightField, save: Callable[[Path], None]) -> None:
    """Write a file with `save`, and what it cannot hold of a light field as `NAME.json`.

    Raises
    ------
    LightFieldError
        If a file of that name is there and holds something else, such as the scale of a map.
    """
    file = beside(path)
    if file.exists() and read_notes(file) is None:
        raise LightFieldError(
            f"{file}: already holds something else, but is needed for what {path.name} cannot hold; choose "
            "another name"
        )
    old = read_text(file) if file.exists() else None
    known = json.loads(notes_of(lf).text())
    with atomic(path) as temporary:
        save(temporary)
        known[_SAMPLES] = checksum(temporary)
        before = {_SAMPLES: checksum(path) if path.is_file() else None, _NOTES: _fitting(path, old)}
        try:
            _write(file, {**known, _BEFORE: before})
        except BaseException:
            _restore(file, old)
            raise
    _write(file, known)


def notes_beside(path: Path) -> Notes | None:
    """The notes beside a file; None if there are none, or the JSON there is about something else.

    Raises
    ------
    LightFieldError
        If they are garbled, or describe other samples than those in the file.
    """
    file = beside(path)
    notes = read_notes(file)
    if notes is None:
        return None
    text = read_text(file)
    if _SAMPLES not in json.loads(text):
        return notes
    fitting = _fitting(path, text)
    if fitting is None and not _known_before(path, text):
        raise LightFieldError(
            f"{file}: describes other samples than those in {path.name}; expected the notes that were "
            "written with it; write the light field again, or remove the notes"
        )
    return None if fitting is None else parse_notes(fitting, str(file))


def _fitting(path: Path, text: str | None) -> str | None:
    """Of the notes in a text, the new ones and those before, the ones that are about a file's samples."""
    if text is None or not path.is_file():
        return None
    known = json.loads(text)
    if known.get(_SAMPLES) in (None, checksum(path)):
        return text
    return known[_BEFORE][_NOTES] if _known_before(path, text) else None


def _known_before(path: Path, text: str) -> bool:
    """Whether a file has the samples that were there before the notes."""
    before = json.loads(text).get(_BEFORE)
    return isinstance(before, dict) and before.get(_SAMPLES) == checksum(path)


def _write(file: Path, known: dict[str, Any]) -> None:
    with atomic(file) as temporary:
        temporary.write_text(json.dumps(known, indent=2) + "\n", encoding="utf-8")


def _restore(file: Path, text: str | None) -> None:
    with suppress(OSError, LightFieldError):
        if text is None:
            file.unlink(missing_ok=True)
        elif read_text(file) != text:
            with atomic(file) as temporary:
                temporary.write_text(text, encoding="utf-8")
