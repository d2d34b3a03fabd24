"""From a URDF file to a :class:`Robot`, for any serial arm with revolute joints."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from armsight.arrays import Floats, JointVector
from armsight.errors import RobotError
from armsight.robots.chain import Chain, fold_chain
from armsight.robots.robot import JointLimits, LinkMesh, Robot
from armsight.robots.shapes import BodyShapes
from armsight.robots.urdf import UrdfJoint, read_urdf

DEFAULT_ACCELERATION = 5.0
"""[rad/s^2] where nobody says otherwise: MoveIt's conservative value for Universal Robots' arms."""
DEFAULT_JERK = 100.0
"""[rad/s^3] where nobody says otherwise: full default acceleration after 50 ms."""
FASTEST = 30.0
"""[rad/s] No joint of a serial arm is faster: small industrial ones reach 25 at the last joint.
What a URDF says beyond it is degrees, or was put there because a number had to be."""
MOST_TURNS = 4
"""No joint turns farther each way: the last ones of industrial arms go 455 deg, some 720. What a
URDF says beyond it is degrees."""


def load_urdf(
    path: Path | str,
    *,
    name: str | None = None,
    base: str | None = None,
    flange: str | None = None,
    held: Mapping[str, float] | None = None,
    packages: Mapping[str, Path] | None = None,
    meshes: bool = True,
    velocity: Floats | float | None = None,
    acceleration: Floats | float = DEFAULT_ACCELERATION,
    jerk: Floats | float = DEFAULT_JERK,
    home: JointVector | None = None,
    reach: float | None = None,
    shapes: BodyShapes | None = None,
) -> Robot:
    """Load an arm from a URDF file.

    Spheres come from the file's collision geometry where that is spheres only, as in "spherized"
    URDFs; otherwise spheres and capsules are fitted to the visuals (or to the collision geometry of
    links without), which takes a minute or two.

    Args:
        path: of the URDF.
        name: of the robot; the URDF's own when None.
        base: link whose frame becomes ``base``; the root when None.
        flange: link whose frame is the flange, see :func:`~armsight.robots.chain.fold_chain`.
        held: values of moving joints off the chain, such as fingers [rad or m].
        packages: folders that ``package://NAME/`` stands for.
        meshes: whether the visual meshes are wanted; when False they need not exist.
        velocity: limits in place of the URDF's own [rad/s].
        acceleration: limits, which URDF does not know [rad/s^2].
        jerk: limits, which URDF does not know [rad/s^3].
        home: (n,) [rad]; the middle of the joints' ranges when None, or 0 where that is inside.
        reach: [m]; the stretched length from the second joint to the flange when None.
        shapes: ready-made shapes; fitted when None.

    Raises:
        RobotError: the file, its tree or a mesh is broken; the message names it.
    """
    urdf = read_urdf(Path(path), dict(packages or {}))
    chain = fold_chain(urdf, base, flange, held)
    limits = joint_limits(chain, urdf.path, velocity, acceleration, jerk)
    looks = link_meshes(chain, urdf.path) if meshes else ()
    if shapes is None:
        from armsight.robots.fitting import fit_chain

        shapes = fit_chain(chain, limits.lower, limits.upper)
    moving = chain.links[1:]
    bodies = [link.inertial for link in chain.links]
    robot = Robot(
        name=name or urdf.name,
        joint_names=tuple(link.joint.name for link in moving if link.joint),
        link_names=tuple(link.name for link in chain.links),
        T_link_joint=np.stack([link.T_parent_joint for link in moving]),
        axis=np.stack([link.joint.axis for link in moving if link.joint]),
        T_last_flange=chain.T_last_flange,
        limits=limits,
        spheres=shapes.spheres,
        capsules=shapes.capsules,
        self_pairs=shapes.self_pairs,
        meshes=looks,
        link_mass=np.array([body.mass for body in bodies]),
        link_com=np.stack([body.center for body in bodies]),
        link_inertia=np.stack([body.inertia for body in bodies]),
        home=_home(limits) if home is None else np.asarray(home, float),
        reach=0.0 if reach is None else reach,
        tool_pairs=shapes.tool_pairs,
    )
    return robot if reach is not None else replace(robot, reach=robot.stretched)


def joint_limits(
    chain: Chain,
    path: Path,
    velocity: Floats | float | None,
    acceleration: Floats | float,
    jerk: Floats | float,
) -> JointLimits:
    """The limits of a chain's joints; the arguments as of :func:`load_urdf`.

    Raises:
        RobotError: a limit is missing, is not above 0, or looks like degrees; names the joint.
    """
    joints = [link.joint for link in chain.links if link.joint is not None]
    n = len(joints)
    for joint in joints:
        if joint.kind != "continuous":
            _check_range(joint, path)
        if velocity is None:
            _check_speed(joint, path)
    own = np.array([j.velocity for j in joints])
    turn = 2.0 * math.pi  # a joint without end gets a turn each way
    endless = [joint.kind == "continuous" for joint in joints]
    return JointLimits(
        lower=np.array([-turn if e else j.lower for j, e in zip(joints, endless)]),
        upper=np.array([turn if e else j.upper for j, e in zip(joints, endless)]),
        velocity=own if velocity is None else _per_joint(velocity, n, "velocity"),
        acceleration=_per_joint(acceleration, n, "acceleration"),
        jerk=_per_joint(jerk, n, "jerk"),
        effort=np.array([j.effort for j in joints]),
    )


def _check_range(joint: UrdfJoint, path: Path) -> None:
    where, lower, upper = f'{path}: joint "{joint.name}"', joint.lower, joint.upper
    if math.isnan(lower):
        raise RobotError(f"{where}: has no <limit>; a revolute joint needs lower, upper, velocity")
    if not lower < upper:
        raise RobotError(f"{where} <limit>: lower {lower:g} is not below upper {upper:g}")
    if max(-lower, upper) > 2.0 * math.pi * MOST_TURNS:
        raise RobotError(
            f"{where} <limit>: {lower:g} to {upper:g} is more than {MOST_TURNS} turns each way; "
            "limits are in radians"
        )


def _check_speed(joint: UrdfJoint, path: Path) -> None:
    if not joint.velocity > 0.0:
        raise RobotError(
            f'{path}: joint "{joint.name}": <limit> needs velocity="..." above 0 rad/s; give it '
            f"there, or {_SPEED_OF_ONES_OWN}"
        )
    if joint.velocity > FASTEST:
        raise RobotError(
            f'{path}: joint "{joint.name}" <limit>: velocity {joint.velocity:g} rad/s is faster '
            f"than any arm's ({joint.velocity:g} deg/s would be "
            f"{math.radians(joint.velocity):.3g} rad/s); mend it, or {_SPEED_OF_ONES_OWN}"
        )


_SPEED_OF_ONES_OWN = "say the arm's own in its .toml: [limits] velocity = ... (rad/s)"


def _per_joint(value: Floats | float, n: int, what: str) -> JointVector:
    values = np.asarray(value, float)
    if values.ndim > 0 and values.shape != (n,):
        raise RobotError(f"{what}: {values.size} values were given for {n} joints")
    if not np.all(values > 0.0):
        raise RobotError(f"{what}: every value must be above 0, got {value}")
    return np.broadcast_to(values, (n,)).copy()


def link_meshes(chain: Chain, path: Path) -> tuple[LinkMesh, ...]:
    """The visual meshes of a chain.

    Raises:
        RobotError: a mesh is missing; names link and file.
    """
    found = []
    for i, link in enumerate(chain.links):
        for shape in link.visuals:
            if shape.kind != "mesh" or shape.path is None:
                continue
            if not shape.path.is_file():
                raise RobotError(
                    f'{path}: link "{link.name}" <visual>: mesh {shape.path} is missing; put it '
                    "there, or name the folder of its package under [packages] of the arm's .toml"
                )
            found.append(LinkMesh(i, shape.path, shape.color, shape.T_link_geometry, shape.size))
    return tuple(found)


def _home(limits: JointLimits) -> JointVector:
    inside = (limits.lower <= 0.0) & (limits.upper >= 0.0)
    return np.where(inside, 0.0, 0.5 * (limits.lower + limits.upper))
