"""The experiment on a set and a network whose figures are known beforehand."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from armsight.experiments import load_experiment
from armsight.experiments.frame import run_experiment, silent
from armsight.recognition.data import LabelledSet
from armsight.recognition.data.manifest import Manifest, shard_folder, write_manifest
from armsight.recognition.data.rows import Row, to_json
from armsight.recognition.networks.architecture import JOINTS
from armsight.recognition.training.packing import pack_in_memory

from .inference.conftest import BASE, network
from .inference.conftest import JOINTS as SAID

COUNT = 20


URS = ("ur3", "ur5", "ur10")


def write_set(
    folder: Path, off: float = 0.03, kind: str = "paper-like", robots: tuple[str, ...] = URS
) -> None:
    """Robots in a bright square, each with its joints ``off``, its base 40 mm beside the answer.

    Of ``none`` every fourth picture is as bright, the others are dark.
    """
    counts = dict.fromkeys(robots, COUNT)
    many = len(counts) * COUNT
    write_manifest(folder, Manifest(kind, "squares", 5, 128, 106, counts, 5, many))
    shard = shard_folder(folder, 0)
    (shard / "images").mkdir(parents=True)
    (shard / "links").mkdir()
    lines = []
    for i in range(many):
        robot = robots[i % len(robots)]
        dof = 0 if robot == "none" else JOINTS[robot]
        image = np.full((106, 128, 3), 30, np.uint8)
        links = np.zeros((106, 128), np.uint8)
        if robot != "none" or i // len(robots) % 4 == 0:
            image[40:60, 50:80] = 240
        if robot != "none":
            links[40:60, 50:80] = 1
        names = f"images/{i:06d}.png", f"links/{i:06d}.png"
        cv2.imwrite(str(shard / names[0]), image)
        cv2.imwrite(str(shard / names[1]), links)
        T = np.eye(4)
        T[:3, 3] = np.add(BASE, [0.04, 0, 0])
        joints = np.add(SAID, [0, off, 0])[:dof]
        K = np.array([[96.0, 0, 63.5], [0, 96.0, 52.5], [0, 0, 1]])
        row = Row(i, 5, i // (2 * len(robots)) % 5, robot, *names, 128, 106, K, np.zeros(5), T,
                  np.zeros(dof), joints, joints, joints[:, :2],
                  np.ones(len(joints), bool))  # fmt: skip
        lines.append(to_json(row))
    (shard / "labels.jsonl").write_text("\n".join(lines) + "\n")


def words(kind: str = "paper-like", split: str = "scene") -> dict[str, str]:
    from .inference.conftest import ARCHITECTURE, card

    architecture = {**ARCHITECTURE.to_json(), "robots": ["ur3", "iiwa"]}
    about = card() | {
        "data": {"kind": kind, "split": split, "training_samples": {"ur3": 7}},
        "training": {
            "stages": [{"name": "a", "updates": 1, "planned": 2, "batch": 3, "why": "updates"}],
            "images_seen": 3, "seconds": 120.0, "device": "a CPU", "threads": 1,
            "precision": "float32",
        },
    }  # fmt: skip
    return {
        "format": "armsight-network-1",
        "architecture": json.dumps(architecture),
        "card": json.dumps(about),
    }


def test_figures_that_are_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARMSIGHT_RECOGNITION", str(tmp_path))
    write_set(tmp_path / "sets" / "paper-like")
    (tmp_path / "runs" / "t5").mkdir(parents=True)
    (tmp_path / "runs" / "t5" / "network.onnx").write_bytes(network(words()))
    result = run_experiment(load_experiment("recognition"), 100, 0, silent)
    rows = {(r.key, r.condition): r for r in result.outcome.rows}
    seen = "trained on recordings; unseen scenes"
    assert rows["t5_joint_mean_mm", seen].value == pytest.approx(30.0, abs=1e-3)
    assert rows["t5_base_mean_mm", seen].value == pytest.approx(40.0, abs=1e-3)
    assert rows["t5_mask_iou", seen].value == 1.0
    assert rows["t5_mask_accuracy", seen].value == 100.0
    # It always says ur3; one robot in three is.
    third = rows["t5_type_accuracy", seen]
    assert third.value == pytest.approx(100 / 3)
    assert third.met is False
    assert rows["t5_add_auc", seen].value == pytest.approx(0.7)
    assert rows["t5_recognised", seen].value == pytest.approx(100 / 3)
    assert rows["t5_joint_error_mm", f"{seen}; joint 6"].value == pytest.approx(30.0, abs=1e-3)
    assert third.n == 3 * 4  # one of five scenes of 20 frames each
    # Every frame has the same joints, so each is known from any other.
    assert rows["t5_nearest_mm", f"{seen}; ur3, of 7"].value == pytest.approx(0.0, abs=1e-3)
    # What is not there misses its budget, and is named.
    assert rows["t4_joint_mean_mm", ""].met is False
    assert rows["t7_forgetting", ""].met is False
    notes = " ".join(result.outcome.notes)
    assert "runs/t4/network.onnx" in notes
    assert "sets/second-wild" in notes
    for draw in result.outcome.plots.values():
        assert draw().axes


@pytest.mark.parametrize(("off", "accurate"), [(0.03, True), (0.06, False)])
def test_time_and_forgetting_count_with_the_accuracy_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, off: float, accurate: bool
) -> None:
    monkeypatch.setenv("ARMSIGHT_RECOGNITION", str(tmp_path))
    monkeypatch.setattr("armsight.experiments.recognition._torch", lambda: False)
    write_set(tmp_path / "sets" / "paper-like", off, robots=(*URS, "iiwa", "panda"))
    for name in ("t5", "t6", "t7"):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / "network.onnx").write_bytes(network(words()))
    rows = run_experiment(load_experiment("recognition"), 100, 0, silent).outcome.rows
    by_key = {r.key: r for r in rows if r.key in ("t6_minutes", "t7_forgetting")}
    for row, value in zip(by_key.values(), (2.0, 0.0), strict=True):
        assert row.met is accurate
        assert row.value == value if accurate else np.isnan(row.value)
    # It calls everything ur3: right about none of the iiwas, so the type's budget is missed.
    types = {r.condition.split("; ")[-1]: r for r in rows if r.key == "t7_type_accuracy"}
    assert {name: row.met for name, row in types.items()} == {
        "UR": None, "KUKA": None, "Panda": None, "the worst of the three": False
    }  # fmt: skip
    assert types["the worst of the three"].value == 0.0
    # What was measured is said either way.
    shown = {r.key: r.value for r in rows if r.key in ("t6_training_minutes", "t7_worsening")}
    assert shown == {"t6_training_minutes": 2.0, "t7_worsening": 0.0}


def test_budgets_hold_in_unseen_scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A network of the papers' recordings is judged where it was not trained, as are the others."""
    monkeypatch.setenv("ARMSIGHT_RECOGNITION", str(tmp_path))
    monkeypatch.setattr("armsight.experiments.recognition._torch", lambda: False)
    write_set(tmp_path / "sets" / "paper-like", 0.01)
    write_set(tmp_path / "sets" / "paper-rooms", 0.08, "paper-rooms")
    for name, about in (
        ("t5", words("paper-like", "frame")),
        ("t5-rooms", words("paper-rooms", "scene")),
    ):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / "network.onnx").write_bytes(network(about))
    rows = run_experiment(load_experiment("recognition"), 100, 0, silent).outcome.rows
    errors = {
        r.condition: (r.n, round(r.value), r.met) for r in rows if r.key == "t5_joint_mean_mm"
    }
    assert errors == {
        "trained on recordings; frames of seen recordings": (12, 10, None),
        "trained on recordings; unseen scenes": (12, 80, False),
        "trained on rooms; unseen scenes": (12, 80, False),
        "trained on rooms; unseen recordings": (60, 10, None),
    }


