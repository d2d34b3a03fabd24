"""Arrays in a file of the safetensors format, read and written with numpy alone.

Eight bytes of header length (little endian), a JSON header of names, types, shapes and places, then
the numbers. Nothing in such a file can be run. Written here, and not by that format's own library,
so that training works where only torch and numpy are; the library is the oracle in the tests.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armsight.errors import RecognitionError
from armsight.writing import write_atomically

Array = NDArray[Any]

_TYPES: dict[str, str] = {
    "BOOL": "|b1",
    "U8": "|u1",
    "I8": "|i1",
    "U16": "<u2",
    "I16": "<i2",
    "I32": "<i4",
    "I64": "<i8",
    "U32": "<u4",
    "U64": "<u8",
    "F16": "<f2",
    "F32": "<f4",
    "F64": "<f8",
}
_NAMES = {np.dtype(v): k for k, v in _TYPES.items()}
_LARGEST_HEADER = 100_000_000
_DEEPEST = 8


def write_tensors(
    file: Path, tensors: Mapping[str, Array], metadata: Mapping[str, str] | None = None
) -> None:
    """Write arrays whole or not at all, through a temporary file beside the final one.

    Raises:
        RecognitionError: the folder cannot be written, or the disk is full.
    """
    header: dict[str, Any] = {"__metadata__": dict(metadata)} if metadata else {}
    place = 0
    arrays = {k: np.ascontiguousarray(v).reshape(np.shape(v)) for k, v in tensors.items()}
    # Larger types first, so that each begins at a multiple of its own size.
    order = sorted(arrays, key=lambda k: (-arrays[k].dtype.itemsize, k))
    for name in order:
        array = arrays[name]
        header[name] = {
            "dtype": _NAMES[array.dtype],
            "shape": list(array.shape),
            "data_offsets": [place, place + array.nbytes],
        }
        place += array.nbytes
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    parts = (arrays[name].reshape(-1).view(np.uint8).data for name in order)
    write_atomically(file, struct.pack("<Q", len(text)) + text, *parts, error=RecognitionError)


def read_tensors(file: Path) -> tuple[dict[str, Array], dict[str, str]]:
    """The arrays of a file and its words; every place in it is checked before it is believed.

    Raises:
        RecognitionError: it is missing, damaged, or no such file.
    """
    try:
        data = np.fromfile(file, np.uint8)
    except FileNotFoundError:
        raise RecognitionError(f"{file}: there is no such file") from None
    except OSError as error:
        raise RecognitionError(f"{file}: cannot be read ({error.strerror or error})") from None
    header, start = _header(file, data)
    words = header.pop("__metadata__", {})
    if not isinstance(words, dict) or not all(isinstance(v, str) for v in words.values()):
        raise _damaged(file, "its words are no words")
    tensors: dict[str, Array] = {}
    end = 0
    for name, entry in sorted(header.items(), key=lambda item: _place(file, *item)):
        first, last = _place(file, name, entry)
        dtype, shape = np.dtype(_TYPES[str(entry["dtype"])]), entry["shape"]
        if first != end or last - first != dtype.itemsize * int(np.prod(shape, dtype=object)):
            raise _damaged(file, f'"{name}" is not where and as long as it has to be')
        end = last
        if start + last > len(data):
            raise _damaged(file, "it is truncated")
        tensors[name] = data[start + first : start + last].copy().view(dtype).reshape(shape)
    if start + end != len(data):
        raise _damaged(file, "it is longer than its header says")
    return tensors, words


def _header(file: Path, data: NDArray[np.uint8]) -> tuple[dict[str, Any], int]:
    if len(data) < 10:
        raise _damaged(file, "it is too short")
    length = int.from_bytes(data[:8].tobytes(), "little")
    if length > min(_LARGEST_HEADER, len(data) - 8) or data[8] != ord("{"):
        raise _damaged(file, "it is no safetensors file, or truncated")
    try:
        header = json.loads(data[8 : 8 + length].tobytes())
    except (ValueError, RecursionError):
        raise _damaged(file, "its header is no JSON") from None
    if not isinstance(header, dict):
        raise _damaged(file, "its header is no JSON object")
    return header, 8 + length


def _place(file: Path, name: str, entry: object) -> tuple[int, int]:
    """First and last byte of an entry, whose form is checked."""
    if isinstance(entry, dict) and str(entry.get("dtype")) in _TYPES:
        shape, place = _whole(entry.get("shape")), _whole(entry.get("data_offsets"))
        if shape is not None and place is not None and len(shape) <= _DEEPEST and len(place) == 2:
            return place[0], place[1]
    raise _damaged(file, f'the entry "{name[:80]}" is no array')


def _whole(values: object) -> list[int] | None:
    """The list, if it is one of whole numbers that no file is too small for."""
    if isinstance(values, list) and all(
        isinstance(v, int) and not isinstance(v, bool) and 0 <= v < 2**60 for v in values
    ):
        return values
    return None


def _damaged(file: Path, why: str) -> RecognitionError:
    return RecognitionError(f"{file}: {why}; restore it, or make it anew")
