"""How large an array a small file may ask for."""

from __future__ import annotations

from pathlib import Path

from lfdepth.errors import LightFieldError

MAX_BYTES = 8 << 30
"""Largest array that is unpacked from a compressed file; a larger one is a bomb or a mistake."""


def check_unpacked(path: Path, size: int) -> None:
    """Raise LightFieldError if an array unpacks to more than `MAX_BYTES` bytes."""
    if size > MAX_BYTES:
        raise LightFieldError(
            f"{path}: unpacks to {size / 2**30:.1f} GiB; expected at most {MAX_BYTES / 2**30:.1f} GiB; "
            "store the array uncompressed, as NPY"
        )
