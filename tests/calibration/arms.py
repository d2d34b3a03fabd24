"""An arm for the tests that needs no catalogue: UR5 from the maker's table of lengths."""

import numpy as np

from armsight.geometry.pose import from_rpy, make_pose
from armsight.robots.robot import Capsules, JointLimits, Robot, Spheres


def ur5() -> Robot:
    y, z = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    half = np.pi / 2
    joints = np.array(
        [
            make_pose(None, (0, 0, 0.089159)),
            from_rpy((0, half, 0), (0, 0.13585, 0)),
            make_pose(None, (0, -0.1197, 0.425)),
            from_rpy((0, half, 0), (0, 0, 0.39225)),
            make_pose(None, (0, 0.093, 0)),
            make_pose(None, (0, 0, 0.09465)),
        ]
    )
    limit = np.full(6, 2 * np.pi)
    none = np.zeros(0, np.int64)
    empty = np.zeros((0, 3))
    return Robot(
        name="ur5",
        joint_names=("pan", "lift", "elbow", "wrist_1", "wrist_2", "wrist_3"),
        link_names=tuple(f"link_{i}" for i in range(7)),
        T_link_joint=joints,
        axis=np.array([z, y, y, y, z, y]),
        T_last_flange=from_rpy((-half, 0, 0), (0, 0.0823, 0)),
        limits=JointLimits(-limit, limit, np.full(6, np.pi), np.full(6, 8.0), np.full(6, 80.0)),
        spheres=Spheres(none, empty, np.zeros(0)),
        capsules=Capsules(none, empty, empty, np.zeros(0)),
        self_pairs=np.zeros((0, 2), np.int64),
        meshes=(),
        link_mass=np.ones(7),
        link_com=np.zeros((7, 3)),
        link_inertia=np.tile(np.eye(3), (7, 1, 1)),
        home=np.array([0.0, -1.6, 1.8, -1.8, -1.57, 0.0]),
        reach=0.85,
    )
