"""Writes ONNX files: a graph of named operators, in the protocol buffers of onnx.proto3.

Written by hand because torch's own exporters need two more packages, fold what they like and
change with every release; these graphs are chains of a dozen kinds of operators.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armsight.errors import RecognitionError

OPSET = 17
_IR_VERSION = 8
_TYPES = {
    np.dtype(np.float32): 1,
    np.dtype(np.uint8): 2,
    np.dtype(np.int8): 3,
    np.dtype(np.int64): 7,
    np.dtype(np.float16): 10,
}
FLOAT = 1
"""ONNX's number of the type float32."""
LARGEST = 2**31 - 10**6
"""[bytes] that weights may take: protocol buffers hold no message of 2 GiB."""

Attribute = int | float | str | Sequence[int]


class OnnxGraph:
    """A graph that is built operator by operator."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._nodes: list[bytes] = []
        self._constants: list[bytes] = []
        self._inputs: list[bytes] = []
        self._outputs: list[bytes] = []
        self._count = 0

    def input(self, name: str, dtype: type[np.generic], shape: Sequence[int | str]) -> str:
        """Declare an input; a side with a name is open."""
        self._inputs.append(_value_info(name, np.dtype(dtype), shape))
        return name

    def output(self, value: str, name: str, shape: Sequence[int | str]) -> None:
        """Declare a float32 value to be an output, under a name."""
        self._node("Identity", [value], [name], {})
        self._outputs.append(_value_info(name, np.dtype(np.float32), shape))

    def constant(self, array: NDArray[Any], name: str = "") -> str:
        """A constant of the graph."""
        name = name or self._fresh("constant")
        data = np.ascontiguousarray(array)
        self._constants.append(
            b"".join(_number(1, n) for n in data.shape)
            + _number(2, _TYPES[data.dtype])
            + _field(8, name.encode())
            + _field(9, data.tobytes())
        )
        return name

    def node(self, operator: str, *inputs: str, **attributes: Attribute) -> str:
        """Add an operator of one output; returns that output's name."""
        result = self._fresh(operator.lower())
        self._node(operator, inputs, [result], attributes)
        return result

    def encode(self, words: Mapping[str, str]) -> bytes:
        """The whole file, with words for whoever opens it.

        Raises:
            RecognitionError: it would be larger than such a file may be.
        """
        parts = [(1, self._nodes), (5, self._constants), (11, self._inputs), (12, self._outputs)]
        size = sum(len(m) for _, messages in parts for m in messages)
        if size > LARGEST:
            raise RecognitionError(
                f"the network takes {size / 2**30:.1f} GiB and an ONNX file holds less than 2: "
                "export it with half-precision dense layers, or train one with pools = 3"
            )
        graph = b"".join(_field(k, m) for k, messages in parts for m in messages)
        graph += _field(2, self._name.encode())
        entries = [_field(1, k.encode()) + _field(2, v.encode()) for k, v in words.items()]
        return (
            _number(1, _IR_VERSION)
            + _field(2, b"armsight")
            + _field(7, graph)
            + _field(8, _field(1, b"") + _number(2, OPSET))
            + b"".join(_field(14, e) for e in entries)
        )

    def _fresh(self, word: str) -> str:
        self._count += 1
        return f"{word}_{self._count}"

    def _node(
        self,
        operator: str,
        inputs: Sequence[str],
        outputs: Sequence[str],
        attributes: Mapping[str, Attribute],
    ) -> None:
        self._nodes.append(
            b"".join(_field(1, i.encode()) for i in inputs)
            + b"".join(_field(2, o.encode()) for o in outputs)
            + _field(3, f"{operator}_{len(self._nodes)}".encode())
            + _field(4, operator.encode())
            + b"".join(_field(5, _attribute(k, v)) for k, v in attributes.items())
        )


def _attribute(name: str, value: Attribute) -> bytes:
    head = _field(1, name.encode())
    if isinstance(value, int):
        return head + _number(3, value) + _number(20, 2)
    if isinstance(value, float):
        return head + _tag(2, 5) + struct.pack("<f", value) + _number(20, 1)
    if isinstance(value, str):
        return head + _field(4, value.encode()) + _number(20, 3)
    return head + b"".join(_number(8, int(v)) for v in value) + _number(20, 7)


def _value_info(name: str, dtype: np.dtype[Any], shape: Sequence[int | str]) -> bytes:
    dimensions = b"".join(
        _field(1, _field(2, n.encode()) if isinstance(n, str) else _number(1, n)) for n in shape
    )
    tensor = _number(1, _TYPES[dtype]) + _field(2, dimensions)
    return _field(1, name.encode()) + _field(2, _field(1, tensor))


def _field(number: int, data: bytes) -> bytes:
    return _tag(number, 2) + _varint(len(data)) + data


def _number(number: int, value: int) -> bytes:
    return _tag(number, 0) + _varint(value & 0xFFFFFFFFFFFFFFFF)


def _tag(number: int, kind: int) -> bytes:
    return _varint(number << 3 | kind)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)
