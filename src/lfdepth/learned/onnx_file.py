"""ONNX files, as far as networks here need them: nodes, attributes and arrays in protobuf's encoding.

The format is https://onnx.ai/onnx/repo-docs/IR.html; numbers of fields are those of onnx.proto.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Attribute = int | float | str | Sequence[int]

_OPSET = 17
_IR = 8
_FLOAT, _INT64 = 1, 7
_ATTRIBUTE_FLOAT, _ATTRIBUTE_INT, _ATTRIBUTE_STRING, _ATTRIBUTE_INTS = 1, 2, 3, 7


def _varint(value: int) -> bytes:
    value &= (1 << 64) - 1
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def _whole(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _bytes(field: int, value: bytes | str) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return _varint(field << 3 | 2) + _varint(len(data)) + data


def _attribute(name: str, value: Attribute) -> bytes:
    head = _bytes(1, name)
    if isinstance(value, int):
        return head + _whole(3, value) + _whole(20, _ATTRIBUTE_INT)
    if isinstance(value, float):
        return head + _varint(2 << 3 | 5) + struct.pack("<f", value) + _whole(20, _ATTRIBUTE_FLOAT)
    if isinstance(value, str):
        return head + _bytes(4, value) + _whole(20, _ATTRIBUTE_STRING)
    return head + b"".join(_whole(8, each) for each in value) + _whole(20, _ATTRIBUTE_INTS)


def _value(name: str, sizes: Sequence[int | str]) -> bytes:
    """A tensor of floats; sizes that are words may be any."""
    dims = [_bytes(1, _whole(1, each) if isinstance(each, int) else _bytes(2, each)) for each in sizes]
    tensor = _whole(1, _FLOAT) + _bytes(2, b"".join(dims))
    return _bytes(1, name) + _bytes(2, _bytes(1, tensor))


class Graph:
    """A graph under construction; every function returns the name of its result.

    Parameters
    ----------
    inputs
        Name and sizes of the one input; sizes that are words may be any.
    """

    def __init__(self, name: str, sizes: Sequence[int | str]) -> None:
        self._input = _value(name, sizes)
        self._parts: list[bytes] = []
        self._count = 0

    def array(self, values: npt.NDArray[np.float32] | npt.NDArray[np.int64]) -> str:
        """An array of constants, float32 or int64."""
        name = self._new()
        kind = _INT64 if values.dtype == np.int64 else _FLOAT
        little = np.ascontiguousarray(values, "<i8" if kind == _INT64 else "<f4")
        dims = b"".join(_whole(1, size) for size in values.shape)
        self._parts.append(_bytes(5, dims + _whole(2, kind) + _bytes(8, name) + _bytes(9, little.tobytes())))
        return name

    def node(self, kind: str, *inputs: str, **attributes: Attribute) -> str:
        """An operator on named values."""
        name = self._new()
        self._node(kind, inputs, [name], attributes)
        return name

    def nodes(self, kind: str, count: int, *inputs: str, **attributes: Attribute) -> list[str]:
        """An operator with several results."""
        names = [self._new() for _ in range(count)]
        self._node(kind, inputs, names, attributes)
        return names

    def model(self, output: str, sizes: Sequence[int | str]) -> bytes:
        """The file, with one output."""
        self._node("Identity", [output], ["output"], {})
        graph = b"".join(self._parts) + _bytes(2, "lfdepth") + _bytes(11, self._input)
        graph += _bytes(12, _value("output", sizes))
        return _whole(1, _IR) + _bytes(2, "lfdepth") + _bytes(7, graph) + _bytes(8, _whole(2, _OPSET))

    def _node(
        self, kind: str, inputs: Sequence[str], outputs: Sequence[str], attributes: dict[str, Attribute]
    ) -> None:
        body = b"".join(_bytes(1, each) for each in inputs) + b"".join(_bytes(2, each) for each in outputs)
        body += _bytes(4, kind) + b"".join(_bytes(5, _attribute(*each)) for each in attributes.items())
        self._parts.append(_bytes(1, body))

    def _new(self) -> str:
        self._count += 1
        return f"v{self._count}"
