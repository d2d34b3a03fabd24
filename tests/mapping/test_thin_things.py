"""A cable before the camera, with flying pixels: known as occupied, and never free."""

import numpy as np
import pytest

from armsight.devices.data import DepthNoise
from armsight.geometry.pose import make_pose
from armsight.geometry.shapes import Solid
from armsight.mapping.config import MappingConfig
from armsight.mapping.snapshot import FREE, OCCUPIED
from armsight.mapping.workspace_map import WorkspaceMap

from . import scenes

CONFIG = MappingConfig(lower=(-0.8, -0.8, -0.1), upper=(0.8, 0.8, 0.9), align=False)
TABLE = scenes.box("table", (0, 0, -0.05), (4.0, 4.0, 0.1))
KINECT = DepthNoise(1.5e-3, -0.5e-3, 0.3e-3)
Q = np.array([2.5, -0.3])
PERIOD = 1 / 15


@pytest.mark.parametrize(("diameter", "known"), [(0.02, 0.1), (0.01, 1.4), (0.005, np.inf)])
def test_a_cable_is_kept(diameter, known):
    """At 2 m a pixel is 5.5 mm wide. Once known a cable stays so, looked past by most pixels."""
    info = scenes.camera_info("a", (1.5, 1.05, 1.4), size=(512, 424), noise=KINECT, rate=15.0)
    robot = scenes.two_link_arm()
    cable = Solid(
        "cable", "cylinder", (diameter / 2, 0.5, 0), make_pose(translation=[0.4, 0, 0.35])
    )
    solids = [TABLE, *scenes.arm_solids(robot, Q), cable]
    depth = scenes.ray_cast(info.depth, info.T_mount_camera, solids)
    rng = np.random.default_rng(0)
    world = WorkspaceMap(robot, [info], [TABLE], CONFIG)
    for k in range(36):
        stamp = 0.1 + k * PERIOD
        frame = scenes.frame(info, stamp, scenes.with_borders(depth, KINECT, rng), k)
        snapshot = world.update([frame], scenes.resting(Q, until=3.0), stamp + 0.005)
        places = np.column_stack([np.full(20, 0.4), np.zeros(20), np.linspace(0.14, 0.56, 20)])
        around = [
            snapshot.state[i - 1 : i + 2, j - 1 : j + 2, z]
            for i, j, z in snapshot.grid.index(places)
        ]
        assert not any((states == FREE).all() for states in around)
        if k * PERIOD > known:
            assert all((states == OCCUPIED).any() for states in around)
