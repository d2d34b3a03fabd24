"""The hazards nearest to each part of the body, and how much of a motion separation allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Ints, JointVector, Points, Poses, Vector3
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.contact_kernels import turning_speeds
from armsight.motion.drive_kernels import fastest_point, stopping_times
from armsight.motion.hazard_kernels import Blocks, scan, sort_into_blocks
from armsight.motion.separation_kernels import Law
from armsight.robots.kernels import carried_motion_into, chain_poses, jacobian
from armsight.robots.robot import Robot

BLOCK = 0.16
"""Edge of a hazard block [m]; eight voxels of 2 cm."""
HORIZON = 3.0
"""Hazards farther away are not reported [m]."""


@dataclass(frozen=True)
class Hazards:
    """The hazards of one snapshot, ready for searching.

    Attributes:
        blocks: sorted; radius: half diagonal of a hazard's cube [m].
    """

    blocks: Blocks
    radius: float

    @classmethod
    def of(cls, snapshot: WorkspaceSnapshot) -> Hazards:
        """Sort a snapshot's hazards; not finite ones are left out by nobody: they are an error."""
        points = np.ascontiguousarray(snapshot.hazards, np.float32).reshape(-1, 3)
        return cls(sort_into_blocks(points, BLOCK), float(snapshot.hazard_radius))

    @classmethod
    def at(cls, points: Points, radius: float) -> Hazards:
        """Hazards from (h, 3) points [m]."""
        rows = np.ascontiguousarray(points, np.float32).reshape(-1, 3)
        return cls(sort_into_blocks(rows, BLOCK), radius)


@dataclass(frozen=True)
class SeparationView:
    """What one pose and motion of the body looks like to separation.

    Attributes:
        center: (m, 3) of the moving spheres in ``base`` [m]; velocity: (m, 3) [m/s].
        stopping: (m,) time until the sphere's link stands [s].
        distance: (m,) to the nearest hazard's surface [m]; inf if none.
        nearest: (m,) index into ``hazards.blocks.points``; -1 if none.
        share: (m,) share of the motion that is allowed; inf, or more than 2, if unlimited.
        limiting: (m,) index of the hazard that limits it.
        cable: share that the arm's cable leaves; inf where that limits nothing.
        cable_excess: by how much it closes in faster than allowed, at most [m/s].
        cable_hazard: index of the hazard that limits it; -1 if none.
    """

    center: Points
    velocity: Points
    stopping: Floats
    distance: Floats
    nearest: Ints
    share: Floats
    limiting: Ints
    cable: float = np.inf
    cable_excess: float = 0.0
    cable_hazard: int = -1

    @property
    def closest(self) -> int:
        """Sphere nearest to any hazard."""
        return int(np.argmin(self.distance))

    @property
    def least(self) -> float:
        """Least distance of any sphere [m]."""
        return float(self.distance.min())

    @property
    def allowed(self) -> float:
        """Share of the motion that every sphere and the cable allow, 0 or more."""
        return min(float(self.share.min()), self.cable)


