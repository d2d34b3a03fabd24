"""The arm of a cell without an arm: no joints, no shape, nothing to filter from a depth image."""

from __future__ import annotations

import numpy as np

from armsight.robots.robot import Capsules, JointLimits, Robot, Spheres

NAME = "none"


def no_robot(frame: str = "base") -> Robot:
    """A robot of zero joints whose only link is ``frame``."""
    none = np.zeros(0)
    nowhere = np.zeros((0, 3))
    no_links = np.zeros(0, np.int64)
    # The self-filter wants a shape: a grain of sand where no camera looks.
    away = np.array([[0.0, 0.0, -1000.0]])
    grain = Capsules(np.zeros(1, np.int64), away, away, np.array([0.001]))
    return Robot(
        name=NAME,
        joint_names=(),
        link_names=(frame,),
        T_link_joint=np.zeros((0, 4, 4)),
        axis=nowhere,
        T_last_flange=np.eye(4),
        limits=JointLimits(none, none, none, none, none),
        spheres=Spheres(no_links, nowhere, none),
        capsules=grain,
        self_pairs=np.zeros((0, 2), np.int64),
        meshes=(),
        link_mass=np.zeros(1),
        link_com=np.zeros((1, 3)),
        link_inertia=np.zeros((1, 3, 3)),
        home=none,
        reach=0.0,
    )
