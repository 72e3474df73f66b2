"""Checks of MATLAB 5 files before SciPy reads them, which takes lengths and types in them on trust.

The format is that of "MAT-File Format" (The MathWorks): a header of 128 bytes, then elements, each a tag with
type and length, then data. Variables are matrices, whose parts are elements; they may be compressed.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, cast

import numpy as np

from lfdepth.io import limits

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
# Bytes of a value by the type of an element: whole and real numbers, and text.
_SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 16: 1, 17: 2, 18: 4}
# Bytes of a value by the class of a matrix: double to uint64.
_NUMBERS = {6: 8, 7: 4, 8: 1, 9: 1, 10: 2, 11: 2, 12: 4, 13: 4, 14: 8, 15: 8}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_COMPLEX = 0x800
_MOST_AXES, _MOST_NESTING = 32, 32


def check_mat5(path: Path) -> None:
    """Raise ValueError where a length or type in a file cannot be true, LightFieldError for a bomb.

    Raises
    ------
    ValueError, struct.error, zlib.error, OSError
        If the file is damaged.
    LightFieldError
        If an array asks for more memory than it may (`limits.check_unpacked`).
    """
    size = path.stat().st_size
    if size <= _HEADER:
        return
    data = memoryview(cast(Any, np.memmap(path, np.uint8, "r")))
    order = {b"IM": "<", b"MI": ">"}.get(bytes(data[126:128]))
    if order is None:
        raise ValueError("no byte order in the header")
    start = _HEADER
    while start + 8 <= size:
        kind, length = struct.unpack_from(f"{order}II", data, start)
        start += 8
        if length > size - start:
            raise ValueError(f"an element of {length} bytes, with {size - start} left")
        element = data[start : start + length]
        if kind == _COMPRESSED:
            element = _unpacked(path, element, order)
        elif kind != _MATRIX:
            raise ValueError(f"an element of type {kind} among the variables")
        _Matrix(path, element, order).check()
        start += length


def _unpacked(path: Path, packed: memoryview, order: str) -> memoryview:
    """The content of a compressed matrix, as much of it as its tag says."""
    unpacking = zlib.decompressobj()
    kind, length = struct.unpack(f"{order}II", unpacking.decompress(packed, 8))
    if kind != _MATRIX:
        raise ValueError(f"a compressed element of type {kind}")
    limits.check_unpacked(path, (length,), 1, stored=len(packed))
    content = unpacking.decompress(unpacking.unconsumed_tail, length) if length else b""
    if len(content) != length:
        raise ValueError(f"a compressed element of {len(content)} bytes, of {length} stated")
    return memoryview(content)


@dataclass
class _Matrix:
    """A matrix, of which `start` bytes were looked at."""

    path: Path
    data: memoryview
    order: str
    nesting: int = 0
    start: int = 0

    def check(self) -> None:
        if not len(self.data):  # an empty matrix
            return
        if self.nesting > _MOST_NESTING:
            raise ValueError(f"more than {_MOST_NESTING} levels of cells and structs")
        flags = struct.unpack_from(f"{self.order}I", self._element(6))[0]
        kind, count = flags & 0xFF, 2 if flags & _COMPLEX else 1
        if kind == _OPAQUE:
            self._check_rest()
            return
        shape = self._shape()
        self._element(1, 2, 16)  # the name
        if kind in _NUMBERS:
            for _ in range(count):
                self._check_numbers(prod(shape), _NUMBERS[kind])
        elif kind == _CHAR:
            limits.check_unpacked(self.path, shape, 4)
            self._element(*_SIZES)
        elif kind == _SPARSE:
            for _ in range(2 + count):
                self._element(*_SIZES)
        elif kind in (_STRUCT, _OBJECT):
            if kind == _OBJECT:
                self._element(1, 2, 16)
            self._check_matrices(prod(shape) * self._fields())
        elif kind in (_CELL, _FUNCTION):
            self._check_matrices(prod(shape) if kind == _CELL else 1)
        else:
            raise ValueError(f"a matrix of class {kind}")

    def _shape(self) -> tuple[int, ...]:
        element = self._element(5, 6)
        if not 8 <= len(element) <= 4 * _MOST_AXES or len(element) % 4:
            raise ValueError(f"a matrix with {len(element)} bytes of lengths")
        shape = struct.unpack(f"{self.order}{len(element) // 4}i", element)
        if min(shape) < 0:
            raise ValueError(f"a matrix of shape {shape}")
        return shape

    def _fields(self) -> int:
        length = self._element(5, 6)
        if len(length) != 4:
            raise ValueError("a struct without a length of its names")
        most: int = struct.unpack(f"{self.order}i", length)[0]
        names = self._element(1, 2, 16)
        if most <= 0 or len(names) % most:
            raise ValueError(f"a struct with {len(names)} bytes of names of {most}")
        return len(names) // most

    def _check_numbers(self, count: int, itemsize: int) -> None:
        limits.check_unpacked(self.path, (count,), itemsize)
        kind, element = self._tagged()
        if kind not in _SIZES or len(element) != count * _SIZES[kind]:
            raise ValueError(f"{len(element)} bytes of type {kind} for {count} values")

    def _check_matrices(self, count: int) -> None:
        if count > (len(self.data) - self.start) // 8:
            raise ValueError(f"{count} matrices in {len(self.data) - self.start} bytes")
        for _ in range(count):
            kind, element = self._tagged()
            if kind != _MATRIX:
                raise ValueError(f"an element of type {kind} for a matrix")
            _Matrix(self.path, element, self.order, self.nesting + 1).check()

    def _check_rest(self) -> None:
        while self.start < len(self.data):
            kind, element = self._tagged()
            if kind == _MATRIX:
                _Matrix(self.path, element, self.order, self.nesting + 1).check()
            elif kind not in _SIZES:
                raise ValueError(f"an element of type {kind}")

    def _element(self, *kinds: int) -> memoryview:
        kind, element = self._tagged()
        if kind not in kinds:
            raise ValueError(f"an element of type {kind}, expected {kinds[0]}")
        return element

    def _tagged(self) -> tuple[int, memoryview]:
        """Type and data of the next element; up to four bytes of data are in the tag itself."""
        kind, length = struct.unpack_from(f"{self.order}II", self.data, self.start)
        if kind >> 16:
            kind, length, start, after = kind & 0xFFFF, kind >> 16, self.start + 4, self.start + 8
            if length > 4:
                raise ValueError(f"a small element of {length} bytes")
        else:
            start = self.start + 8
            after = start + (length if kind == _MATRIX else -(-length // 8) * 8)
        if start + length > len(self.data):
            raise ValueError(f"an element of {length} bytes, with {len(self.data) - start} left")
        self.start = min(after, len(self.data))
        return kind, self.data[start : start + length]
