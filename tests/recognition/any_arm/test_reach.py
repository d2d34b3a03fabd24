"""Who carries the camera is told how far an arm's reach is, and warned where that is not sure."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armsight.arrays import Floats
from armsight.cli import main
from armsight.recognition import opening
from armsight.recognition.any_arm.reach import UNKNOWN, UNSURE, reach_of, warning_of
from armsight.recognition.any_arm.sighting import Arm, Sighting
from armsight.recognition.opening import Shown
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import link_poses

from ..films import write_film


def arm_of(robot: str, T: Floats, covariance: Floats, *, trust: float = 0.9) -> Arm:
    known = load_robot(robot)
    places = (T @ link_poses(known, known.home))[1:, :3, 3]
    return Arm(
        robot, {robot: 1.0}, np.ones((4, 4), np.float32), T, known.home, places,
        np.tile(covariance, (known.n, 1, 1)), 0.9, trust, trust > 0.7, "",
    )  # fmt: skip


def before(distance: float) -> Floats:
    T = np.eye(4)
    T[:3, 3] = [0.0, 0.0, distance]
    return T


@pytest.mark.parametrize("robot", ["ur3", "ur5", "ur10", "iiwa", "panda"])
def test_no_flange_comes_nearer_than_is_said_and_some_nearly_as_near(robot: str) -> None:
    """Of random postures of the arm, turned to the camera from all sides."""
    known = load_robot(robot)
    rng = np.random.default_rng(0)
    low, high = (np.clip(x, -math.pi, math.pi) for x in (known.limits.lower, known.limits.upper))
    poses = [link_poses(known, rng.uniform(low, high)) for _ in range(3000)]
    flange = np.array([(T[-1] @ known.T_last_flange)[:3, 3] for T in poses])
    shoulder = np.array([T[2, :3, 3] for T in poses])
    far = np.linalg.norm(flange - shoulder, axis=1)
    T = before(2.2)
    arm = arm_of(robot, T, 1e-8 * np.eye(3))
    radius = float(np.linalg.norm(arm.joints[1])) - reach_of(arm).distance
    assert far.max() <= radius
    assert far.max() > 0.7 * radius


def test_the_deviation_is_that_along_the_ray() -> None:
    along = reach_of(arm_of("ur5", before(2.0), np.diag([1e-8, 1e-8, 0.04])))
    across = reach_of(arm_of("ur5", before(2.0), np.diag([0.04, 1e-8, 1e-8])))
    assert along.sigma == pytest.approx(0.2, rel=0.02)
    assert across.sigma < 0.02
    assert along.least == pytest.approx(along.distance - 0.4, rel=0.02)


def test_what_is_not_believed_is_farther_from_sure_and_what_is_hardly_a_guess_says_nothing() -> (
    None
):
    sure = arm_of("ur5", before(2.0), 1e-6 * np.eye(3))
    doubtful = reach_of(arm_of("ur5", before(2.0), 1e-6 * np.eye(3), trust=0.5))
    assert doubtful.sigma == pytest.approx(UNSURE, rel=1e-3)
    for nothing in (
        replace(sure, trust=0.1),
        replace(sure, T_camera_base=None),
        replace(sure, joints=np.empty((0, 3)), T_camera_base=None),
    ):
        reach = reach_of(nothing)
        assert math.isnan(reach.distance)
        assert reach.may_be_within
        assert reach.to_json() == {"distance_m": None, "sigma_m": None, "may_be_within": True}


def test_of_two_types_it_may_be_the_larger_counts() -> None:
    arm = arm_of("ur5", before(2.0), 1e-6 * np.eye(3))
    both = reach_of(replace(arm, alike=("ur10",)))
    larger = load_robot("ur10").stretched - load_robot("ur5").stretched
    assert both.distance == pytest.approx(reach_of(arm).distance - larger)


def test_who_is_near_is_warned_and_who_is_far_is_not() -> None:
    def warned(*arms: Arm) -> str:
        return warning_of(Sighting("a", arms, np.eye(3), np.zeros(5), "given", ()))

    far = arm_of("ur5", before(2.0), 1e-4 * np.eye(3))
    near = arm_of("ur10", before(1.5), 0.01 * np.eye(3))
    inside = arm_of("ur10", before(0.8), 1e-4 * np.eye(3))
    assert warned() == warned(far) == ""
    assert warned(far, near) == "ur10: you may be within its reach"
    assert warned(inside) == "ur10: you are within its reach"
    assert UNKNOWN.may_be_within


def test_a_video_says_when_it_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    film = tmp_path / "walk.avi"
    write_film(film, (np.full((48, 64, 3), 40 * k, np.uint8) for k in range(5)))
    warnings = iter(["", "ur5: near", "ur5: near", "", ""])

    def opened(*_: object) -> object:
        def look(picture: object, camera: object) -> Shown:
            nothing = np.zeros((48, 64, 3), np.uint8)
            return Shown(json.dumps({}), nothing, nothing[..., 0], next(warnings))

        return look

    monkeypatch.setattr(opening, "open_recogniser", opened)
    with pytest.raises(SystemExit) as ended:
        main(["recognise", str(film)])
    assert ended.value.code in (0, None)
    said = [line.partition(": ")[2] for line in capsys.readouterr().err.splitlines()]
    assert said == ["ur5: near", "no arm in sight may reach you"]
