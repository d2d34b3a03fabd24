"""Packing a labelled set: nothing is lost or moved, and what is missing is told."""

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from armsight.errors import RecognitionError
from armsight.recognition.data.splits import split
from armsight.recognition.networks.architecture import JOINTS
from armsight.recognition.training import packing
from armsight.recognition.training.packed_set import PARTS, read_packed_set
from armsight.recognition.training.tensors_file import read_tensors, write_tensors

ROBOTS = ["ur5", "none", "iiwa", "ur5", "unknown", "iiwa", "ur5", "ur5", "iiwa", "ur5"]


@dataclass
class FakeSet:
    """What packing asks of a labelled set."""

    folder: Path
    rows: list[SimpleNamespace] = field(default_factory=list)
    manifest: SimpleNamespace = field(
        default_factory=lambda: SimpleNamespace(kind="paper-like", renderer="fake 1", seed=7)
    )

    def __post_init__(self) -> None:
        self.rows = [SimpleNamespace(robot=r, scene=i % 4) for i, r in enumerate(ROBOTS)]

    def split(self, part: str, by: str, seed: int) -> np.ndarray:
        robots, scenes = [r.robot for r in self.rows], [r.scene for r in self.rows]
        return split(robots, scenes, part, by, seed)  # type: ignore[arg-type]

    def __getitem__(self, i: int) -> SimpleNamespace:
        rng = np.random.default_rng(i)
        image = cv2.resize(rng.integers(0, 256, (10, 12, 3), dtype=np.uint8), (128, 106))
        mask = np.zeros((106, 128), bool)
        mask[20:60, 30 + i : 60 + i] = True
        joints = rng.normal(size=(JOINTS[ROBOTS[i]], 3))
        K = np.array([[110.0, 0, 63.5], [0, 110, 52.5], [0, 0, 1]])
        return SimpleNamespace(
            index=i, scene=i % 4, robot=ROBOTS[i], image=image, mask=mask, K=K,
            joints_camera=joints, base_camera=rng.normal(size=3),
        )  # fmt: skip


@pytest.fixture
def packed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(packing, "PIECE_BYTES", 64 * 53 * 4 * 3)
    source = FakeSet(tmp_path)
    assert packing.pack(source, tmp_path / "packed", 64, 53) == 8  # type: ignore[arg-type]
    return tmp_path / "packed"


def test_samples_come_back(packed: Path) -> None:
    data = read_packed_set(packed)
    assert len(list(packed.iterdir())) == 3
    assert data.robots == ("ur5", "iiwa")
    assert list(data.index) == [0, 2, 3, 5, 6, 7, 8, 9]
    assert data.source == {"kind": "paper-like", "renderer": "fake 1", "seed": "7"}
    source = FakeSet(packed)
    for k, i in enumerate(data.index):
        sample = source[int(i)]
        assert data.robots[data.robot[k]] == sample.robot
        count = JOINTS[sample.robot]
        np.testing.assert_allclose(data.joints[k, :count], sample.joints_camera, rtol=1e-6)
        assert np.isnan(data.joints[k, count:]).all()
        np.testing.assert_allclose(data.base[k], sample.base_camera, rtol=1e-6)
        # Half the size: each pixel is the mean of four.
        mean = sample.image.astype(float).reshape(53, 2, 64, 2, 3).mean(axis=(1, 3))
        assert np.abs(data.images[k] - mean).max() <= 1
        share = sample.mask.reshape(53, 2, 64, 2).mean(axis=(1, 3))
        assert np.array_equal(data.masks(np.array([k]))[0], share >= 0.5)
        np.testing.assert_allclose(data.K[k, 0], [55.0, 0, 31.5])


def test_parts_are_those_of_the_labelled_set(packed: Path) -> None:
    data, source = read_packed_set(packed), FakeSet(packed)
    for by, column in (("frame", data.part_frame), ("scene", data.part_scene)):
        for k, part in enumerate(PARTS):
            wanted = set(source.split(part, by, 0)) & set(data.index.tolist())
            assert set(data.index[column == k].tolist()) == wanted


def test_selecting(packed: Path) -> None:
    data = read_packed_set(packed)
    both = data.select("train", "frame", ("ur5", "iiwa"))
    assert list(both) == sorted(both)
    assert {data.robots[r] for r in data.robot[data.select("train", "frame", ("iiwa",))]} == {
        "iiwa"
    }
    few = data.select("train", "frame", ("ur5", "iiwa"), limit=1, seed=3)
    assert len(few) == 2
    assert set(few) <= set(both)
    assert np.array_equal(few, data.select("train", "frame", ("ur5", "iiwa"), 1, 3))
    with pytest.raises(RecognitionError, match="has no panda"):
        data.select("train", "frame", ("panda",))


def test_a_folder_that_is_taken(packed: Path) -> None:
    with pytest.raises(RecognitionError, match="already"):
        packing.pack(FakeSet(packed), packed, 64, 53)  # type: ignore[arg-type]


def test_nothing_to_read(tmp_path: Path) -> None:
    with pytest.raises(RecognitionError, match="--pack"):
        read_packed_set(tmp_path)


def test_a_missing_piece(packed: Path) -> None:
    (packed / "pack-00001.safetensors").unlink()
    with pytest.raises(RecognitionError, match="missing"):
        read_packed_set(packed)


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("base", None),
        ("base", np.full((2, 3), np.nan, np.float32)),
        ("robot", np.full(2, 9, np.uint8)),
        ("part_scene", np.full(2, 3, np.uint8)),
        ("joints", np.zeros((2, 6, 3), np.float32)),
        ("mask", np.zeros((2, 9), np.uint8)),
        ("scene", np.zeros(3, np.int32)),
    ],
)
def test_a_damaged_piece(packed: Path, column: str, value: np.ndarray | None) -> None:
    file = packed / "pack-00002.safetensors"
    columns, words = read_tensors(file)
    assert len(columns["base"]) == 2
    if value is None:
        del columns[column]
    else:
        columns[column] = value
    write_tensors(file, columns, words)
    with pytest.raises(RecognitionError):
        read_packed_set(packed)


def test_a_piece_of_another_set(packed: Path) -> None:
    file = packed / "pack-00002.safetensors"
    columns, words = read_tensors(file)
    write_tensors(file, columns, {**words, "seed": "8"})
    with pytest.raises(RecognitionError, match="another set"):
        read_packed_set(packed)
