"""The end of a straw before a pair, against pictures of a capsule that are cast ray by ray."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import JointState, StereoFrame, StereoInfo
from armsight.experiments.servo_world import set_up
from armsight.geometry.pose import from_rpy, inverse, look_at, make_pose, transform
from armsight.motion.perception import PosedPair
from armsight.robots.kinematics import tcp_pose
from armsight.servoing.targets.straw_end import StrawEnd
from armsight.tasks.servo import STRAWS

from .traced import WRIST

ROBOT = set_up(cell="ur10_straw").robot
RADIUS, END, LEANS = STRAWS["straw_cup"]
END, AXIS = np.array(END), np.array([0.0, np.sin(LEANS), np.cos(LEANS)])
Q = np.array(ROBOT.home)
GREEN, CUP, YELLOW = (64, 166, 89), (242, 242, 242), (200, 170, 25)


def cast(lens, T_base_lens, end, tail, behind):
    """(h, w, 3) of a straw from ``tail`` to the middle of its round end, and its cup's lid."""
    T = inverse(T_base_lens)
    a, b = transform(T, np.stack([tail, end]))
    v, u = np.mgrid[0 : lens.height, 0 : lens.width].astype(float)
    rays = lens.normalise(np.stack([u, v], -1).reshape(-1, 2))
    rays = np.column_stack([rays, np.ones(len(rays))])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    # How near a ray comes to the axis: |ray x (a + s along)| is least where its derivative is 0.
    at, way = np.cross(rays, a), np.cross(rays, b - a)
    share = np.clip(-np.sum(at * way, axis=1) / np.sum(way * way, axis=1), 0.0, 1.0)
    gap = np.linalg.norm(at + share[:, None] * way, axis=1)
    image = np.tile(np.array(behind, float), (len(rays), 1))
    image[gap < RADIUS] = GREEN
    lid = np.linalg.norm(at, axis=1) < 0.005
    image[lid] = CUP
    image = image.reshape(lens.height, lens.width, 3)
    return np.clip(image, 0, 255).astype(np.uint8)


def seen(off, rng, behind=YELLOW):
    """What a pair shows whose arm says that the end is where it is not, by (3,) ``off`` [m]."""
    tool = tcp_pose(ROBOT, Q)
    end, tail = transform(tool, np.stack([END, END - 0.07 * AXIS]))
    eye = transform(tool, np.array([[-0.03, -0.11, -0.20]]))[0]
    left = look_at(tuple(eye), tuple(end), tuple(tool[:3, 1]))
    left = left @ from_rpy((0.05, -0.1, 0.3))
    apart = make_pose(None, (0.06, 0.0, 0.0))
    images = [
        np.clip(
            cast(WRIST, T, end + off, tail + off, behind).astype(float)
            + rng.normal(0, 2, (WRIST.height, WRIST.width, 3)), 0, 255,
        ).astype(np.uint8)
        for T in (left, left @ apart)
    ]  # fmt: skip
    info = StereoInfo("wrist", "traced", WRIST, WRIST, apart, "flange", np.eye(4), 10.0, 0.05)
    joints = JointState(1.0, Q, np.zeros(6))
    return PosedPair(StereoFrame("wrist", 0, 1.0, 1.05, *images), info, joints, left), end


def finder():
    return StrawEnd(ROBOT, END, AXIS, RADIUS)


@pytest.mark.parametrize("off", [(0.0, 0.0, 0.0), (0.003, -0.002, 0.004), (-0.004, 0.003, -0.002)])
@pytest.mark.parametrize("behind", [YELLOW, (60, 62, 66), (15, 15, 18)])
def test_the_end_is_where_it_is_and_not_where_the_joints_say(off, behind):
    view, end = seen(np.array(off), np.random.default_rng(0), behind)
    (mark,) = finder().in_pair(view)
    error = mark.position - end - np.array(off)
    assert np.linalg.norm(error) < 0.001
    sigma = np.sqrt(np.linalg.eigvalsh(mark.covariance))
    assert np.linalg.norm(error) < 3.0 * sigma[-1]


def test_a_straw_that_one_lens_does_not_show_is_none():
    view, _ = seen(np.zeros(3), np.random.default_rng(1))
    blank = np.full_like(view.frame.left, 120)
    assert finder().in_pair(replace(view, frame=replace(view.frame, right=blank))) == []
    assert finder().in_pair(replace(view, joints=None)) == []
    assert finder().in_pair(replace(view, T_base_camera=None)) == []


def test_what_is_green_and_no_straw_is_none():
    view, end = seen(np.zeros(3), np.random.default_rng(2))
    u, v = np.mgrid[0 : WRIST.width, 0 : WRIST.height].transpose(0, 2, 1)
    at = WRIST.project(transform(inverse(view.T_base_camera), end[None]))[0]
    leaf = view.frame.left.copy()
    leaf[np.hypot(u - at[0], v - at[1]) < 60] = GREEN
    assert finder().in_pair(replace(view, frame=replace(view.frame, left=leaf, right=leaf))) == []
