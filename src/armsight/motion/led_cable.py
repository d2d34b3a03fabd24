"""What plans know of a cable that the arm drags: it is led round what is there, not through it.

Its body is the guard's (:class:`~armsight.motion.hung_cable.DraggedCable`): the curve in which it
would hang still, wider by how far it sways. What is occupied counts, people and declared solids
alike; what nobody sees does not, since a hung cable hangs mostly there. At the start and at the
goal it may be as near to things as it has to be, and is no wider than that on the way: whether it
may hang at a goal at all is for those who choose the goal, and the guard slows it near people.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, JointVector, Points
from armsight.motion.body import aligned_chain, levers
from armsight.motion.cable_kernels import (
    CableWay,
    cable_centers,
    cable_touches,
    coarsened,
    room_about,
)
from armsight.motion.hung_cable import DraggedCable
from armsight.motion.kernels import Obstacles
from armsight.motion.trajectory import Trajectory
from armsight.robots.robot import Robot

COARSE = 3
"""Fine voxels along the edge of a coarse cube: 6 cm."""
CLOSER = 1e-6
"""Room that is left at start and goal [m]: rounding must not block what stands still."""
SAMPLE = 0.05
"""Between two looks at a motion [s]."""


class LedCable:
    """The cable of one robot as its planner takes it."""

    def __init__(self, robot: Robot, cable: DraggedCable) -> None:
        rotation, offset, turns = aligned_chain(robot)
        self._T_link_joint = np.array(robot.T_link_joint, float, order="C")
        self._axis = np.array(robot.axis, float, order="C")
        self._cable = cable
        self._lever = levers(robot.n, turns[-1].T @ cable.root, rotation, offset)
        self._solid: tuple[np.ndarray, np.ndarray] | None = None

    @classmethod
    def of(cls, robot: Robot) -> LedCable | None:
        """That of a robot whose tool has one."""
        cable = DraggedCable.of(robot)
        return None if cable is None else cls(robot, cable)

    def among(self, ob: Obstacles, *stays: JointVector) -> Obstacles:
        """The same obstacles with the cable among them, no wider than fits at (n,) positions."""
        cable = self._cable
        way = CableWay(
            self._T_link_joint,
            self._axis,
            cable.root,
            self._lever,
            cable.hanger,
            cable.length,
            cable.radius.copy(),
            np.array(ob.origin, float),
            COARSE * ob.voxel,
            self._coarse(ob),
        )
        for q in stays:
            room = _room(way, q)
            narrower = room < way.radius
            way.radius[narrower] = np.maximum(room[narrower] - CLOSER, 0.0)
        return ob._replace(cable=way)

    def _coarse(self, ob: Obstacles) -> np.ndarray:
        """Coarse cubes that hold something; several goals are planned to in one snapshot."""
        if self._solid is None or self._solid[0] is not ob.state:
            self._solid = ob.state, coarsened(ob.state, COARSE)
        return self._solid[1]


def _room(way: CableWay, q: JointVector) -> Floats:
    """(k,) distance of each sphere's middle from what is solid, at most its radius [m]."""
    centers = _centers(way, q)
    return np.array([room_about(way, c[0], c[1], c[2], r) for c, r in zip(centers, way.radius)])


def _centers(way: CableWay, q: JointVector) -> Points:
    centers = np.empty((len(way.radius), 3))
    cable_centers(way, np.ascontiguousarray(q, float), centers)
    return centers


def first_touch(way: CableWay, trajectory: Trajectory) -> float | None:
    """A time [s] at which the cable comes to something on a motion, or None; looked at in steps."""
    if len(way.radius) == 0:
        return None
    centers = np.empty((len(way.radius), 3))
    steps = max(int(np.ceil(trajectory.duration / SAMPLE)), 1)
    for t in np.linspace(0.0, trajectory.duration, steps + 1):
        if cable_touches(way, np.ascontiguousarray(trajectory.position(t), float), centers):
            return float(t)
    return None