def test_pictures_without_a_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of the empty pictures looks like a robot; every robot is seen."""
    monkeypatch.setenv("ARMSIGHT_RECOGNITION", str(tmp_path))
    monkeypatch.setattr("armsight.experiments.recognition._torch", lambda: False)
    write_set(tmp_path / "sets" / "wild", 0.05, "wild", ("ur3", "iiwa", "none"))
    (tmp_path / "runs" / "t7").mkdir(parents=True)
    (tmp_path / "runs" / "t7" / "network.onnx").write_bytes(network(words()))
    rows = run_experiment(load_experiment("recognition"), 100, 0, silent).outcome.rows
    found = {r.key: (r.condition, r.value, r.n) for r in rows if r.key.startswith("no_robot")}
    assert found == {
        "no_robot_said": ("trained on recordings; wild", 75.0, COUNT),
        "no_robot_wrongly": ("trained on recordings; wild", 0.0, 2 * COUNT),
    }
    errors = [r.value for r in rows if r.key == "t7_joint_mm"]
    assert errors == [pytest.approx(50.0, abs=1e-3)]


def test_without_anything_every_budget_is_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ARMSIGHT_RECOGNITION", str(tmp_path))
    monkeypatch.setattr("armsight.experiments.recognition._torch", lambda: False)
    result = run_experiment(load_experiment("recognition"), 5, 0, silent)
    assert all(r.met is not True for r in result.outcome.rows)
    keys = {r.key for r in result.missed}
    assert {
        "t4_mask_accuracy", "t4_joint_mean_mm", "t5_mask_accuracy", "t5_mask_iou",
        "t5_type_accuracy", "t5_joint_mean_mm", "t5_base_mean_mm", "t6_joint_median_mm",
        "t6_minutes", "t7_joint_median_mm", "t7_type_accuracy", "t7_forgetting", "t5_ms_cpu",
    } == keys  # fmt: skip


def test_packing_in_memory_keeps_the_labels(tmp_path: Path) -> None:
    write_set(tmp_path)
    source = LabelledSet.open(tmp_path)
    data = pack_in_memory(source, [4, 9], 64, 53)
    assert [data.robots[r] for r in data.robot] == [source.rows[4].robot, source.rows[9].robot]
    np.testing.assert_allclose(data.base[0], np.add(BASE, [0.04, 0, 0]), rtol=1e-6)
    assert data.masks(np.array([0])).sum() == 10 * 15


@pytest.mark.parametrize("wider", [1.0, 2.0])
def test_packing_through_a_networks_camera(tmp_path: Path, wider: float) -> None:
    """A lens twice as wide shows the square half as large, and where its rays say."""
    write_set(tmp_path)
    source = LabelledSet.open(tmp_path)
    plain = pack_in_memory(source, [4], 64, 53)
    K = plain.K[0].astype(float)
    K[[0, 1], [0, 1]] /= wider
    data = pack_in_memory(source, [4], 64, 53, K)
    np.testing.assert_allclose(data.K[0], K, rtol=1e-6)
    np.testing.assert_array_equal(data.joints, plain.joints)
    pixels = [np.argwhere(p.masks(np.array([0]))[0])[:, ::-1] for p in (plain, data)]
    rays = [(p.mean(axis=0) - q[:2, 2]) / np.diag(q)[:2] for p, q in zip(pixels, (plain.K[0], K))]
    np.testing.assert_allclose(rays[0], rays[1], atol=0.5 * wider / 48)
    assert len(pixels[1]) == pytest.approx(len(pixels[0]) / wider**2, rel=0.25)
    assert data.images[0][data.masks(np.array([0]))[0]].mean() > 200
