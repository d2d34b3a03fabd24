"""Recordings are what T4 to T7 say of theirs: counts, a camera that stands, joints that sweep."""

from itertools import groupby

import numpy as np
import pytest

from armsight.geometry.camera import PinholeCamera
from armsight.recognition.data.arms import catalogue_arm
from armsight.recognition.data.configuration import is_free
from armsight.recognition.data.crews import draw_batch
from armsight.recognition.data.framing import framed
from armsight.recognition.data.order import Order, counts_of, make_order
from armsight.recognition.data.recipe import PAPER_LIKE
from armsight.recognition.data.recording import IN_FRAME, LEAST_IN_FRAME, frames_of, record
from armsight.recognition.data.room import draw_room, draw_stand
from armsight.recognition.data.sample import KNOWN_ROBOTS

KINECT = PinholeCamera.from_fov(128, 106, np.deg2rad(70), np.deg2rad(60))


@pytest.mark.parametrize(
    ("robot", "count", "expected"),
    [
        ("ur3", 926, [211, 252, 463]),
        ("ur5", 2520, [252, 756, 1512]),
        ("ur10", 904, [112, 278, 514]),
        ("panda", 2513, [503, 503, 503, 502, 502]),
    ],
)
def test_frames_are_dealt_as_in_the_papers(robot: str, count: int, expected: list[int]) -> None:
    scene, frame, frames = frames_of(robot, count)
    assert frames.tolist() == expected
    for k, n in enumerate(expected):
        assert sorted(frame[scene == k]) == list(range(n))
    # The first tenth has a tenth of each.
    early = np.bincount(scene[: count // 10], minlength=len(expected))
    np.testing.assert_allclose(early, np.array(expected) / 10, atol=1.5)


@pytest.mark.parametrize("robot", KNOWN_ROBOTS)
def test_a_recording_sweeps_what_is_free_and_seen(robot: str) -> None:
    arm = catalogue_arm(robot)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        room = draw_room(PAPER_LIKE, rng)
        stand = draw_stand(PAPER_LIKE, room, rng)
        found = record(PAPER_LIKE, arm, room, stand, (128, 106), 60, rng)
        if found is not None:
            break
    assert found is not None
    assert found.q.shape == (60, arm.n)
    assert len(np.unique(found.q, axis=0)) == 60
    assert (found.q >= arm.lower).all()
    assert (found.q <= arm.upper).all()
    # A grid: few values of each joint, and every joint moves.
    values = [len(np.unique(q.round(9))) for q in found.q.T]
    assert max(values) <= 7
    assert sum(v > 1 for v in values) >= arm.n - 1
    for q in found.q:
        poses = stand.T_world_base @ arm.link_poses(q)
        assert is_free(arm, poses, stand.blocked)
        if found.view is not None:
            T = found.view.T_world_camera
            centers = arm.spheres(poses)
            assert framed(KINECT, T, centers, arm.sphere_radius)[0] >= LEAST_IN_FRAME
    assert (found.view is None) == (robot == "panda")
    if found.view is not None:
        T = found.view.T_world_camera
        assert framed(KINECT, T, found.centers, found.radii)[0] >= IN_FRAME
        away = np.linalg.norm(T[:3, 3] - stand.T_world_base[:3, 3])
        assert 1.2 <= away <= 2.5


def frames(order: Order, robot: str, scene: int) -> list[int]:
    mine = [i for i in range(order.manifest.count) if order.robot(i) == robot]
    return [i for i in mine if order.place(i).scene == scene]


def test_the_camera_stands_but_the_pandas(gl: str) -> None:
    counts = {"ur5": 20, "panda": 20}
    order = make_order("paper-like", counts, 7, (64, 53))
    for robot, still in (("ur5", True), ("panda", False)):
        drawn = draw_batch(order, frames(order, robot, 1)[:3])
        poses = [d.row.T_camera_base for d in drawn]
        assert len(poses) == 3
        same = [np.allclose(poses[0], T, atol=1e-12) for T in poses[1:]]
        assert same == [still, still]
        assert len({d.row.q.tobytes() for d in drawn}) == 3
        assert len({d.row.scene for d in drawn}) == 1


def test_a_sweep_is_the_same_whoever_asks_first(gl: str) -> None:
    order = make_order("paper-like", {"ur3": 30}, 3, (64, 53))
    some = frames(order, "ur3", 2)[:4]
    forwards = {i: draw_batch(order, [i])[0].row.q for i in some}
    from armsight.recognition.data import staging

    staging._recordings.clear()
    for i in reversed(some):
        np.testing.assert_array_equal(draw_batch(order, [i])[0].row.q, forwards[i])


def test_the_papers_set_has_their_recordings() -> None:
    order = make_order("paper-like", counts_of([], "papers", "paper-like"), 1, (64, 53))
    places = sorted((order.robot(i), order.place(i).scene) for i in range(order.manifest.count))
    found = {
        robot: len({scene for _, scene in group})
        for robot, group in groupby(places, key=lambda p: p[0])
    }
    assert found == {"ur3": 3, "ur5": 3, "ur10": 3, "iiwa": 14, "panda": 5}
