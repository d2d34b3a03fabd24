"""A cable that the arm drags along: no part of it comes to anybody faster than harms nobody.

Its shape is the curve in which it would hang still from where the arm is, and its speed how fast
that curve moves with the joints. ``docs/guard.md`` says what that leaves out: how it swings.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from armsight.arrays import Floats, JointVector, Mask, Points, Vector3
from armsight.geometry.pose import transform
from armsight.motion.hazard_kernels import in_reach, scan
from armsight.motion.separation_kernels import Law
from armsight.robots.cable import PIECES, HungCable
from armsight.robots.cable_kernels import dragged
from armsight.robots.kernels import carried_motion_into, chain_poses
from armsight.robots.robot import Robot, Tool

if TYPE_CHECKING:
    from armsight.motion.nearest import Hazards, SeparationView

HARMLESS = 0.15
"""A cable slower than this hurts nobody [m/s]: all of 4.3 kg of it against a head (4.4 kg, 75 N/mm
at the face) is v sqrt(mu k) = 60 N, of 65 that ISO/TS 15066 allows (A.3.4, table A.2)."""
SWAYS = 0.10
"""A cable's middle is so far beside its curve, about, while it swings [m]."""


class DraggedCable:
    """The cable of one robot, as spheres that move with its joints.

    Attributes:
        root: (3,) where it leaves the tool, in the last link's frame [m].
        hanger: (3,) where it hangs, in ``base`` [m].
        length: from the tool to there [m].
        radius: (k,) of its spheres [m].
    """

    def __init__(self, robot: Robot, tool: Tool, cable: HungCable) -> None:
        T_last_tip = robot.T_last_flange @ tool.T_flange_tcp
        self._robot, self._cable = robot, cable
        self.hanger = np.array(cable.hanger, float)
        self.root: Vector3 = np.ascontiguousarray(transform(T_last_tip, np.array([cable.root]))[0])
        self.length = cable.length
        self._link = np.array([robot.n])
        self._mount = tool.mount
        self.feel(None)

    def feel(self, load: Floats | None) -> None:
        """Note the (6,) load on a tool in a soft mount, or None where nobody says."""
        cable, s = self._cable, (np.arange(PIECES) + 0.5) / PIECES
        lever = np.array([float(np.linalg.norm(cable.root))])
        sag = 0.0 if self._mount is None else float(self._mount.sag(lever, load)[0])
        aside = cable.radius + 4.0 * SWAYS * s * (1.0 - s) + sag * (1.0 - s)
        self.radius: Floats = np.hypot(aside, 0.5 * cable.length / PIECES)

    @classmethod
    def of(cls, robot: Robot) -> DraggedCable | None:
        """That of a robot whose tool has one."""
        tool = robot.tool
        return None if tool is None or tool.cable is None else cls(robot, tool, tool.cable)

    def motion(self, q: JointVector, q_dot: JointVector) -> tuple[Points, Points]:
        """(k, 3) centres of its spheres in ``base`` [m] and their velocities [m/s]."""
        robot = self._robot
        end, lead = np.empty((1, 3)), np.empty((1, 3))
        poses = chain_poses(np.ascontiguousarray(q, float), robot.T_link_joint, robot.axis)
        rates = np.ascontiguousarray(q_dot, float)
        carried_motion_into(poses, robot.axis, self._link, self.root[None], rates, end, lead)
        center, velocity = np.empty((PIECES, 3)), np.empty((PIECES, 3))
        dragged(end[0], lead[0], self.hanger, self.length, center, velocity)
        return center, velocity

    def limit(
        self,
        view: SeparationView,
        q: JointVector,
        motion: JointVector,
        stopping: float,
        hazards: Hazards,
        law: Law,
    ) -> SeparationView:
        """The view of a motion (n,) [rad/s] at (n,) [rad] with the cable in it.

        Args:
            view: without it.
            q: where the motion begins.
            motion: all of it.
            stopping: time until the arm stands [s].
            hazards: to look at.
            law: numbers of the law.
        """
        center, velocity = self.motion(q, motion)
        speed = np.linalg.norm(velocity, axis=1)
        fast = speed > HARMLESS
        if not fast.any():
            return view
        k = int(fast.sum())
        distance, share = np.empty((2, k))
        nearest, limiting = np.empty((2, k), np.int64)
        scan(
            hazards.blocks, center[fast], self.radius[fast], velocity[fast],
            np.full(k, stopping), float(speed.max()), law, 0.0, distance, nearest, share, limiting,
        )  # fmt: skip
        share = np.maximum(share, HARMLESS / speed[fast])
        worst = int(np.argmin(share))
        excess = float(np.max(speed[fast] * (1.0 - share), initial=0.0))
        return replace(
            view,
            cable=float(share[worst]),
            cable_excess=excess,
            cable_hazard=int(limiting[worst]),
        )

    def stops_in_time(
        self,
        stop: Floats,
        velocity: JointVector,
        until: float,
        times: Floats,
        hazards: Hazards,
        law: Law,
    ) -> bool:
        """Whether what of it is fast stands, or is slow, before anybody could be there.

        Args:
            stop: (p, n) joint positions in the course of a stop [rad].
            velocity: (n,) at its beginning [rad/s].
            until: when the arm stands [s].
            times: (p,) of the looks [s].
            hazards: as pictured.
            law: numbers of the law.
        """
        speed = np.linalg.norm(self.motion(stop[0], velocity)[1], axis=1)
        fast: Mask = speed > 1.02 * HARMLESS
        if not fast.any():
            return True
        still = np.zeros(len(velocity))
        places = np.asarray([self.motion(q, still)[0][fast] for q in stop], np.float64)
        # Slower than that it may be there.
        ends = np.asarray(until * (1.0 - HARMLESS / speed[fast]), np.float64)
        return in_reach(hazards.blocks, places, self.radius[fast], times, ends, law) < 0
