"""What a PNG says of itself: a text under the name `lfdepth`, which cannot be parted from the picture."""

from __future__ import annotations

import zlib
from pathlib import Path

from lfdepth.io import signature

_NAME = b"lfdepth"
_MOST_CHUNKS = 1000
_MOST_TEXT = 16 << 20


def with_text(png: bytes, text: str) -> bytes:
    """A PNG with a text (ASCII) right behind its header."""
    content = _NAME + b"\0" + text.encode("ascii")
    chunk = b"tEXt" + content
    header_end = len(signature.PNG) + 12 + int.from_bytes(png[8:12], "big")
    chunk = len(content).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    return png[:header_end] + chunk + png[header_end:]


def text_in(path: Path) -> str | None:
    """The text in front of the pixels of a PNG; None if there is none, or the file is no PNG."""
    with path.open("rb") as file:
        if file.read(len(signature.PNG)) != signature.PNG:
            return None
        for _ in range(_MOST_CHUNKS):
            length, kind = int.from_bytes(file.read(4), "big"), file.read(4)
            if kind in (b"IDAT", b"IEND", b""):
                return None
            if kind == b"tEXt" and length < _MOST_TEXT:
                name, _, text = file.read(length).partition(b"\0")
                if name == _NAME:
                    return text.decode("latin-1")
                file.seek(4, 1)
            else:
                file.seek(length + 4, 1)
    return None