class MovingBody:
    """The spheres of a robot that its joints can move.

    Attributes:
        moving: (k,) bool, which of ``Robot.spheres`` these are.
        shell: (m,) radius in which a sphere's matter is for certain [m]: a tool in a soft mount is
            bent out of its spheres by its weight and cable and by what it presses on, a tip on
            springs by what it touches.

    Raises:
        ValueError: the robot has no spheres, so nothing of it could be protected.
    """

    def __init__(self, robot: Robot, brake: JointVector) -> None:
        spheres = robot.spheres
        if len(spheres.radius) == 0:
            raise ValueError(
                f"{robot.name} has no link spheres: nothing of it could be protected; "
                "convert it with shapes (scripts/convert_robots.py) or use a catalogue robot"
            )
        moving = np.asarray(spheres.link) > 0
        self.robot = robot
        self.brake = np.ascontiguousarray(brake, float)
        self.moving = moving
        self.link = np.ascontiguousarray(np.asarray(spheres.link)[moving], np.int64)
        self.local = np.ascontiguousarray(np.asarray(spheres.center)[moving], float)
        self.radius = np.ascontiguousarray(np.asarray(spheres.radius)[moving], float)
        self.shell = self.radius + _sag(robot, None)[moving]

    def feel(self, load: Floats) -> None:
        """Note the (6,) load on a tool in a soft mount (:meth:`.SoftMount.load`) as it is now."""
        self.shell = self.radius + _sag(self.robot, load)[self.moving]

    def motion(self, q: JointVector, q_dot: JointVector) -> tuple[Points, Points]:
        """(m, 3) centres in ``base`` [m] and their velocities [m/s]."""
        robot, poses = self.robot, self.poses(q)
        center, velocity = np.empty_like(self.local), np.empty_like(self.local)
        rates = np.ascontiguousarray(q_dot, float)
        carried_motion_into(poses, robot.axis, self.link, self.local, rates, center, velocity)
        return center, velocity

    def poses(self, q: JointVector) -> Poses:
        """(n + 1, 4, 4) of the links in ``base`` at (n,) [rad]."""
        robot = self.robot
        q = np.ascontiguousarray(q, float)
        return np.asarray(chain_poses(q, robot.T_link_joint, robot.axis))

    def fastest(self, q: JointVector, q_dot: JointVector, velocity: Points) -> float:
        """No point of the body is faster than this [m/s]; (m, 3) velocities are the centres'."""
        rates = np.ascontiguousarray(q_dot, float)
        poses, axis = self.poses(q), self.robot.axis
        return float(fastest_point(poses, axis, self.link, self.radius, rates, velocity))

    def turning(self, q: JointVector, q_dot: JointVector) -> Floats:
        """(m,) how fast the link of each sphere turns [rad/s]."""
        out = np.empty(len(self.robot.axis) + 1)
        turning_speeds(self.poses(q), self.robot.axis, np.ascontiguousarray(q_dot, float), out)
        return np.asarray(out[self.link])

    def jacobian(self, q: JointVector, sphere: int) -> Points:
        """(6, n) Jacobian of a sphere's centre at (n,) [rad]: linear [m/rad], angular."""
        poses = self.poses(q)
        R, p = poses[self.link[sphere], :3, :3], poses[self.link[sphere], :3, 3]
        at = np.ascontiguousarray(R @ self.local[sphere] + p)
        return np.asarray(jacobian(poses, self.robot.axis, int(self.link[sphere]), at))

    def stopping(self, q_dot: JointVector) -> Floats:
        """(m,) time until each sphere stands when all joints brake [s]."""
        out = np.empty(len(self.radius))
        stopping_times(np.ascontiguousarray(q_dot, float), self.brake, self.link, out)
        return out

    def view(
        self, q: JointVector, q_dot: JointVector, hazards: Hazards, law: Law
    ) -> SeparationView:
        """What separation says of a motion (n,) [rad/s] at (n,) [rad].

        Args:
            q: joint positions.
            q_dot: joint velocities of the whole motion.
            hazards: to look at.
            law: numbers of the law.
        """
        center, velocity = self.motion(q, q_dot)
        m = len(self.radius)
        stopping = self.stopping(q_dot)
        fastest = self.fastest(q, q_dot, velocity)
        distance, share = np.empty((2, m))
        nearest, limiting = np.empty((2, m), np.int64)
        scan(
            hazards.blocks, center, self.shell, velocity, stopping, fastest, law, HORIZON,
            distance, nearest, share, limiting,
        )  # fmt: skip
        return SeparationView(center, velocity, stopping, distance, nearest, share, limiting)

    def pair(
        self, view: SeparationView, hazards: Hazards, sphere: int
    ) -> tuple[Vector3, Vector3] | None:
        """Surface points (body, hazard) in ``base`` of a sphere and its nearest hazard, or None."""
        index = int(view.nearest[sphere])
        if index < 0:
            return None
        center = view.center[sphere]
        hazard = hazards.blocks.points[index].astype(float)
        away = hazard - center
        length = float(np.linalg.norm(away))
        unit = away / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
        return center + self.shell[sphere] * unit, hazard


def _sag(robot: Robot, load: Floats | None) -> Floats:
    """(k,) how far each of ``Robot.spheres`` may hang beside where the joints put it [m]."""
    sag, tool = np.zeros(len(robot.spheres.radius)), robot.tool
    if tool is not None and tool.mount is not None:
        levers = np.linalg.norm(tool.spheres.center - tool.T_flange_tcp[:3, 3], axis=1)
        sag[len(sag) - len(levers) :] = tool.mount.sag(levers, load)
    if tool is not None and tool.tip is not None:  # what is pressed aside is beside its place
        sag[len(sag) - len(tool.spheres.radius) :] += tool.tip.travel
    return sag
