"""A hand-made arm and small cells; no mesh, no file, no camera unless a test asks for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.geometry.pose import from_rpy, look_at, make_pose
from armsight.geometry.shapes import Solid
from armsight.robots.robot import Capsules, JointLimits, Robot, Spheres
from armsight.simulation.spec import CameraSpec, PersonSpec


def make_robot() -> Robot:
    """Six joints with about the lengths and masses of a UR5, made of capsules."""
    half = np.pi / 2
    T = [
        from_rpy((0, 0, 0), (0, 0, 0.089)),
        from_rpy((0, half, 0), (0, 0.136, 0)),
        from_rpy((0, 0, 0), (0, -0.12, 0.425)),
        from_rpy((0, half, 0), (0, 0, 0.392)),
        from_rpy((0, 0, 0), (0, 0.093, 0)),
        from_rpy((0, 0, 0), (0, 0, 0.095)),
    ]
    y, z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    rows = [
        (0, (0, 0, 0.02), (0, 0, 0.06), 0.075),
        (1, (0, 0, 0), (0, 0.1, 0), 0.065),
        (2, (0, 0, 0), (0, 0, 0.425), 0.06),
        (3, (0, 0, 0), (0, 0, 0.39), 0.05),
        (4, (0, 0, 0), (0, 0.09, 0), 0.045),
        (5, (0, 0, 0), (0, 0, 0.09), 0.045),
        (6, (0, 0, 0), (0, 0.07, 0), 0.04),
    ]
    capsules = Capsules(
        np.array([r[0] for r in rows]),
        np.array([r[1] for r in rows], float),
        np.array([r[2] for r in rows], float),
        np.array([r[3] for r in rows]),
    )
    mass = np.array([4.0, 3.7, 8.4, 2.3, 1.2, 1.2, 0.25])
    return Robot(
        name="six",
        joint_names=tuple(f"joint_{i}" for i in range(6)),
        link_names=tuple(f"link_{i}" for i in range(7)),
        T_link_joint=np.array(T),
        axis=np.array([z, y, y, y, z, y]),
        T_last_flange=from_rpy((0, 0, half), (0, 0.082, 0)),
        limits=JointLimits(
            np.full(6, -2 * np.pi),
            np.full(6, 2 * np.pi),
            np.full(6, np.pi),
            np.full(6, 8.0),
            np.full(6, 80.0),
        ),
        spheres=Spheres(capsules.link, capsules.start, capsules.radius),
        capsules=capsules,
        self_pairs=np.zeros((0, 2), int),
        meshes=(),
        link_mass=mass,
        link_com=0.5 * (capsules.start + capsules.end),
        link_inertia=np.array([np.eye(3) * m * 0.01 for m in mass]),
        home=np.array([0.0, -half, half, -half, -half, 0.0]),
        reach=0.85,
    )


TABLE = Solid("table", "box", (1.0, 0.8, 0.05), make_pose(None, (0.2, 0.0, 0.7)))


def person(**changes: object) -> PersonSpec:
    """Someone who stands opposite the arm."""
    spec = PersonSpec("anna", "script", from_rpy((0, 0, np.pi), (1.2, 0, 0)))
    return replace(spec, **changes)  # type: ignore[arg-type]


def camera(
    model: str = "kinect_v2",
    eye: tuple[float, float, float] = (1.6, -1.2, 1.9),
    target: tuple[float, float, float] = (0.2, 0.0, 0.8),
    name: str = "cam",
    **changes: object,
) -> CameraSpec:
    """An ideal fixed camera, unless told otherwise."""
    from armsight.devices.camera_models import camera_info

    T = look_at(eye, target)
    spec = CameraSpec(camera_info(name, model, T_mount_camera=T), T, errors=False)
    return replace(spec, **changes)  # type: ignore[arg-type]
