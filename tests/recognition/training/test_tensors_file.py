"""Our reader and writer of safetensors against the format's own library, and against damage."""

import contextlib
import errno
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from safetensors.numpy import load_file, save_file

from armsight.errors import RecognitionError
from armsight.recognition.training.tensors_file import read_tensors, write_tensors


def some() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    return {
        "weights/a.b": rng.normal(size=(3, 4)).astype(np.float32),
        "half": rng.normal(size=7).astype(np.float16),
        "bytes": rng.integers(0, 255, (2, 3, 5), dtype=np.uint8),
        "step": np.array(17.0, np.float32),
        "places": np.arange(4, dtype=np.int64),
        "true": np.array([True, False]),
        "nothing": np.empty((0, 3), np.float64),
    }


def same(found: dict[str, np.ndarray], wanted: dict[str, np.ndarray]) -> None:
    assert set(found) == set(wanted)
    for name, value in wanted.items():
        assert found[name].dtype == value.dtype
        assert found[name].shape == value.shape
        assert found[name].tobytes() == value.tobytes()


def test_the_library_reads_what_we_write(tmp_path: Path) -> None:
    write_tensors(tmp_path / "a", some(), {"card": "{}"})
    same(load_file(tmp_path / "a"), some())


def test_we_read_what_the_library_writes(tmp_path: Path) -> None:
    save_file(some(), tmp_path / "a", {"card": "ä"})
    found, words = read_tensors(tmp_path / "a")
    same(found, some())
    assert words == {"card": "ä"}


def test_what_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RecognitionError, match="cannot be written"):
        write_tensors(tmp_path / "file" / "a", some())
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_full_disk_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_tensors(tmp_path / "a", some())
    before = (tmp_path / "a").read_bytes()

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(RecognitionError, match="No space left"):
        write_tensors(tmp_path / "a", {"b": np.zeros(5, np.float32)})
    assert (tmp_path / "a").read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(RecognitionError, match="no such file"):
        read_tensors(tmp_path / "a")


@pytest.mark.parametrize("share", [0.0, 0.001, 0.01, 0.3, 0.9, 0.999])
def test_truncation_is_told(tmp_path: Path, share: float) -> None:
    file = tmp_path / "a"
    write_tensors(file, some())
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    with pytest.raises(RecognitionError):
        read_tensors(file)


@pytest.mark.parametrize(
    "entry",
    [
        {"dtype": "F32", "shape": [2], "data_offsets": [0, 4]},
        {"dtype": "F32", "shape": [1], "data_offsets": [4, 8]},
        {"dtype": "F32", "shape": [1], "data_offsets": [8, 4]},
        {"dtype": "F32", "shape": [-1], "data_offsets": [0, 4]},
        {"dtype": "F32", "shape": [True], "data_offsets": [0, 4]},
        {"dtype": "F32", "shape": [2**59, 32], "data_offsets": [0, 4]},
        {"dtype": "F32", "shape": [1], "data_offsets": [0, 2**70]},
        {"dtype": "F32", "shape": [1], "data_offsets": [0]},
        {"dtype": "O", "shape": [1], "data_offsets": [0, 4]},
        {"dtype": ["F32"], "shape": [1], "data_offsets": [0, 4]},
        {"shape": [1], "data_offsets": [0, 4]},
        "F32",
        None,
    ],
)
def test_headers_that_lie(tmp_path: Path, entry: object) -> None:
    text = json.dumps({"a": entry}).encode()
    (tmp_path / "a").write_bytes(struct.pack("<Q", len(text)) + text + b"\0" * 4)
    with pytest.raises(RecognitionError):
        read_tensors(tmp_path / "a")


def test_a_pickle_is_refused(tmp_path: Path) -> None:
    import pickle

    (tmp_path / "a").write_bytes(pickle.dumps({"a": 1}) * 10)
    with pytest.raises(RecognitionError):
        read_tensors(tmp_path / "a")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.integers(0, 300), st.integers(0, 255))
def test_a_changed_byte_is_read_or_told(tmp_path: Path, place: int, value: int) -> None:
    file = tmp_path / "a"
    write_tensors(file, {"a": np.zeros(9, np.float32), "b": np.ones(3, np.uint8)}, {"x": "y"})
    data = bytearray(file.read_bytes())
    data[place % len(data)] = value
    file.write_bytes(bytes(data))
    with contextlib.suppress(RecognitionError):
        read_tensors(file)
