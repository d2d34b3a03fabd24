"""The container: what is cut, torn, full or foreign is read as far as it goes, and says so."""

from __future__ import annotations

import errno
import io
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import tracemalloc
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import pytest
import zstandard
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Header, Message, Schema
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader

from armsight.errors import RecordingError
from armsight.recording import mcap_file, messages
from armsight.recording.chunks import read_chunk
from armsight.recording.mcap_file import MAGIC, McapReader, McapWriter, scan, seal


def write(path: Path, count: int = 60, size: int = 300, close: bool = True) -> Path:
    """A file of numbered strings on two topics, in many small chunks."""
    writer = McapWriter(path)
    writer.describe({"armsight.test": {"key": "value"}}, {"workcell.toml": b"[cell]\n"})
    for i in range(count):
        text = f"{i} " + "x" * (size * (i % 3))
        topic = "/even" if i % 2 == 0 else "/odd"
        data = messages.encode_string(text)
        writer.write(topic, messages.STRING, data, 1000 * i, 1000 * i, sequence=i)
        if i % 5 == 4:
            writer.flush()
    return writer.close() if close else writer.partial


def numbers(reader: McapReader) -> list[int]:
    return [
        int(messages.decode(record.data, kind).data.split()[0])
        for _, kind, record in reader.messages()
    ]


