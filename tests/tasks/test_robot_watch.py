"""Arms that no driver announces are told from the cell's own, and from what is behind."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armsight.arrays import Floats, Points
from armsight.commands.running import RunOptions, run_session
from armsight.devices.camera_models import camera_info
from armsight.devices.data import JointState, RgbdFrame
from armsight.errors import UsageError
from armsight.geometry.pose import inverse, look_at, make_pose, transform
from armsight.geometry.shapes import Solid
from armsight.motion.perception import PosedFrame
from armsight.recognition.any_arm.sighting import Arm
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import link_poses, sphere_centers
from armsight.tasks.robot_watch import KEPT, RobotWatch
from armsight.workcell import open_cell, parse_workcell

UR5 = load_robot("ur5")
EYE = look_at([1.6, 0.0, 1.0], [0.2, 0.0, 0.3])
INFO = camera_info("front", "kinect_v2", "base", EYE)
WALL = Solid("wall", "box", (0.1, 6.0, 6.0), make_pose(None, [-1.2, 0.0, 0.0]))


def ball_rays(points: Points, centers: Points, radii: Floats) -> Floats:
    """(k,) nearest distance along rays from the eye to balls, by the quadratic equation."""
    eye = EYE[:3, 3]
    nearest = np.full(len(points), np.inf)
    for center, radius in zip(centers, radii):
        to = center - eye
        along = points @ to
        under = along**2 - (to @ to - radius**2)
        hit = (under > 0) & (along > 0)
        nearest[hit] = np.minimum(nearest[hit], (along - np.sqrt(np.maximum(under, 0)))[hit])
    return nearest


def picture(centers: Points, radii: Floats) -> Floats:
    """Depth picture of balls before a wall at x = -1.15."""
    lens = INFO.depth
    rays = np.concatenate([lens.rays.reshape(-1, 2), np.ones((lens.height * lens.width, 1))], 1)
    unit = rays / np.linalg.norm(rays, axis=1)[:, None]
    turned = unit @ EYE[:3, :3].T
    near = ball_rays(turned, centers, radii)
    wall = np.where(turned[:, 0] < 0, (-1.15 - EYE[0, 3]) / np.minimum(turned[:, 0], -1e-9), 99.0)
    depth = np.minimum(near, wall) * unit[:, 2]
    depth[depth > 8.0] = np.nan
    return depth.reshape(lens.height, lens.width).astype(np.float32)


def mask_of(centers: Points, radii: Floats) -> Floats:
    """Where the colour lens sees the balls, 4 px too wide all around."""
    lens = INFO.color
    assert lens is not None
    seen = transform(inverse(EYE @ INFO.T_depth_color), centers)
    y, x = np.mgrid[: lens.height, : lens.width]
    mask = np.zeros((lens.height, lens.width), np.float32)
    for (u, v), depth, radius in zip(lens.project(seen), seen[:, 2], radii):
        mask[(x - u) ** 2 + (y - v) ** 2 < (lens.fx * radius / depth + 4) ** 2] = 1.0
    return mask


def an_arm(robot: str, mask: Floats, T: Floats | None, share: float = 0.9) -> Arm:
    joints = np.empty((0, 3))
    if T is not None:
        known = load_robot(robot)
        joints = (T @ link_poses(known, known.home))[1:, :3, 3]
    return Arm(
        robot, {robot: share}, mask.astype(np.float32), T, np.zeros(len(joints)), joints,
        np.tile(1e-4 * np.eye(3), (len(joints), 1, 1)), 0.9, 0.9, T is not None, "",
    )  # fmt: skip


OWN = sphere_centers(UR5, UR5.home), UR5.spheres.radius
PANDA = load_robot("panda")
STANDS = make_pose(None, [0.1, 0.9, 0.0])
OTHER = transform(STANDS, sphere_centers(PANDA, PANDA.home)), PANDA.spheres.radius


def outside(points: Points) -> float:
    """How far points are from the other arm's balls, at most [m]."""
    gap = np.linalg.norm(points[:, None] - OTHER[0][None], axis=2) - OTHER[1]
    return float(gap.min(axis=1).max())


class Says:
    """A recogniser that says what it is told to."""

    def __init__(self, *arms: Arm) -> None:
        self.arms = arms

    def recognise(self, picture: Any, lens: Any) -> Any:
        return SimpleNamespace(arms=self.arms)


