"""The container of recordings: MCAP files that stay readable when writing them is cut short.

A recording grows as ``NAME.mcap.partial`` and gets its name at the orderly end. Whoever is killed
leaves the partial file; :class:`McapReader` reads it up to the cut, and :func:`seal` gives it the
index that it lacks. Where the disk fills, the writer cuts the torn end off, seals and goes.
"""

from __future__ import annotations

import heapq
import os
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Message,
    Metadata,
    Schema,
    Statistics,
)
from mcap.writer import Writer

from armsight import __version__
from armsight.errors import RecordingError
from armsight.recording.chunks import ChunkPlace, bounded, read_chunk
from armsight.recording.messages import definition

MAGIC = b"\x89MCAP0\r\n"
CHUNK_BYTES = 4 * 1024 * 1024
MOST_WHOLE = 64 * 1024 * 1024
"""Of a record that is taken into memory as it is [bytes]: what a cell is fits many times."""
LATCHED = """\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""
"""rosbag2's quality of service of a topic whose last message late subscribers still get."""


class DurableStream:
    """An unbuffered file: a failed write is known at once, and so is where the good part ends."""

    def __init__(self, file: Any) -> None:
        self._file = file
        self.good_end = 0

    def write(self, data: bytes) -> int:
        """Write all of the bytes, which are whole records.

        Raises:
            OSError: the disk is full or gone; ``good_end`` is where the last whole write ended.
        """
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest) :]
        self.good_end += len(data)
        return len(data)

    def tell(self) -> int:
        """Bytes written."""
        return self.good_end

    def flush(self) -> None:
        """Nothing waits in this stream."""


class McapWriter:
    """Writes ``NAME.mcap.partial``; :meth:`close` turns it into ``NAME.mcap``."""

    def __init__(self, path: Path) -> None:
        """Start a recording.

        Raises:
            RecordingError: the path has another ending, exists already, or cannot be written.
        """
        self.path = path
        self.partial = path.with_name(path.name + ".partial")
        if path.suffix != ".mcap":
            raise RecordingError(f"{path}: a recording's name must end in .mcap")
        for existing in (path, self.partial):
            if existing.exists():
                raise RecordingError(
                    f"{existing}: exists already and is never overwritten; choose another name"
                )
        try:
            self._file = self.partial.open("xb", buffering=0)
        except OSError as error:
            raise RecordingError(
                f"{self.partial}: cannot be written ({error.strerror}); "
                "choose a folder that exists and is yours"
            ) from error
        self._stream = DurableStream(self._file)
        self._writer: Any = Writer(cast(Any, self._stream), chunk_size=CHUNK_BYTES)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        try:
            self._writer.start("ros2", f"armsight {__version__}")
        except OSError as error:
            self._file.close()
            self.partial.unlink()  # it is ours and holds nothing
            raise RecordingError(
                f"{self.partial}: cannot be written ({error.strerror}); free some space, or record "
                "to another disk"
            ) from error

    def describe(
        self, metadata: Mapping[str, Mapping[str, str]], attachments: Mapping[str, bytes]
    ) -> None:
        """Write what is known before the first message, so that a cut file has it too."""
        for name, values in metadata.items():
            self._writer.add_metadata(name, dict(values))
        for name, data in attachments.items():
            self._writer.add_attachment(0, 0, name, "text/plain", data)

    def write(
        self,
        topic: str,
        type_name: str,
        data: bytes,
        log_time: int,
        publish_time: int,
        *,
        sequence: int = 0,
        latched: bool = False,
    ) -> None:
        """Append a message; times in [ns].

        Raises:
            OSError: the disk is full or gone; only :meth:`abandon` may follow.
        """
        channel = self._channels.get(topic)
        if channel is None:
            schema = self._schemas.get(type_name)
            if schema is None:
                text = definition(type_name).encode()
                schema = self._writer.register_schema(type_name, "ros2msg", text)
                self._schemas[type_name] = schema
            quality = {"offered_qos_profiles": LATCHED if latched else ""}
            channel = self._writer.register_channel(topic, "cdr", schema, quality)
            self._channels[topic] = channel
        self._writer.add_message(channel, log_time, data, publish_time, sequence & 0xFFFFFFFF)

    def flush(self) -> None:
        """Hand everything so far to the operating system: a kill now loses none of it."""
        self._writer.flush()

    def close(self) -> Path:
        """Write the index, rename the file, and return its path.

        Raises:
            OSError: the disk is full or gone; only :meth:`abandon` may follow.
        """
        self._writer.finish()
        return self._rename()

    def abandon(self) -> Path:
        """After a failed write: cut the torn end off, index what is whole, rename, return the path.

        Raises:
            RecordingError, OSError: not even that is possible; the partial file stays and is
                readable to its cut.
        """
        self._file.truncate(self._stream.good_end)
        self._file.flush()
        with self.partial.open("r+b") as file:
            seal(file)
        return self._rename()

    def _rename(self) -> Path:
        os.fsync(self._file.fileno())
        self._file.close()
        if self.path.exists():  # somebody made it meanwhile: keep both
            return self.partial
        self.partial.rename(self.path)
        return self.path