def test_whole_files_come_back_in_order(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap")
    with McapReader(path) as reader:
        assert not reader.contents.cut
        assert reader.contents.profile == "ros2"
        assert reader.contents.metadata["armsight.test"] == {"key": "value"}
        assert reader.contents.attachments["workcell.toml"] == b"[cell]\n"
        assert reader.topics == {"/even": messages.STRING, "/odd": messages.STRING}
        assert reader.span == (0, 59_000)
        assert numbers(reader) == list(range(60))
        assert numbers(reader) == list(range(60))  # a second time
        odd = [record.sequence for _, _, record in reader.messages(["/odd"])]
        assert odd == list(range(1, 60, 2))
    assert not list(tmp_path.glob("*.partial"))


def test_other_peoples_readers_agree(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap")
    with AnyReader([path]) as bag:
        read = [bag.deserialize(raw, c.msgtype).data.split()[0] for c, _, raw in bag.messages()]
    assert read == [str(i) for i in range(60)]
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert [m.sequence for _, _, m in reader.iter_messages()] == list(range(60))
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 60
    assert next(iter(summary.schemas.values())).name == "std_msgs/msg/String"


def test_messages_out_of_order_are_put_in_order(tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "a.mcap")
    times = [50, 10, 40, 20, 30, 60, 0]
    for i, at in enumerate(times):
        writer.write("/t", messages.STRING, messages.encode_string(str(at)), at, at)
        if i % 2:
            writer.flush()
    with McapReader(writer.close()) as reader:
        assert numbers(reader) == sorted(times)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return write(tmp_path_factory.mktemp("whole") / "a.mcap").read_bytes()


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(share=st.floats(0.0, 1.0))
def test_a_cut_file_gives_all_before_the_cut(share: float, whole: bytes, tmp_path_factory) -> None:
    path = tmp_path_factory.mktemp("cut") / "a.mcap.partial"
    cut = int(share * len(whole))
    path.write_bytes(whole[:cut])
    if cut < 8:
        with pytest.raises(RecordingError, match="not an MCAP file"):
            McapReader(path)
        return
    with McapReader(path) as reader:
        read = numbers(reader)
        said = reader.contents.cut
    assert read == list(range(len(read)))
    assert bool(said) == (cut < len(whole))
    assert len(read) >= _whole_chunks(whole[:cut])
    # Sealed, it is a whole file with the same messages, for everybody.
    with path.open("r+b") as file:
        seal(file)
    with McapReader(path) as reader:
        assert not reader.contents.cut
        sealed = numbers(reader)
    assert sealed == read[: len(sealed)]
    assert len(read) - len(sealed) <= 5  # a chunk without its index may go
    if sealed:
        bag_path = path.with_name("b.mcap")
        shutil.copy(path, bag_path)
        with AnyReader([bag_path]) as bag:
            assert sum(1 for _ in bag.messages()) == len(sealed)


def _whole_chunks(data: bytes) -> int:
    """Messages in chunks that are whole with their index: the least that must come back."""
    return sum(sum(place.counts.values()) for place in scan(io.BytesIO(data)).chunks[:-1])


@settings(deadline=None, max_examples=40)
@given(at=st.integers(8, 5000), flip=st.integers(1, 255))
@example(at=150, flip=1)  # an attachment that claims a terabyte
def test_damage_is_an_error_or_harmless_never_a_crash(
    at: int, flip: int, whole: bytes, tmp_path_factory
) -> None:
    data = bytearray(whole)
    data[at % len(data)] ^= flip
    path = tmp_path_factory.mktemp("damaged") / "a.mcap"
    path.write_bytes(bytes(data))
    try:
        with McapReader(path) as reader:
            list(reader.messages())
    except RecordingError:
        pass


def packed(path: Path, how: str, data: bytes, claims: int) -> Path:
    """A file of one chunk, packed by hand."""
    builder = RecordBuilder()
    Header("ros2", "somebody").write(builder)
    Chunk(how, data, 0, 0, 0, claims).write(builder)
    path.write_bytes(MAGIC + bytes(builder.end()))
    return path


@pytest.mark.parametrize("how", ["zstd", "lz4"])
@pytest.mark.parametrize("claims", [1000, 1 << 40])
def test_a_few_bytes_that_unpack_into_all_memory_are_refused(
    how: str, claims: int, tmp_path: Path
) -> None:
    bomb = bytes(256 * 1024 * 1024)
    data = zstandard.compress(bomb) if how == "zstd" else lz4.frame.compress(bomb)
    del bomb
    path = packed(tmp_path / "a.mcap", how, data, claims)
    place = scan(io.BytesIO(path.read_bytes())).chunks[0]
    tracemalloc.start()
    with path.open("rb") as file, pytest.raises(RecordingError, match="claims"):
        read_chunk(file, place)
    assert tracemalloc.get_traced_memory()[1] < 50_000_000
    tracemalloc.stop()


@pytest.mark.parametrize("how", ["zstd", "lz4", ""])
def test_every_packing_of_the_standard_is_read(how: str, tmp_path: Path) -> None:
    builder = RecordBuilder()
    Schema(1, messages.definition(messages.STRING).encode(), "ros2msg", messages.STRING).write(
        builder
    )
    Channel(1, "/a", "cdr", {}, 1).write(builder)
    Message(
        channel_id=1,
        data=messages.encode_string("7 hello"),
        log_time=5,
        publish_time=5,
        sequence=0,
    ).write(builder)
    raw = bytes(builder.end())
    data = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}[how](raw)
    with McapReader(packed(tmp_path / "a.mcap", how, data, len(raw))) as reader:
        assert numbers(reader) == [7]


def test_messages_outside_of_chunks_are_read_one_at_a_time(tmp_path: Path) -> None:
    """As ``ros2 bag record`` writes them where chunks are switched off."""
    path, size = tmp_path / "a.mcap", 2_000_000
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False, compression=CompressionType.NONE)
        writer.start("ros2", "somebody")
        schema = writer.register_schema(messages.STRING, "ros2msg", b"string data")
        channel = writer.register_channel("/n", "cdr", schema)
        for i in (2, 0, 1, *range(3, 40)):
            data = messages.encode_string(f"{i} " + "x" * size)
            writer.add_message(channel, 1000 * i, data, 1000 * i, i)
        writer.add_attachment(0, 0, "film.mp4", "video/mp4", bytes(70 * 1024 * 1024))
        writer.finish()
    tracemalloc.start()
    with McapReader(path) as reader:
        assert not reader.contents.cut
        assert reader.span == (0, 39_000)
        assert numbers(reader) == list(range(40))
        assert list(reader.messages(["/other"])) == []
        assert not reader.contents.attachments
    assert tracemalloc.get_traced_memory()[1] < 10 * size
    tracemalloc.stop()


def test_a_disk_that_is_full_before_the_first_byte_is_said(tmp_path: Path) -> None:
    class Full:
        def write(self, data: bytes) -> int:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    opened = mcap_file.DurableStream.__init__

    def full(self: mcap_file.DurableStream, file: object) -> None:
        opened(self, Full())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mcap_file.DurableStream, "__init__", full)
        with pytest.raises(RecordingError, match=r"No space left on device.*free some space"):
            McapWriter(tmp_path / "a.mcap")
    assert not list(tmp_path.iterdir())


def test_a_killed_writer_leaves_what_it_flushed(tmp_path: Path) -> None:
    program = textwrap.dedent(
        """
        import sys, time
        from pathlib import Path
        from armsight.recording import messages
        from armsight.recording.mcap_file import McapWriter
        writer = McapWriter(Path(sys.argv[1]))
        for i in range(100000):
            data = messages.encode_string(str(i))
            writer.write("/n", messages.STRING, data, i, i)
            if i % 10 == 9:
                writer.flush()
                print(i, flush=True)
                time.sleep(0.001)
        """
    )
    path = tmp_path / "a.mcap"
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    while int(process.stdout.readline()) < 49:
        pass
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not path.exists()
    with pytest.raises(RecordingError, match=r"a\.mcap\.partial lies beside it"):
        McapReader(path)
    with McapReader(path.with_name("a.mcap.partial")) as reader:
        assert "without an index" in reader.contents.cut or "torn" in reader.contents.cut
        read = numbers(reader)
    assert len(read) >= 50
    assert read == list(range(len(read)))


