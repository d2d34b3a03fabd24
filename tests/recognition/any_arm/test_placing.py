"""Cameras placed by single pictures of an arm whose joints are known."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from armsight.cli import run
from armsight.geometry.pose import inverse
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.any_arm.placing import guess_cameras, place_camera
from armsight.recognition.any_arm.recogniser import ArmRecogniser
from armsight.recognition.data import LabelledSet
from armsight.recognition.data.generate import generate
from armsight.recognition.data.order import make_order
from armsight.recognition.inference.model import network_file
from armsight.recognition.own_arm.answer import ColorView
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import link_poses


@pytest.fixture(scope="module")
def pictures(gl: str, tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    folder = tmp_path_factory.mktemp("placed") / "set"
    counts = {"ur5": 2, "iiwa": 2, "panda": 2}
    generate(make_order("wild", counts, 1201, (640, 480), 1000), folder)
    return LabelledSet.open(folder)


@pytest.fixture(scope="module")
def recogniser() -> ArmRecogniser:
    return ArmRecogniser(CropModel(network_file("arms"), 1))


def test_a_camera_is_placed_by_one_picture(
    pictures: LabelledSet, recogniser: ArmRecogniser
) -> None:
    errors = []
    for sample in pictures:
        robot = load_robot(sample.robot)
        found = place_camera(recogniser, sample.image, sample.camera, robot, sample.q)
        places = (inverse(found[0].T_base_camera) @ link_poses(robot, sample.q))[1:, :3, 3]
        errors.append(float(np.linalg.norm(places - sample.joints_camera, axis=1).mean()))
        assert 0.0 <= found[0].overlap <= 1.0
        weights = [p.overlap + p.landmarks for p in found]
        assert weights == sorted(weights, reverse=True)
    # A camera somewhere else before the arm is off by metres.
    assert np.median(errors) < 0.1


def test_pictures_guess_one_camera_each_and_only_of_an_arm_that_is_known(
    pictures: LabelledSet, recogniser: ArmRecogniser
) -> None:
    sample = pictures[0]
    robot = load_robot(sample.robot)
    blank = np.full_like(sample.image, 120)
    views = [ColorView(sample.q, sample.image), ColorView(sample.q, blank)]
    assert len(guess_cameras(recogniser, sample.camera, robot, views)) <= 1
    stranger = replace(robot, name="theirs")
    assert guess_cameras(recogniser, sample.camera, stranger, views) == []


def test_the_command_places_each_picture_and_draws_the_arm_there(
    pictures: LabelledSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sample = pictures[0]
    Image.fromarray(sample.image).save(tmp_path / "a.png")
    Image.fromarray(np.full_like(sample.image, 120)).save(tmp_path / "b.png")
    angles = ", ".join(f"{v:.4f}" for v in np.rad2deg(sample.q))
    (tmp_path / "joints.csv").write_text(f"a.png, {angles}\nb.png, {angles}\n")
    c = sample.camera
    words = ["--robot", sample.robot, "--joints", str(tmp_path / "joints.csv"), "--threads", "1"]
    lens = ["--intrinsics", f"{c.fx},{c.fy},{c.cx},{c.cy}"]
    out = ["--out", str(tmp_path / "placed")]
    assert run(["place", str(tmp_path), *words, *lens, *out]) == 1
    first, second = map(json.loads, capsys.readouterr().out.splitlines())
    assert np.array(first["T_base_camera"]).shape == (4, 4)
    assert first["believed"] == (first["problem"] is None)
    assert first["intrinsics"] == "given"
    assert (second["T_base_camera"], second["believed"]) == (None, False)
    assert Image.open(tmp_path / "placed" / "a.png.placed.png").size == (c.width, c.height)
    # Without a lens a distance is a guess, and two pictures do not tell what moves.
    assert run(["place", str(tmp_path / "a.png"), *words]) == 1
    told = json.loads(capsys.readouterr().out)
    assert not told["believed"]
    assert told["intrinsics"] == "assumed"
    assert run(["place", str(tmp_path), *words, *lens, "--standing"]) == 2
    assert "3 are needed" in capsys.readouterr().err