class LoosePlace(NamedTuple):
    """Where a message lies that is in no chunk, and of which channel, at what time [ns]."""

    log_time: int
    channel_id: int
    offset: int
    length: int


@dataclass
class Contents:
    """What a file holds, from its summary or from walking over its records.

    ``cut`` is empty for a whole file, else says what is wrong with its end; ``good_end`` is the
    byte after the last whole record of the data section.
    """

    profile: str = ""
    schemas: dict[int, Any] = field(default_factory=dict)
    channels: dict[int, Any] = field(default_factory=dict)
    chunks: list[ChunkPlace] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    loose: list[LoosePlace] = field(default_factory=list)
    cut: str = ""
    good_end: int = 0


def scan(file: BinaryIO) -> Contents:
    """Walk over a file's records, skipping the bulk of its chunks.

    Raises:
        RecordingError: this is no MCAP file at all.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    if file.read(8) != MAGIC:
        raise RecordingError("not an MCAP file (its first bytes are not MCAP's)")
    contents = Contents(good_end=8)
    while True:
        offset = file.tell()
        head = file.read(9)
        if len(head) < 9:
            contents.cut = "it ends without an index"
            return contents
        opcode, length = struct.unpack("<BQ", head)
        if opcode == 0 or offset + 9 + length > size:
            contents.cut = "its last record is torn"
            return contents
        if opcode in (Opcode.DATA_END, Opcode.FOOTER):
            contents.good_end = offset
            if file.seek(-8, os.SEEK_END) and file.read(8) != MAGIC:
                contents.cut = "its index is torn"
            return contents
        try:
            _take(file, opcode, length, offset, contents)
        except (McapError, struct.error, ValueError, EOFError) as error:
            contents.cut = f"its record at byte {offset} cannot be read ({error})"
            return contents
        file.seek(offset + 9 + length)
        contents.good_end = offset + 9 + length


def _take(file: BinaryIO, opcode: int, length: int, offset: int, contents: Contents) -> None:
    if opcode == Opcode.CHUNK:
        head = file.read(32)
        start, end, raw, _crc, name = struct.unpack("<QQQII", head)
        compression = file.read(min(name, length)).decode()
        (packed,) = struct.unpack("<Q", file.read(8))
        place = ChunkPlace(offset, 9 + length, start, end, compression, packed, raw)
        place.index_end = offset + 9 + length
        contents.chunks.append(place)
    elif opcode == Opcode.MESSAGE_INDEX and contents.chunks:
        (channel,) = struct.unpack("<H", file.read(2))
        (bytes_of_entries,) = struct.unpack("<I", file.read(4))
        place = contents.chunks[-1]
        place.index_offsets[channel] = offset
        place.counts[channel] = bytes_of_entries // 16
        place.index_end = offset + 9 + length
        if channel not in contents.channels:
            learn_channels(file, place, contents)
    elif opcode == Opcode.MESSAGE:
        channel, _sequence, log_time = struct.unpack("<HIQ", file.read(14))
        contents.loose.append(LoosePlace(log_time, channel, offset + 9, length))
    elif length <= MOST_WHOLE:
        _take_whole(bounded(file, length), opcode, contents)
    elif opcode != Opcode.ATTACHMENT:  # somebody's film may be large, and is none of ours
        raise ValueError(f"it claims {length} bytes; {MOST_WHOLE} are read at most")


def _take_whole(stream: ReadDataStream, opcode: int, contents: Contents) -> None:
    if opcode == Opcode.HEADER:
        contents.profile = Header.read(stream).profile
    elif opcode == Opcode.SCHEMA:
        schema = Schema.read(stream)
        contents.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel_record = Channel.read(stream)
        contents.channels[channel_record.id] = channel_record
    elif opcode == Opcode.METADATA:
        metadata = Metadata.read(stream)
        contents.metadata[metadata.name] = dict(metadata.metadata)
    elif opcode == Opcode.ATTACHMENT:
        attachment = Attachment.read(stream)
        contents.attachments[attachment.name] = attachment.data


def learn_channels(file: BinaryIO, place: ChunkPlace, contents: Contents) -> None:
    """Add the schemas and channels that a chunk introduces."""
    for record in read_chunk(file, place):
        if isinstance(record, Schema):
            contents.schemas[record.id] = record
        elif isinstance(record, Channel):
            contents.channels[record.id] = record


def seal(file: BinaryIO) -> int:
    """Cut a torn end off a file and write the index that it lacks; the number of messages in it.

    Should the disk be too full even for the index, the last chunk makes room for it.

    Raises:
        RecordingError: this is no MCAP file at all.
        OSError: nothing can be written.
    """
    contents = scan(file)
    while contents.chunks and not _finish_last_chunk(file, contents):
        _drop_last_chunk(contents)
    while True:
        try:
            file.truncate(contents.good_end)
            file.seek(contents.good_end)
            file.write(_tail(contents))
            file.flush()
            return sum(sum(place.counts.values()) for place in contents.chunks)
        except OSError:
            if not contents.chunks:
                raise
            _drop_last_chunk(contents)


def _drop_last_chunk(contents: Contents) -> None:
    contents.good_end = contents.chunks.pop().offset


def _finish_last_chunk(file: BinaryIO, contents: Contents) -> bool:
    """Make sure that the last chunk is sound and that every channel in it is indexed."""
    place = contents.chunks[-1]
    try:
        records = read_chunk(file, place)
        learn_channels(file, place, contents)
    except RecordingError:
        return False
    present = {record.channel_id for record in records if isinstance(record, Message)}
    return present == set(place.index_offsets)


def _tail(contents: Contents) -> bytes:
    """Data end, summary and footer of a file whose data section ends at ``good_end``."""
    builder: Any = RecordBuilder()
    DataEnd(0).write(builder)
    summary_start = contents.good_end + builder.count
    for record in (*contents.schemas.values(), *contents.channels.values()):
        record.write(builder)
    counts: dict[int, int] = {}
    for place in contents.chunks:
        for channel, count in place.counts.items():
            counts[channel] = counts.get(channel, 0) + count
    Statistics(
        attachment_count=0,
        channel_count=len(contents.channels),
        channel_message_counts=counts,
        chunk_count=len(contents.chunks),
        message_count=sum(counts.values()),
        metadata_count=0,
        message_start_time=min((c.start for c in contents.chunks), default=0),
        message_end_time=max((c.end for c in contents.chunks), default=0),
        schema_count=len(contents.schemas),
    ).write(builder)
    for place in contents.chunks:
        ChunkIndex(
            chunk_length=place.length,
            chunk_start_offset=place.offset,
            compression=place.compression,
            compressed_size=place.compressed_size,
            message_end_time=place.end,
            message_index_length=place.index_end - place.offset - place.length,
            message_index_offsets=place.index_offsets,
            message_start_time=place.start,
            uncompressed_size=place.uncompressed_size,
        ).write(builder)
    Footer(summary_start=summary_start, summary_offset_start=0, summary_crc=0).write(builder)
    return bytes(builder.end()) + MAGIC


class McapReader:
    """Reads an MCAP file in the order of its log times, whole or cut short, a chunk at a time."""

    def __init__(self, path: Path) -> None:
        """Open a file and learn what is in it.

        Raises:
            RecordingError: it is missing, no MCAP file, or not a ROS 2 one.
        """
        self.path = path
        try:
            self._file = path.open("rb")
        except OSError as error:
            partial = path.with_name(path.name + ".partial")
            hint = f"; {partial.name} lies beside it, cut short: name that" * partial.exists()
            raise RecordingError(f"{path}: cannot be read ({error.strerror}){hint}") from error
        try:
            self.contents = scan(self._file)
        except RecordingError as error:
            self._file.close()
            raise RecordingError(f"{path}: {error}") from error
        if self.contents.cut:
            self._learn_end()

    def _learn_end(self) -> None:
        """The last chunk of a cut file may have lost its index: look into it, or leave it out."""
        while self.contents.chunks:
            try:
                learn_channels(self._file, self.contents.chunks[-1], self.contents)
                return
            except RecordingError:
                _drop_last_chunk(self.contents)

    @property
    def topics(self) -> dict[str, str]:
        """Type names by topic."""
        return {
            channel.topic: self.contents.schemas[channel.schema_id].name
            for channel in self.contents.channels.values()
            if channel.schema_id in self.contents.schemas and channel.message_encoding == "cdr"
        }

    @property
    def span(self) -> tuple[int, int]:
        """First and last log time [ns]; (0, 0) of an empty file."""
        chunks, loose = self.contents.chunks, self.contents.loose
        starts = [c.start for c in chunks] + [m.log_time for m in loose]
        ends = [c.end for c in chunks] + [m.log_time for m in loose]
        return (min(starts), max(ends)) if starts else (0, 0)

    def messages(self, topics: Sequence[str] | None = None) -> Iterator[tuple[str, str, Any]]:
        """(topic, type name, record) in the order of log times, equal times as written.

        Raises:
            RecordingError: a chunk in the middle of the file is damaged.
        """
        wanted = {
            i: (c.topic, self.contents.schemas[c.schema_id].name)
            for i, c in self.contents.channels.items()
            if c.schema_id in self.contents.schemas
            and c.message_encoding == "cdr"
            and (topics is None or c.topic in topics)
        }
        waiting = sorted(self.contents.chunks, key=lambda c: (c.start, c.offset), reverse=True)
        heap: list[tuple[int, int, int, Any]] = [
            (m.log_time, 0, i, m) for i, m in enumerate(self.contents.loose)
        ]
        heapq.heapify(heap)
        while waiting or heap:
            while waiting and (not heap or waiting[-1].start <= heap[0][0]):
                place = waiting.pop()
                if place.counts and not wanted.keys() & place.counts.keys():
                    continue
                for i, record in enumerate(self._records(place)):
                    if isinstance(record, Message):
                        heapq.heappush(heap, (record.log_time, place.offset, i, record))
            if heap:
                record = heapq.heappop(heap)[3]
                if record.channel_id in wanted:
                    yield (*wanted[record.channel_id], self._whole(record))

    def _records(self, place: ChunkPlace) -> list[Any]:
        try:
            return read_chunk(self._file, place)
        except RecordingError as error:
            good = (place.start - self.span[0]) / 1e9
            raise RecordingError(
                f"{self.path}: {error}; whole up to {good:.1f} s (--seconds replays so much)"
            ) from error

    def _whole(self, record: Any) -> Any:
        """A message; one that lies in no chunk is read only now."""
        if not isinstance(record, LoosePlace):
            return record
        self._file.seek(record.offset)
        try:
            return Message.read(bounded(self._file, record.length), record.length)
        except Exception as error:  # struct, mcap
            raise RecordingError(
                f"{self.path}: the message at byte {record.offset} is damaged ({error})"
            ) from error

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> McapReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