def test_a_full_disk_leaves_a_whole_file(tmp_path: Path) -> None:
    """The limit on file sizes is the disk that everybody can fill."""
    program = textwrap.dedent(
        """
        import resource, sys, random
        from pathlib import Path
        from armsight.recording import messages
        from armsight.recording.mcap_file import McapWriter
        limit = int(sys.argv[2])
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        writer = McapWriter(Path(sys.argv[1]))
        noise = random.Random(0)
        try:
            for i in range(100000):
                text = f"{i} " + "".join(noise.choices("abcdefghijklmnop", k=500))
                writer.write("/n", messages.STRING, messages.encode_string(text), i, i)
                if i % 20 == 19:
                    writer.flush()
        except OSError as error:
            print(error.errno, i)
            print(writer.abandon())
        """
    )
    for limit in (100_000, 100_300, 123_456):
        path = tmp_path / f"{limit}.mcap"
        done = subprocess.run(
            [sys.executable, "-c", program, str(path), str(limit)],
            capture_output=True,
            text=True,
            check=True,
        )
        code, last = done.stdout.split()[:2]
        assert int(code) in (errno.EFBIG, errno.ENOSPC)
        assert path.stat().st_size <= limit
        with McapReader(path) as reader:
            assert not reader.contents.cut
            read = numbers(reader)
        assert read == list(range(len(read)))
        assert len(read) >= int(last) - 60  # the chunk that failed, and one for the index
        with AnyReader([path]) as bag:
            assert bag.message_count == len(read)


def test_a_disk_without_room_for_the_index_gives_up_a_chunk(tmp_path: Path) -> None:
    partial = write(tmp_path / "a.mcap", close=False)
    before = len(partial.read_bytes())

    class Full(io.BytesIO):
        """As large as the file is now, and no larger."""

        def write(self, data) -> int:  # type: ignore[no-untyped-def]
            if self.tell() + len(data) > before:
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(data)

    file = Full()
    io.BytesIO.write(file, partial.read_bytes())
    kept = seal(file)
    assert 40 <= kept < 60
    out = tmp_path / "b.mcap"
    out.write_bytes(file.getvalue())
    with McapReader(out) as reader:
        assert not reader.contents.cut
        assert numbers(reader) == list(range(kept))


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap")
    before = path.read_bytes()
    with pytest.raises(RecordingError, match="never overwritten"):
        McapWriter(path)
    McapWriter(tmp_path / "b.mcap")
    with pytest.raises(RecordingError, match=r"b\.mcap\.partial: exists already"):
        McapWriter(tmp_path / "b.mcap")
    assert path.read_bytes() == before


def test_a_name_taken_meanwhile_keeps_both(tmp_path: Path) -> None:
    partial = write(tmp_path / "a.mcap", close=False)
    writer = McapWriter(tmp_path / "c.mcap")
    (tmp_path / "c.mcap").write_bytes(b"somebody else's")
    assert writer.close() == tmp_path / "c.mcap.partial"
    assert (tmp_path / "c.mcap").read_bytes() == b"somebody else's"
    assert partial.exists()


@pytest.mark.parametrize(
    ("name", "told"),
    [("a.bag", "must end in .mcap"), ("missing/a.mcap", "cannot be written")],
)
def test_names_that_cannot_be_are_refused(tmp_path: Path, name: str, told: str) -> None:
    with pytest.raises(RecordingError, match=told):
        McapWriter(tmp_path / name)


@pytest.mark.parametrize(
    ("data", "told"),
    [(b"", "not an MCAP file"), (b"PK\x03\x04 no", "not an MCAP file"), (None, "cannot be read")],
)
def test_files_that_are_none_are_refused(tmp_path: Path, data: bytes | None, told: str) -> None:
    path = tmp_path / "a.mcap"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(RecordingError, match=told):
        McapReader(path)


def test_a_failed_write_is_known_at_once(tmp_path: Path) -> None:
    class Half:
        """Takes half of what it gets, then nothing."""

        taken = 0

        def write(self, data: memoryview) -> int:
            if self.taken > 100:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            part = max(1, len(data) // 2)
            self.taken += part
            return part

    stream = mcap_file.DurableStream(Half())
    stream.write(b"x" * 40)
    with pytest.raises(OSError, match="No space"):
        stream.write(b"y" * 400)
    assert stream.good_end == 40
