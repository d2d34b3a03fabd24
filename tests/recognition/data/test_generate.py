"""Sets are the same whoever draws them, and survive whatever stops their making."""

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest

from armsight.errors import DatasetError, UsageError
from armsight.recognition.data.crews import Alone, Batch, Processes, RayCluster, draw_batch
from armsight.recognition.data.generate import generate
from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.data.manifest import read_manifest
from armsight.recognition.data.order import Order, counts_of, make_order
from armsight.recognition.data.rows import Drawn, to_json
from armsight.recognition.data.shards import _claim

COUNTS = {"ur5": 3, "iiwa": 2, "none": 1, "unknown": 1}


def small(seed: int = 5) -> Order:
    return make_order("wild", COUNTS, seed, (64, 53), 3)


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }


@pytest.fixture(scope="module")
def whole(gl: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole") / "set"
    assert generate(small(), folder) == 7
    return folder


def test_two_processes_make_the_same_set(whole: Path, tmp_path: Path) -> None:
    crew = Processes(2)
    try:
        generate(small(), tmp_path / "set", crew)
    finally:
        crew.close()
    assert contents(tmp_path / "set") == contents(whole)


def test_a_sample_depends_on_seed_and_index_alone(whole: Path) -> None:
    backwards = {d.row.index: d for i in (6, 2, 0) for d in draw_batch(small(), [i])}
    lines = [
        r
        for k in range(3)
        for r in (whole / f"shards/{k:05d}/labels.jsonl").read_text().splitlines()
    ]
    for i, drawn in backwards.items():
        assert to_json(drawn.row) == lines[i]
        assert drawn.image == (whole / f"shards/{i // 3:05d}" / drawn.row.image).read_bytes()


def test_another_seed_makes_another_set(gl: str) -> None:
    a, b = draw_batch(small(5), [0])[0], draw_batch(small(6), [0])[0]
    assert not np.allclose(a.row.q, b.row.q)
    assert a.image != b.image


class Weary(Alone):
    """Stops after some batches with whatever it is given."""

    def __init__(self, batches: int, end: BaseException) -> None:
        self.batches, self.end = batches, end

    def draw(self, order: Order, batches: Iterable[Batch]) -> Iterator[list[Drawn]]:
        for k, batch in enumerate(batches):
            if k == self.batches:
                raise self.end
            yield draw_batch(order, batch)


@pytest.mark.parametrize("end", [KeyboardInterrupt(), DatasetError("a machine is gone")])
def test_a_stopped_set_keeps_whole_shards_and_goes_on(
    whole: Path, tmp_path: Path, end: BaseException
) -> None:
    folder = tmp_path / "set"
    with pytest.raises(type(end)):
        generate(small(), folder, Weary(2, end))
    assert sorted(p.name for p in (folder / "shards").iterdir()) == ["00000", "00001"]
    assert len(LabelledSet.open(folder, partial=True)) == 6
    with pytest.raises(DatasetError, match="finish the set"):
        LabelledSet.open(folder)
    assert generate(small(), folder) == 1
    assert contents(folder) == contents(whole)
    assert generate(small(), folder) == 0


def test_a_killed_process_leaves_nothing_that_counts(whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    script = f"""
import os, signal
from pathlib import Path
from armsight.recognition.data import shards
from armsight.recognition.data.generate import generate
from armsight.recognition.data.order import make_order
shards.fill.__defaults__ = (None, 2)  # batches of two: the kill falls into a shard
def kill(done, total):
    if done >= 5:
        os.kill(os.getpid(), signal.SIGKILL)
generate(make_order("wild", {COUNTS!r}, 5, (64, 53), 3), Path({str(folder)!r}), None, kill)
"""
    ended = subprocess.run([sys.executable, "-c", script], check=False, env=os.environ)
    assert ended.returncode == -signal.SIGKILL
    assert sorted(p.name for p in (folder / "shards").iterdir()) == ["00000", "00001.part"]
    assert generate(small(), folder) == 4
    assert contents(folder) == contents(whole)


def test_a_full_disk_is_said_and_leaves_no_part(
    gl: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(self: Path, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(DatasetError, match="disk is full; finished shards are kept"):
        generate(small(), tmp_path / "set")
    assert list((tmp_path / "set" / "shards").iterdir()) == []


def test_another_set_in_the_folder_is_refused(whole: Path) -> None:
    with pytest.raises(DatasetError, match="holds a set with seed = 5, not 6"):
        generate(small(6), whole)


def test_a_folder_with_other_things_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(DatasetError, match="is not empty and holds no set"):
        generate(small(), tmp_path)


def test_what_a_kill_left_hidden_is_no_other_thing(tmp_path: Path) -> None:
    (tmp_path / ".dataset.0a1b2c3d.toml").write_text("")
    (tmp_path / ".DS_Store").write_bytes(b"")
    _claim(tmp_path, small().manifest)
    assert read_manifest(tmp_path) == small().manifest


def test_two_writers_of_one_folder_are_refused(tmp_path: Path) -> None:
    import fcntl

    with open(tmp_path / ".lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(DatasetError, match="another process"):
            generate(small(), tmp_path)


def test_ray_is_asked_for_only_when_named() -> None:
    assert "ray" not in sys.modules
    try:
        import ray  # noqa: F401
    except ImportError:
        with pytest.raises(DatasetError, match=r"pip install 'armsight\[ray\]'"):
            RayCluster("auto")


def test_order_has_the_counts_and_mixes_them_evenly() -> None:
    counts = {"ur3": 926, "ur5": 2520, "panda": 554}
    order = make_order("paper-like", counts, 0, (64, 53))
    names = [order.robot(i) for i in range(order.manifest.count)]
    assert {name: names.count(name) for name in counts} == counts
    tenth = names[:400]
    for name, count in counts.items():
        assert abs(tenth.count(name) - count / 10) <= 1
    places = [order.place(i) for i in range(order.manifest.count) if names[i] == "ur3"]
    # T4, table I, and no frame twice.
    assert [sum(p.scene == k for p in places) for k in range(3)] == [211, 252, 463]
    assert len(set(places)) == 926


def test_counts_of_the_command_line() -> None:
    assert sum(counts_of([], "papers", "paper-like").values()) == 8700
    wild = counts_of([], "80", "wild")
    assert wild["none"] == wild["unknown"] == 50  # a tenth of 500
    with pytest.raises(UsageError, match="papers have no count"):
        counts_of(["none"], "papers", "wild")
    with pytest.raises(UsageError, match='expected a number or "papers"'):
        counts_of([], "many", "wild")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"counts": {"ur7": 1}}, 'unknown robot "ur7"'),
        ({"counts": {}}, "at least one robot"),
        ({"counts": {"ur5": 0}}, "at least one robot and one sample"),
        ({"size": (8, 8)}, "out of range"),
        ({"seed": -1}, "seed -1 is out of range"),
        ({"shard_size": 0}, "samples a shard"),
        ({"kind": "tame"}, 'no kind of set "tame"'),
    ],
)
def test_an_order_that_cannot_be_is_refused(change: dict[str, object], words: str) -> None:
    given = {"kind": "wild", "counts": {"ur5": 1}, "seed": 0, "size": (64, 53), "shard_size": 10}
    with pytest.raises(UsageError, match=words):
        make_order(**(given | change))