def frame(stamp: float = 0.0, color: bool = True, *, joints: bool = True) -> PosedFrame:
    lens = INFO.color
    assert lens is not None
    centers, radii = np.concatenate([OWN[0], OTHER[0]]), np.concatenate([OWN[1], OTHER[1]])
    image = np.zeros((lens.height, lens.width, 3), np.uint8) if color else None
    posed = JointState(stamp, UR5.home, np.zeros(6)) if joints else None
    shot = RgbdFrame("front", 0, stamp, stamp, picture(centers, radii), image)
    return PosedFrame(shot, INFO, posed, EYE, lens if color else None)


def watch(*arms: Arm) -> RobotWatch:
    return RobotWatch(UR5, [INFO], [WALL], Says(*arms))  # type: ignore[arg-type]


def test_another_arm_is_seen_where_it_is_and_the_own_one_is_none() -> None:
    T_color_base = inverse(EYE @ INFO.T_depth_color) @ STANDS
    own = an_arm("ur5", mask_of(*OWN), None)
    other = an_arm("panda", mask_of(*OTHER), T_color_base)
    seen = watch(own, other).update([frame()])
    assert seen is not None
    (robot,) = seen.robots
    assert robot.robot == "panda"
    assert outside(robot.points) < 0.03, "nothing of the wall, of the own arm, or of borders"
    assert robot.points[:, 2].max() - robot.points[:, 2].min() > 0.5
    np.testing.assert_allclose(robot.joints[0], STANDS[:3, 3], atol=1e-6)
    assert "panda near" in seen.warning


def test_two_arms_in_one_mask_leave_the_other_one() -> None:
    both = np.maximum(mask_of(*OWN), mask_of(*OTHER))
    own_pose = inverse(EYE @ INFO.T_depth_color)
    seen = watch(an_arm("ur5", both, own_pose, share=0.4)).update([frame()])
    assert seen is not None
    (robot,) = seen.robots
    assert robot.robot == "unknown"
    assert not len(robot.joints), "the pose is the own arm's"
    assert outside(robot.points) < 0.03


def test_without_joints_nobody_can_tell_which_is_the_own_arm() -> None:
    seen = watch(an_arm("panda", mask_of(*OTHER), None)).update([frame(joints=False)])
    assert seen is not None
    assert not seen.robots


def test_an_arm_is_remembered_for_a_while_and_keeps_its_type() -> None:
    looks = watch(an_arm("panda", mask_of(*OTHER), None))
    looks.update([frame(0.0)])
    looks._recogniser = Says(an_arm("panda", mask_of(*OTHER), None, share=0.3))  # type: ignore[assignment]
    again = looks.update([frame(4.0)])
    assert again is not None
    assert [r.robot for r in again.robots] == ["panda"]
    assert looks.update([frame(5.0, color=False)]) is again, "what was said stands"
    looks._recogniser = Says()  # type: ignore[assignment]
    still = looks.update([frame(4.0 + 0.9 * KEPT)])
    assert still is not None
    assert len(still.robots) == 1
    gone = looks.update([frame(4.0 + 1.1 * KEPT)])
    assert gone is not None
    assert not gone.robots
    looks.reset()
    assert looks.update([]) is None


def test_a_measured_hole_is_no_arm() -> None:
    """Infrared gives no return of it: no place, no arm."""
    posed = frame()
    hole = posed.frame.depth.copy()
    hole[:] = np.nan
    nothing = replace(posed, frame=replace(posed.frame, depth=hole))
    seen = watch(an_arm("panda", mask_of(*OTHER), None)).update([nothing])
    assert seen is not None
    assert not seen.robots


@pytest.mark.parametrize("share", [0.4, 0.9])
def test_what_is_hardly_a_type_is_unknown(share: float) -> None:
    seen = watch(an_arm("iiwa", mask_of(*OTHER), None, share)).update([frame()])
    assert seen is not None
    assert seen.robots[0].robot == ("iiwa" if share > 0.5 else "unknown")


def test_a_cell_whose_cameras_have_no_colour_says_so() -> None:
    text = """
    [cell]
    name = "c"
    [robot]
    model = "ur5"
    [[camera]]
    name = "c"
    model = "d435"
    mounted_on = "flange"
    position = [0.0, 0.0, 0.1]
    rpy_deg = [0.0, 0.0, 0.0]
    """
    with (
        open_cell(parse_workcell(text)) as cell,
        pytest.raises(UsageError, match="no fixed camera"),
    ):
        run_session(cell, None, RunOptions(seconds=0.1, page=None, watch_robots=True))
