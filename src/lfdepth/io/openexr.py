"""Reading OpenEXR files, after https://openexr.com/en/latest/OpenEXRFileLayout.html.

The OpenEXR library prints to standard output on damaged files, and may not come back from them.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import limits

_MAGIC = 20000630
_TYPES: dict[int, np.dtype[Any]] = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}
# Compressions that are read, by their number: how many rows a chunk has.
_ROWS = {0: 1, 1: 1, 2: 1, 3: 16}
_NAMES = ("none", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
# Flags in the version field: tiles, long names, deep data, several parts. Long names change nothing here.
_OTHER_KINDS = 0x200 | 0x800 | 0x1000
_MOST_CHANNELS = 1024


@dataclass(frozen=True)
class _Header:
    """What the header says of the pixels.

    Attributes
    ----------
    channels
        Names and types, in the order in which they are stored.
    width, height, top
        The data window: its size, px, and its first row.
    compression
        Its number.
    end
        Where the table of chunks starts.
    """

    channels: tuple[tuple[str, np.dtype[Any]], ...]
    width: int
    height: int
    top: int
    compression: int
    end: int


def read_channels(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Read all channels by name.

    Returns
    -------
    dict of str to ndarray
        (H, W) in the type that is stored: float32, float16 or uint32.

    Raises
    ------
    LightFieldError
        If the file is damaged, or has tiles, several parts, subsampled channels, or another compression than
        none, RLE, ZIPS and ZIP.
    """
    with limits.readable(path):
        data = path.read_bytes()
        return _read_pixels(data, _read_header(path, data))


def _read_header(path: Path, data: bytes) -> _Header:
    magic, version = struct.unpack_from("<iI", data)
    if magic != _MAGIC:
        raise ValueError("not an OpenEXR file")
    if version & _OTHER_KINDS or version & 0xFF != 2:
        raise _unsupported(path, "tiles, several parts or deep pixels")
    attributes, end = _attributes(data, 8)
    compression = attributes["compression"][0]
    if compression not in _ROWS:
        name = _NAMES[compression] if compression < len(_NAMES) else f"number {compression}"
        raise _unsupported(path, f"compression {name}")
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
    if right < left or bottom < top:
        raise ValueError(f"a data window of {right - left + 1}x{bottom - top + 1} px")
    channels = tuple(_channels(path, attributes["channels"]))
    size = bottom - top + 1, right - left + 1
    limits.check_unpacked(path, size, sum(kind.itemsize for _, kind in channels))
    return _Header(channels, size[1], size[0], top, compression, end)


def _attributes(data: bytes, start: int) -> tuple[dict[str, bytes], int]:
    """Attributes by name, and where the header ends."""
    found = {}
    while data[start]:
        name, start = _text(data, start)
        _, start = _text(data, start)
        size = struct.unpack_from("<i", data, start)[0]
        if not 0 <= size <= len(data) - start - 4:
            raise ValueError(f"attribute {name[:40]} of {size} bytes")
        found[name] = data[start + 4 : start + 4 + size]
        start += 4 + size
    return found, start + 1


def _channels(path: Path, data: bytes) -> Iterator[tuple[str, np.dtype[Any]]]:
    start = 0
    for _ in range(_MOST_CHANNELS):
        if not data[start]:
            return
        name, start = _text(data, start)
        kind, _, across, down = struct.unpack_from("<iIii", data, start)
        if (across, down) != (1, 1):
            raise _unsupported(path, "subsampled channels")
        yield name, _TYPES[kind]
        start += 16
    raise ValueError(f"more than {_MOST_CHANNELS} channels")


def _text(data: bytes, start: int) -> tuple[str, int]:
    end = data.index(0, start)
    return data[start:end].decode("utf-8", "replace"), end + 1


def _read_pixels(data: bytes, header: _Header) -> dict[str, npt.NDArray[Any]]:
    found = {name: np.empty((header.height, header.width), kind) for name, kind in header.channels}
    row_bytes = header.width * sum(kind.itemsize for _, kind in header.channels)
    rows = _ROWS[header.compression]
    count = -(-header.height // rows)
    for number, at in enumerate(struct.unpack_from(f"<{count}Q", data, header.end)):
        first, size = struct.unpack_from("<ii", data, at)
        if first - header.top != number * rows or not 0 <= size <= len(data) - at - 8:
            raise ValueError(f"chunk {number} is damaged")
        last = min((number + 1) * rows, header.height)
        expected = (last - number * rows) * row_bytes
        chunk = _unpacked(data[at + 8 : at + 8 + size], header.compression, expected)
        if len(chunk) != expected:
            raise ValueError(f"chunk {number} has {len(chunk)} bytes, expected {expected}")
        start = 0
        for row in range(number * rows, last):
            for name, kind in header.channels:
                found[name][row] = np.frombuffer(chunk, kind, header.width, start)
                start += header.width * kind.itemsize
    return found


def _unpacked(chunk: bytes, compression: int, expected: int) -> bytes:
    """A chunk of pixels; one that packing would not have made smaller is stored as it is."""
    if compression == 0 or len(chunk) == expected:
        return chunk
    if compression == 1:
        packed = _run_lengths(chunk, expected)
    else:
        packed = zlib.decompressobj().decompress(chunk, expected + 1)
    # Bytes are stored as differences, those at even places first.
    steps = np.frombuffer(packed, np.uint8).astype(np.uint8)
    steps[1:] -= np.uint8(128)
    values = np.cumsum(steps, dtype=np.uint8)
    half = (len(values) + 1) // 2
    woven = np.empty_like(values)
    woven[::2], woven[1::2] = values[:half], values[half:]
    return woven.tobytes()


def _run_lengths(chunk: bytes, most: int) -> bytes:
    """Unpack runs: a count below 0 and that many bytes, or another and a byte to repeat count + 1 times."""
    found, start = bytearray(), 0
    while start < len(chunk) and len(found) <= most:
        count = chunk[start] - 256 if chunk[start] > 127 else chunk[start]
        if count < 0:
            found += chunk[start + 1 : start + 1 - count]
            start += 1 - count
        else:
            found += chunk[start + 1 : start + 2] * (count + 1)
            start += 2
    return bytes(found)


def _unsupported(path: Path, what: str) -> LightFieldError:
    return LightFieldError(
        f"{path}: OpenEXR with {what}; expected rows of one part, compressed by none, RLE, ZIPS or ZIP; "
        "convert it (oiiotool IN --compression zip -o OUT)"
    )
