"""Damage in a set is found, and said in one line that names the file."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armsight.errors import ArmsightError, DatasetError, UsageError
from armsight.recognition.data.checking import check
from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.data.rows import from_json, to_json
from armsight.recognition.data.showing import show, write_picture
from armsight.recognition.data.splits import split


@pytest.fixture
def copy(paper_like: LabelledSet, tmp_path: Path) -> Path:
    shutil.copytree(paper_like.folder, tmp_path / "set")
    return tmp_path / "set"


def first(folder: Path, what: str) -> Path:
    return sorted((folder / "shards" / "00000" / what).iterdir())[0]


def edit_line(folder: Path, number: int, **changes: object) -> None:
    path = folder / "shards" / "00000" / "labels.jsonl"
    lines = path.read_text().splitlines()
    lines[number] = json.dumps(json.loads(lines[number]) | changes)
    path.write_text("\n".join(lines) + "\n")


def test_a_sound_set_is_sound(paper_like: LabelledSet, wild: LabelledSet) -> None:
    for one in (paper_like, wild):
        report = check(one.folder)
        assert report.problems == ()
        assert report.read == len(one) == one.manifest.count


def test_rows_survive_the_file(wild: LabelledSet) -> None:
    for row in wild.rows:
        again = from_json(to_json(row))
        assert to_json(again) == to_json(row)
        np.testing.assert_array_equal(again.T_camera_base, row.T_camera_base)


@pytest.mark.parametrize("what", ["images", "links"])
@pytest.mark.parametrize("left", [0, 10, 0.6])
def test_truncated_pictures(copy: Path, what: str, left: float) -> None:
    path = first(copy, what)
    raw = path.read_bytes()
    path.write_bytes(raw[: int(left * len(raw)) if left < 1 else int(left)])
    with pytest.raises(DatasetError, match=path.name) as caught:
        LabelledSet.open(copy)[0]
    assert "\n" not in str(caught.value)
    assert len(check(copy).problems) == 1


def test_pictures_that_are_something_else(copy: Path) -> None:
    path = first(copy, "images")
    path.write_bytes(b"GIF89a" + bytes(100))
    with pytest.raises(DatasetError, match="is no picture"):
        LabelledSet.open(copy)[0]
    cv2.imwrite(str(path), np.zeros((20, 30, 3), np.uint8))
    with pytest.raises(DatasetError, match="expected"):
        LabelledSet.open(copy)[0]
    path.unlink()
    with pytest.raises(DatasetError, match="cannot be read"):
        LabelledSet.open(copy)[0]


def test_link_ids_that_cannot_be(copy: Path) -> None:
    path = first(copy, "links")
    ids = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(path), np.full_like(ids, 200))
    with pytest.raises(DatasetError, match="names a link"):
        LabelledSet.open(copy)[0]
    cv2.imwrite(str(path), ids.astype(np.uint16))
    with pytest.raises(DatasetError, match="uint16"):
        LabelledSet.open(copy)[0]


def test_a_missing_shard(copy: Path) -> None:
    shutil.rmtree(copy / "shards" / "00001")
    with pytest.raises(DatasetError, match=r"00001.*is missing"):
        LabelledSet.open(copy)
    assert len(LabelledSet.open(copy, partial=True)) == 8
    assert len(check(copy).problems) == 1
    shutil.rmtree(copy / "shards")
    with pytest.raises(DatasetError, match="no finished shard"):
        LabelledSet.open(copy, partial=True)


def test_no_set_and_sets_of_other_versions(copy: Path, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="is no labelled set"):
        LabelledSet.open(tmp_path / "nowhere")
    path = copy / "dataset.toml"
    text = path.read_text()
    path.write_text(text.replace("format = 1", "format = 99"))
    with pytest.raises(DatasetError, match="is of format 99, this armsight reads 1"):
        LabelledSet.open(copy)
    path.write_text(text.replace("seed = 11", 'seed = "eleven"'))
    with pytest.raises(DatasetError, match="seed is 'eleven', expected int"):
        LabelledSet.open(copy)
    path.write_text("format = [")
    with pytest.raises(DatasetError, match="is not TOML"):
        LabelledSet.open(copy)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DatasetError, match="is not TOML"):
        LabelledSet.open(copy)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"index": 3}, "index is 3, expected 0"),
        ({"robot": "r2d2"}, 'robot "r2d2" is unknown'),
        ({"robot": "unknown"}, "is not in the set"),
        ({"width": 640}, "size is 640"),
        ({"width": -1}, "absurd"),
        ({"image": "../../../etc/passwd"}, "leaves the shard"),
        ({"image": "/etc/passwd"}, "leaves the shard"),
        ({"K": [[1, 0], [0, 1]]}, "K has shape"),
        ({"K": [[-100, 0, 1], [0, 100, 1], [0, 0, 1]]}, "focal length"),
        ({"q": [1, 2, "three"]}, "q holds something that is no number"),
        ({"q": [10**400]}, "q holds something that is no number"),
        ({"q": [1.0]}, "joints_camera has shape"),
        ({"T_camera_base": [[None] * 4] * 4}, "not finite"),
        ({"keypoints_visible": [1, 0]}, "keypoints_visible"),
        ({"keypoints_px": []}, "keypoints_px has shape"),
        ({"seed": True}, "seed is True"),
    ],
)
def test_broken_lines(copy: Path, changes: dict[str, object], words: str) -> None:
    edit_line(copy, 0, **changes)
    with pytest.raises(DatasetError, match="line 1") as caught:
        LabelledSet.open(copy)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_labels_that_contradict_themselves(copy: Path, paper_like: LabelledSet) -> None:
    q = paper_like[0].q + 0.3
    edit_line(copy, 0, q=q.tolist())
    assert any("joints_camera does not follow" in p for p in check(copy).problems)


@given(st.text(max_size=200) | st.binary(max_size=60).map(lambda b: b.decode("latin1")))
def test_no_line_breaks_the_reader(line: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        from_json(line)


def test_lines_lost_and_lines_cut(copy: Path) -> None:
    path = copy / "shards" / "00000" / "labels.jsonl"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:-1]))
    with pytest.raises(DatasetError, match="has 7 lines for 8 samples"):
        LabelledSet.open(copy)
    path.write_text("\n".join([*lines[:-1], lines[-1][:100]]))
    with pytest.raises(DatasetError, match="line 8: is not JSON"):
        LabelledSet.open(copy)


@given(
    st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 9)), min_size=1, max_size=200),
    st.sampled_from(["frame", "scene"]),
    st.integers(0, 5),
)
def test_splits_cover_every_frame_once(frames: list[tuple[str, int]], by: str, seed: int) -> None:
    robots = [r for r, _ in frames]
    scenes = [100 * ord(r) + s for r, s in frames]
    parts = [split(robots, scenes, p, by, seed) for p in ("train", "validation", "test")]
    together = np.concatenate(parts)
    assert sorted(together) == list(range(len(frames)))
    if by == "scene":
        for k, part in enumerate(parts):
            others = {scenes[i] for j, p in enumerate(parts) if j != k for i in p}
            assert others.isdisjoint({scenes[i] for i in part})


def test_split_shares() -> None:
    robots, scenes = ["ur5"] * 1000 + ["iiwa"] * 500, [i % 20 for i in range(1000)] + [50] * 500
    assert len(split(robots, scenes, "test", "frame")) == 300
    assert len(split(robots, scenes, "validation", "frame")) == 150
    assert len(split(robots[:1000], scenes[:1000], "test", "scene")) == 200
    with pytest.raises(UsageError, match="no split"):
        split(robots, scenes, "exam", "frame")


def test_show_draws_one_picture(wild: LabelledSet, tmp_path: Path) -> None:
    picture = show(wild, 5, 3)
    assert picture.shape == (2 * 159 * 2, 3 * 192 * 2, 3)
    write_picture(tmp_path / "samples.png", picture)
    assert cv2.imread(str(tmp_path / "samples.png")).shape == picture.shape
    with pytest.raises(UsageError, match=r"png or \.jpg"):
        write_picture(tmp_path / "samples.gif", picture)
    (tmp_path / "no").touch()
    with pytest.raises(ArmsightError, match="cannot be written"):
        write_picture(tmp_path / "no" / "samples.png", picture)
    with pytest.raises(UsageError, match="cannot be shown"):
        show(wild, 0)
