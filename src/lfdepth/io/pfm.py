"""Portable float maps: grey, 32-bit, rows from the bottom up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic
from lfdepth.io.record import Record

# Four header lines of a few dozen bytes; more means that the file is something else.
_MAX_HEADER = 256


def read_pfm(path: Path) -> npt.NDArray[np.float32]:
    """Read a grey PFM file.

    Returns
    -------
    ndarray, shape (H, W)
        float32, top row first, native byte order. The header's scale gives the byte order by its sign
        (negative: little-endian); its size is ignored, as by other readers of disparity maps.

    Raises
    ------
    LightFieldError
        If the file is missing, no grey PFM, or shorter or longer than its header says.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LightFieldError(f"{path}: {error.strerror}; expected a PFM file; check the path") from None
    width, height, little_endian, offset = _parse_header(path, data)
    expected = offset + 4 * width * height
    if len(data) != expected:
        raise LightFieldError(
            f"{path}: {len(data)} bytes; expected {expected} for {width}x{height} px; the file is "
            f"{'truncated' if len(data) < expected else 'damaged'}: copy it again"
        )
    rows = np.frombuffer(data, dtype="<f4" if little_endian else ">f4", offset=offset)
    return np.ascontiguousarray(rows.reshape(height, width)[::-1], dtype=np.float32)


def write_pfm(path: Path, record: Record) -> None:
    """Write the map as little-endian grey PFM."""
    height, width = record.values.shape
    with atomic(path) as temporary, temporary.open("wb") as file:
        file.write(f"Pf\n{width} {height}\n-1\n".encode())
        file.write(np.ascontiguousarray(record.values[::-1], dtype="<f4").data)


def _parse_header(path: Path, data: bytes) -> tuple[int, int, bool, int]:
    fields = data[:_MAX_HEADER].split(maxsplit=4)
    try:
        magic, width, height, scale = fields[0], int(fields[1]), int(fields[2]), float(fields[3])
    except (IndexError, ValueError):
        magic, width, height, scale = b"", 0, 0, 0.0
    if magic != b"Pf" or width <= 0 or height <= 0 or not abs(scale) > 0:
        found = "colour PFM" if magic == b"PF" else "no valid PFM header"
        raise LightFieldError(f"{path}: {found}; expected a grey PFM (Pf); convert the map")
    # Exactly one white-space byte ends the header; the pixels behind it may look like white space.
    offset = 0
    for part in fields[:4]:
        offset = data.index(part, offset) + len(part)
    return width, height, scale < 0, offset + 1
