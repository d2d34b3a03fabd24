"""A tool that its mount has let give way: the arm's own body where the force sensor has it."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import Wrench
from armsight.geometry.pose import from_rpy, inverse, log, make_pose, transform
from armsight.geometry.shapes import Solid
from armsight.mapping.config import MappingConfig
from armsight.mapping.self_filter import SelfFilter
from armsight.mapping.snapshot import OCCUPIED
from armsight.mapping.workspace_map import WorkspaceMap
from armsight.robots.held import holding
from armsight.robots.kinematics import flange_pose
from armsight.robots.soft_mount import SoftMount

from . import scenes

PLUG = Solid("plug", "box", (0.20, 0.05, 0.05), make_pose(translation=(0.10, 0.0, 0.0)))
T_TIP = make_pose(translation=(0.20, 0.0, 0.0))
MOUNT = SoftMount((5000.0, 30.0), (150.0, 20.0))
TOOL = replace(holding(None, [PLUG]), T_flange_tcp=T_TIP, mount=MOUNT)
ARM = scenes.two_link_arm().with_tool(TOOL)
Q = np.zeros(2)
FLOOR = scenes.box("floor", (0.5, 0.0, -0.15), (3.0, 3.0, 0.1))
CAMERAS = [
    scenes.camera_info("left", (1.0, 1.0, 0.9), (0.8, 0.0, 0.3), (256, 212)),
    scenes.camera_info("right", (1.0, -1.0, 0.9), (0.8, 0.0, 0.3), (256, 212)),
]
CONFIG = MappingConfig(
    (0.3, -0.5, 0.0), (1.3, 0.5, 0.7), far_lower=(0, 0, 0), far_upper=(0, 0, 0), align=False
)


def load_of(force, torque):
    """(6,) at the flange of a force [N] and a torque [N m] on the tip, in the flange's axes."""
    force = np.array(force, float)
    return np.concatenate([force, np.array(torque) + np.cross(T_TIP[:3, 3], force)])


BENT = load_of((0.0, 0.0, -35.0), (0.0, 0.0, 4.5))
"""Turns the plug by 0.15 rad to the side and lets it sink by 7 mm: its root moves by 31 mm."""
NONE = np.zeros(6)


def plug_bent_by(wrench):
    """Where the plug truly is, in base."""
    T = flange_pose(ARM, Q) @ MOUNT.moved(T_TIP, wrench)
    return Solid("plug", "box", PLUG.size, T @ PLUG.T_frame_solid)


def seen(true, told, others=()):
    """(n, 3) occupied voxels that nothing declared fills; the plug is bent by ``true``.

    ``told`` is what the force sensor says of it, or None.
    """
    bare = scenes.two_link_arm()
    world = [FLOOR, *scenes.arm_solids(bare, Q), plug_bent_by(true), *others]
    history = scenes.resting(Q, 1.0)
    for k in range(500 if told is not None else 0):
        history.feel(Wrench(0.002 * k, told[:3], told[3:]))
    workspace = WorkspaceMap(ARM, CAMERAS, [FLOOR], CONFIG)
    for k in range(8):
        stamp = 0.1 + 0.1 * k
        frames = [
            scenes.frame(c, stamp, scenes.ray_cast(c.depth, c.T_mount_camera, world), k)
            for c in CAMERAS
        ]
        snapshot = workspace.update(frames, history, stamp)
    assert all(camera.alive for camera in snapshot.cameras), snapshot.cameras
    grid = snapshot.grid
    centers = np.asarray(grid.origin) + grid.voxel * (np.argwhere(snapshot.state == OCCUPIED) + 0.5)
    return centers[FLOOR.distance(centers) > 0.05]


def hand_beside(plug, way):
    """A hand (a ball of 9 cm) whose skin is 6 cm from the skin of the plug's root."""
    T = plug.T_frame_solid
    at = T[:3, 3] + T[:3, :3] @ (np.array([-0.06, 0.0, 0.0]) + 0.13 * np.asarray(way))
    return scenes.sphere("hand", tuple(at), 0.045)


def test_a_plug_that_is_bent_is_the_arm():
    assert len(seen(BENT, BENT)) == 0
    # Nobody knows how it hangs: it is where it was mounted, and what stands out may be a person.
    assert len(seen(BENT, None)) > 3
    assert len(seen(NONE, NONE)) == 0


@pytest.mark.parametrize("way", [(0, 1, 0), (0, -1, 0), (0, 0, 1)])
@pytest.mark.parametrize("told", [BENT, NONE, -BENT, 20.0 * BENT], ids=str)
def test_a_hand_beside_it_is_seen_whatever_the_sensor_says(way, told):
    plug = plug_bent_by(BENT)
    hand = hand_beside(plug, way)
    assert plug.distance(hand.T_frame_solid[None, :3, 3])[0] == pytest.approx(0.105, abs=1e-6)
    alone = len(seen(BENT, told))
    found = seen(BENT, told, (hand,))
    on_it = np.abs(hand.distance(found)) < 0.03
    assert on_it.sum() > 8
    assert len(found) > alone


def test_a_sensor_that_lies_hides_nothing_but_has_the_plug_itself_seen():
    for lie in (NONE, -BENT, 20.0 * BENT):
        found = seen(BENT, lie)
        assert len(found) > 3
        assert (plug_bent_by(BENT).distance(found) < 0.03).all()


def test_only_tool_and_held_give_way_and_no_farther_than_stated():
    filter_ = SelfFilter(ARM)
    gives = filter_.fields.gives
    assert gives.tolist() == [False, False, False, True]
    for wrench in (BENT, 100.0 * BENT):
        before, after = filter_.pose(Q, Q), filter_.pose(Q, Q, wrench)
        same = np.abs(after.T_cells_base - before.T_cells_base).max(axis=(1, 2)) < 1e-12
        assert same.tolist() == [True, True, True, False]
        moved = inverse(T_TIP) @ MOUNT.moved(T_TIP, wrench) @ T_TIP
        assert np.linalg.norm(log(moved)[:3]) <= 150.0 / 5000.0 + 1e-9
        assert np.linalg.norm(log(moved)[3:]) <= 20.0 / 30.0 + 1e-9
        T = flange_pose(ARM, Q)
        in_base = T @ MOUNT.moved(T_TIP, wrench) @ inverse(T)
        assert after.corners[3] == pytest.approx(transform(in_base, before.corners[3]))
        assert transform(after.T_cells_base[3], after.corners[3]) == pytest.approx(
            transform(before.T_cells_base[3], before.corners[3]), abs=1e-9
        )


def test_a_bolted_tool_stays_where_it_is():
    bolted = scenes.two_link_arm().with_tool(replace(TOOL, mount=None))
    filter_ = SelfFilter(bolted)
    assert not filter_.fields.gives.any()
    assert (filter_.pose(Q, Q, BENT).T_cells_base == filter_.pose(Q, Q).T_cells_base).all()


def test_the_tool_is_told_from_the_link_by_shape_alone():
    turned = replace(TOOL, held=(replace(PLUG, T_frame_solid=from_rpy((0, 0.3, 0), (0.1, 0, 0))),))
    assert SelfFilter(scenes.two_link_arm().with_tool(turned)).fields.gives.sum() == 1
