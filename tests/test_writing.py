import os
import stat

import pytest

from armsight.errors import ArmsightError, DatasetError
from armsight.writing import replacing, write_atomically, write_text


def test_parts_follow_each_other_in_a_folder_that_is_made(tmp_path):
    file = tmp_path / "deep" / "er" / "x.bin"
    write_atomically(file, b"one", memoryview(b"two"))
    assert file.read_bytes() == b"onetwo"
    assert [f.name for f in file.parent.iterdir()] == ["x.bin"]


def test_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    file = tmp_path / "x.json"
    write_text(file, "old")

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(DatasetError, match=r"x\.json: cannot be written: No space left on device"):
        write_text(file, "new", DatasetError)
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def _write_half(file):
    with replacing(file) as part:
        assert (part.parent, part.suffix) == (file.parent, file.suffix)
        part.write_bytes(b"half")
        raise ZeroDivisionError


def test_a_writer_that_raises_leaves_the_old_file(tmp_path):
    file = tmp_path / "x.mp4"
    file.write_bytes(b"old")
    with pytest.raises(ZeroDivisionError):
        _write_half(file)
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]


def test_readers_never_see_half(tmp_path):
    file = tmp_path / "x"
    write_text(file, "old")
    with replacing(file) as part:
        part.write_text("new")
        assert file.read_text() == "old"
    assert file.read_text() == "new"


def test_mode_is_kept_and_a_new_file_follows_the_umask(tmp_path):
    secret, plain = tmp_path / "secret", tmp_path / "plain"
    secret.touch(mode=0o600)
    umask = os.umask(0o027)
    try:
        write_text(secret, "x")
        write_text(plain, "x")
    finally:
        os.umask(umask)
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    assert stat.S_IMODE(plain.stat().st_mode) == 0o640


def test_a_link_stays_a_link(tmp_path):
    real, link = tmp_path / "real", tmp_path / "link"
    real.write_text("old")
    link.symlink_to(real)
    write_text(link, "new")
    assert link.is_symlink()
    assert real.read_text() == "new"


def test_a_pipe_is_written_into_and_a_file_in_the_way_is_named(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_text(pipe, "words")
    assert os.read(reader, 100) == b"words"
    os.close(reader)
    assert pipe.is_fifo()
    (tmp_path / "plain").write_text("a file")
    with pytest.raises(ArmsightError, match="cannot be written"):
        write_text(tmp_path / "plain" / "x", "")
    with pytest.raises(ArmsightError, match="cannot be written"):
        write_text(tmp_path, "")
