"""An arm is as far away as its lens says: an answer through an unknown one is not believed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armsight.errors import RecognitionError
from armsight.geometry.camera import PinholeCamera
from armsight.recognition.any_arm.lens_doubt import DOUBT, doubted
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.any_arm.recogniser import ArmRecogniser
from armsight.recognition.any_arm.sighting import Arm, Intrinsics
from armsight.recognition.inference.model import Model
from armsight.recognition.inference.pictures import Picture
from armsight.recognition.inference.recogniser import Recogniser
from armsight.recognition.opening import open_recogniser

from ..inference.conftest import network as papers
from .test_bad_input import lamp
from .test_model import bright_card, bright_network


def arm_at(distance: float, trust: float = 0.95) -> Arm:
    T = np.eye(4)
    T[2, 3] = distance
    joints = np.array([[0.1, -0.2, distance - 0.2], [0.3, 0.1, distance + 0.2]])
    return Arm(
        "ur5", {"ur5": 1.0}, np.ones((4, 4), np.float32), T, np.zeros(2), joints,
        np.tile(1e-4 * np.eye(3), (2, 1, 1)), 0.9, trust, True, "",
    )  # fmt: skip


@pytest.mark.parametrize("source", ["exif", "assumed"])
def test_the_covariance_holds_what_another_focal_length_does(source: Intrinsics) -> None:
    """The same pixels through focal lengths drawn at random: x / z stays, z goes with f."""
    arm = arm_at(2.0)
    factor = 1.0 + DOUBT[source] * np.random.default_rng(0).normal(size=100_000)
    off = (arm.joints[0, 2] * (factor - 1.0)).var()
    found = doubted(arm, source, 0.85)
    grown = found.covariance - arm.covariance
    assert grown[0, 2, 2] == pytest.approx(off, rel=0.02)
    grown[:, 2, 2] = 0.0
    assert not grown.any()
    assert not found.believed
    assert "its lens is" in found.problem
    assert "95 % sure" in found.problem  # what is seen is not in doubt, how far away it is, is


def test_what_is_given_or_near_enough_is_believed() -> None:
    arm = arm_at(2.0)
    assert doubted(arm, "given", 0.85) is arm
    assert doubted(arm_at(0.6), "exif", 0.85).believed
    assert not doubted(arm_at(0.6), "assumed", 0.85).believed
    lost = replace(arm, believed=False, problem="I do not know")
    assert doubted(lost, "assumed", 0.85).problem == "I do not know"


@pytest.fixture
def sure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ArmRecogniser:
    """One that is sure of an arm 2 m away."""
    (tmp_path / "sure.onnx").write_bytes(bright_network(bright_card()))
    monkeypatch.setattr(ArmRecogniser, "_arms", lambda *_: [arm_at(2.0)])
    return ArmRecogniser(CropModel(tmp_path / "sure.onnx", 1))


def test_a_picture_without_a_lens_is_answered_but_not_believed(sure: ArmRecogniser) -> None:
    lens = PinholeCamera(160, 120, 125.0, 125.0, 79.5, 59.5)
    for picture, camera, source in (
        (Picture("lamp", lamp()), lens, "given"),
        (Picture("lamp", lamp(), camera=lens), lens, "exif"),
        (Picture("lamp", lamp()), None, "assumed"),
    ):
        found = sure.recognise(picture, camera)
        [arm] = found.arms
        assert found.intrinsics == source
        assert arm.T_camera_base is not None
        assert arm.trust == 0.95
        assert arm.believed == (source == "given")
        assert bool(arm.problem) == (not arm.believed)


def test_a_camera_of_another_size_is_refused(sure: ArmRecogniser, tmp_path: Path) -> None:
    lens = PinholeCamera(320, 240, 250.0, 250.0, 159.5, 119.5)
    (tmp_path / "papers.onnx").write_bytes(papers())
    looks = open_recogniser(tmp_path / "papers.onnx", 1)
    for ask in (sure.recognise, Recogniser(Model(tmp_path / "papers.onnx", 1)).recognise, looks):
        with pytest.raises(RecognitionError, match="320 x 240 px, this one has 160 x 120"):
            ask(Picture("lamp", lamp()), lens)
