"""Where a station may show its plug to the standing pair, drawn when it has to."""

from __future__ import annotations

import numpy as np

from armsight.arrays import JointPath, JointVector, Pose
from armsight.calibration.robot_errors import RobotErrors
from armsight.calibration.views import travel_seconds
from armsight.charging.calibrate import uncalibrated
from armsight.charging.plug_views import plug_views
from armsight.geometry.stereo import StereoPair
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.planner import PlannerConfig
from armsight.robots.robot import Robot
from armsight.tasks.room import Room

PLACES, SOME = 60, 3
"""Drawn, and kept."""
SPARE = 0.1
"""Beside less room than this the arm is slow [m]."""


class PlugPlaces:
    """Chooses places by the newest map.

    Args:
        robot: the arm, the plug its tool.
        pair: that looks.
        T_base_camera: its left lens.
        plug: type of the plug.

    Attributes:
        snapshot: the newest map; None until it knows what stands there.
    """

    def __init__(self, robot: Robot, pair: StereoPair, T_base_camera: Pose, plug: str) -> None:
        self._robot, self._pair, self._plug = robot, pair, plug
        self._T_base_camera = T_base_camera
        self._room = Room(robot)
        self._model = CollisionModel(robot).with_room(PlannerConfig().room)
        self._drawn: JointPath | None = None
        self.snapshot: WorkspaceSnapshot | None = None

    def __call__(self) -> tuple[JointVector, ...] | None:
        """Some (n,) joints that the guard lets the arm rest at, the soonest there first [rad].

        None until the map is there. It takes some tenths of a second, so nobody asks for it who
        need not know.
        """
        snapshot = self.snapshot
        if snapshot is None:
            return None
        if self._drawn is None:
            self._drawn = self._draw()
        self._room.snapshot = snapshot
        robot = self._robot
        room = np.array([self._room.left(q) for q in self._drawn])
        free = np.array([self._model.valid(q, snapshot, robot.home) for q in self._drawn], bool)
        good = np.flatnonzero(free & (room > 0.0))
        away = travel_seconds(robot, robot.home, self._drawn[good], 1.0, 1.0)
        order = np.lexsort((away, room[good] < SPARE))
        return tuple(self._drawn[good[k]] for k in order[:SOME])

    def _draw(self) -> JointPath:
        robot = self._robot
        assert robot.tool is not None
        T_tip = robot.tool.T_flange_tcp
        believed = uncalibrated(self._T_base_camera, T_tip, RobotErrors(robot))
        rng = np.random.default_rng(0)
        return plug_views(believed, robot, self._pair, self._plug, PLACES, rng)[0]
