"""A swinging cable, a chain in MuJoCo, is the arm's own body; a hand beside it is not."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import JointState
from armsight.devices.history import JointHistory
from armsight.geometry.pose import make_pose
from armsight.geometry.shapes import Solid
from armsight.mapping.config import MappingConfig
from armsight.mapping.self_filter import SelfFilter, _along_z
from armsight.mapping.snapshot import OCCUPIED
from armsight.mapping.workspace_map import WorkspaceMap
from armsight.robots.cable import HungCable
from armsight.robots.held import holding
from armsight.robots.kinematics import flange_pose
from armsight.simulation.cable import CableChain
from armsight.simulation.spec import CableSpec

from . import scenes

PLUG = Solid("plug", "box", (0.20, 0.05, 0.05), make_pose(translation=(0.10, 0.0, 0.0)))
HANGER, LENGTH = (0.7, -0.7, 1.3), 1.4
BENDS = 0.3
CABLE = HungCable(HANGER, LENGTH, root=(-0.2, 0.0, 0.0), bending=BENDS)
TOOL = replace(
    holding(None, [PLUG]), T_flange_tcp=make_pose(translation=(0.20, 0.0, 0.0)), cable=CABLE
)
ARM = scenes.two_link_arm().with_tool(TOOL)
FLOOR = scenes.box("floor", (0.5, 0.0, -0.15), (3.0, 3.0, 0.1))
CAMERAS = [
    scenes.camera_info("left", (1.2, 1.2, 1.2), (0.7, -0.2, 0.5), (144, 120)),
    scenes.camera_info("right", (-0.3, -1.2, 1.2), (0.7, -0.3, 0.5), (144, 120)),
]
CONFIG = MappingConfig(
    (0.0, -0.9, 0.0), (1.3, 0.9, 1.1), far_lower=(0, 0, 0), far_upper=(0, 0, 0), align=False
)
PICTURES, BETWEEN = 22, 0.066


def joints_at(when):
    """It turns by 0.5 rad in a second, its end at 0.5 m/s at most, and stands."""
    s = np.clip(when - 0.3, 0.0, 1.0)
    return np.array([0.5 * (s - np.sin(2.0 * np.pi * s) / (2.0 * np.pi)), 0.0])


def root_at(when):
    return flange_pose(ARM, joints_at(when))[:3, 3]


def rods(points, radius):
    T = _along_z(points[:-1], points[1:], 0.0)
    long = np.linalg.norm(np.diff(points, axis=0), axis=1)
    middle = 0.5 * (points[:-1] + points[1:])
    return [
        Solid("rod", "cylinder", (radius, length, 0.0), make_pose(pose[:3, :3], at))
        for pose, at, length in zip(T, middle, long)
    ]


def maps(arm, bending=BENDS, hand=None):
    """(snapshot, (n, 3) what is seen that nothing explains, the cable's points) of each picture."""
    chain = CableChain(CableSpec(HANGER, LENGTH, bending=bending), root_at(0.0))
    chain.settle(1.0)
    history = JointHistory(10.0)
    for k in range(600):
        q = joints_at(0.005 * k)
        history.add(JointState(0.005 * k, q, (joints_at(0.005 * k + 1e-3) - q) / 1e-3))
    workspace = WorkspaceMap(arm, CAMERAS, [FLOOR], CONFIG)
    for k in range(PICTURES):
        stamp = BETWEEN * (k + 1)
        chain.follow(np.array([root_at(stamp - BETWEEN + 1e-3 * i) for i in range(1, 67)]))
        q = joints_at(stamp)
        T = flange_pose(ARM, q)
        cable = np.vstack([chain.joints, HANGER])
        solids = [
            FLOOR,
            *scenes.arm_solids(scenes.two_link_arm(), q),
            replace(PLUG, T_frame_solid=T @ PLUG.T_frame_solid),
            *rods(cable, CABLE.radius),
            *([] if hand is None else [hand(cable)]),
        ]
        frames = [
            scenes.frame(c, stamp, scenes.ray_cast(c.depth, c.T_mount_camera, solids), k)
            for c in CAMERAS
        ]
        snapshot = workspace.update(frames, history, stamp)
        assert all(camera.alive for camera in snapshot.cameras), snapshot.cameras
        grid = snapshot.grid
        seen = np.argwhere(snapshot.state == OCCUPIED) + 0.5
        centers = np.asarray(grid.origin) + grid.voxel * seen
        yield snapshot, centers[FLOOR.distance(centers) > 0.05], cable


def test_the_map_is_free_of_a_cable_that_swings():
    """By 15 cm off the curve in which it hangs still."""
    assert max(len(seen) for _, seen, _ in maps(ARM)) == 0


def test_a_cable_that_is_not_declared_is_somebody():
    bare = scenes.two_link_arm().with_tool(replace(TOOL, cable=None))
    assert max(len(seen) for _, seen, _ in maps(bare)) > 30


def test_a_cable_half_as_stiff_again_is_still_it():
    assert max(len(seen) for _, seen, _ in maps(ARM, 1.5 * BENDS)) < 4


@pytest.mark.parametrize("at", [6, 15])
def test_a_hand_10_cm_beside_it_is_seen(at):
    """Its skin from the cable's axis, a ball of 9 cm, carried along with the cable."""

    def hand(cable):
        along = cable[at + 1] - cable[at - 1]
        aside = np.cross(along / np.linalg.norm(along), [0.0, 0.0, 1.0])
        aside /= np.linalg.norm(aside)
        return scenes.sphere("hand", tuple(cable[at] + (0.10 + 0.045) * aside), 0.045)

    found = [(np.abs(hand(c).distance(s)) < 0.04).sum() for _, s, c in maps(ARM, hand=hand)]
    assert min(found[4:]) > 4


def test_pictures_out_of_order_and_a_clock_that_jumps_leave_a_cable_that_hangs():
    filter_ = SelfFilter(ARM)
    q, rest = joints_at(0.0), np.zeros(2)
    for stamp in (1.0, 1.05, 1.02, 9.0, 2.0):
        body = filter_.pose(q, rest, stamp=stamp)
        assert np.isfinite(body.corners).all()
    still = CABLE.still(root_at(0.0))
    own = body.corners[len(filter_.fields.offset) :].mean(axis=1)
    np.testing.assert_allclose(own, 0.5 * (still[1:] + still[:-1]), atol=0.01)
