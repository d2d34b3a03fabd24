"""Chunks of MCAP files: packed records that are unpacked into no more memory than they claim."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.records import Chunk
from mcap.stream_reader import breakup_chunk

from armsight.errors import RecordingError

MOST_UNPACKED = 1 << 30
"""A chunk that claims more is not unpacked [bytes]; writers make them of 1 to 16 MB."""


@dataclass
class ChunkPlace:
    """Where a chunk lies: its first byte, its length with the record's head, its times [ns]."""

    offset: int
    length: int
    start: int
    end: int
    compression: str
    compressed_size: int
    uncompressed_size: int
    index_offsets: dict[int, int] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    index_end: int = 0


def bounded(file: BinaryIO, length: int) -> ReadDataStream:
    """The next bytes alone: a damaged length inside them cannot ask for more memory than those."""
    return ReadDataStream(io.BytesIO(file.read(length)))


def read_chunk(file: BinaryIO, place: ChunkPlace, check: bool = True) -> list[Any]:
    """The records in a chunk, its checksum verified.

    Raises:
        RecordingError: the chunk is damaged, or larger than any honest one.
    """
    file.seek(place.offset + 9)
    try:
        chunk = Chunk.read(bounded(file, place.length - 9))
        chunk.data, chunk.compression = _unpacked(chunk), ""
        return breakup_chunk(chunk, validate_crc=check)
    except Exception as error:  # zstandard, lz4, struct, mcap: all mean the same here
        raise RecordingError(f"the chunk at byte {place.offset} is damaged ({error})") from error


def _unpacked(chunk: Chunk) -> bytes:
    """What a chunk holds; a few packed bytes may claim, or unpack into, more than any memory."""
    size, data = chunk.uncompressed_size, chunk.data
    if size > MOST_UNPACKED:
        raise ValueError(f"it claims {size} bytes; {MOST_UNPACKED} are read at most")
    if chunk.compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(data) as stream:
            data = stream.read(size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    elif chunk.compression:
        raise ValueError(f"it is packed as '{chunk.compression}'; expected zstd, lz4 or nothing")
    if len(data) != size:
        more = "more" if len(data) > size else f"{len(data)}"
        raise ValueError(f"it claims {size} bytes and holds {more}")
    return data
