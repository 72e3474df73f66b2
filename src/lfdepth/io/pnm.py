"""PGM and PPM pictures, plain and raw, 8 and 16 bits (the formats of Netpbm)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import limits

SIGNATURES = (b"P2", b"P3", b"P5", b"P6")

# Magic number, width, height and the largest sample, with white space and comments between them; exactly one
# white-space byte follows.
_BETWEEN = rb"(?:\s|#[^\n]*\n)+"
_HEADER = re.compile(rb"P([2356])" + _BETWEEN + _BETWEEN.join([rb"(\d+)"] * 3) + rb"\s")
# Comments may be long, but a header of more bytes is something else.
_MOST_HEADER = 1 << 16


def read_pnm(path: Path) -> npt.NDArray[Any]:
    """Read a PGM or PPM picture.

    Returns
    -------
    ndarray, shape (H, W) or (H, W, 3)
        Samples as stored: uint8 where the largest one that the header allows is below 256, else uint16.

    Raises
    ------
    LightFieldError
        If the header is damaged, or there are fewer samples than it says.
    """
    data = path.read_bytes()
    plain, channels, width, height, white, start = _header(path, data)
    count = width * height * channels
    kind = np.dtype(np.uint8 if white < 256 else ">u2")
    limits.check_unpacked(path, (count,), kind.itemsize)
    if plain:
        words = re.sub(rb"#[^\n]*", b"", data[start:]).split()
        samples = np.array(words[:count], dtype=np.int64)
    else:
        samples = np.frombuffer(data, kind, min(count, (len(data) - start) // kind.itemsize), start)
    if len(samples) < count:
        raise LightFieldError(
            f"{path}: {len(samples)} samples; expected {count} for {width}x{height} px; the file is "
            "truncated: "
            "copy it again"
        )
    if samples.size and (samples.min() < 0 or samples.max() > white):
        raise LightFieldError(
            f"{path}: sample {samples.max()}; expected at most {white}, as its header says; copy it again"
        )
    pixels = samples.astype(kind.newbyteorder("=")).reshape(height, width, channels)
    return pixels[..., 0] if channels == 1 else pixels


def read_white(path: Path) -> float:
    """The largest sample, which is white, by the header.

    Raises
    ------
    LightFieldError
        If the header is damaged.
    """
    with path.open("rb") as file:
        return float(_header(path, file.read(_MOST_HEADER))[4])


def _header(path: Path, data: bytes) -> tuple[bool, int, int, int, int, int]:
    """Whether samples are text; channels, width, height, the largest sample; where samples start."""
    found = _HEADER.match(data[:_MOST_HEADER])
    width, height, white = (int(found[i]) for i in (2, 3, 4)) if found else (0, 0, 0)
    if found is None or 0 in (width, height) or not 0 < white < 65536:
        raise LightFieldError(
            f"{path}: damaged header; expected PGM or PPM with a size and a largest sample from 1 to 65535; "
            "copy it again"
        )
    return found[1] in b"23", 3 if found[1] in b"36" else 1, width, height, white, found.end()
