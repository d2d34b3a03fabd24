"""Ways round what is declared in a station's cell, and round the car where its port was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.arrays import JointVector
from armsight.charging.eye import SeenPort
from armsight.devices.history import JointHistory
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.mapping.workspace_map import WorkspaceMap
from armsight.motion.data import PlanRequest
from armsight.motion.intents import JointIntent, PoseIntent
from armsight.motion.permits import touching
from armsight.motion.permitted import Grant
from armsight.motion.plan import Plan
from armsight.robots.robot import Robot
from armsight.runtime.configure import guard_config, mapping_config
from armsight.runtime.parts import Recipe
from armsight.tasks.calibration_cell import unseen_is_empty
from armsight.tasks.parked_car import ParkedCarOnMap
from armsight.workcell.build import solids_in_base
from armsight.workcell.schema import Workcell

LIMIT = 0.3
"""Of a plan [s]."""


class StationWays:
    """The planner of a session over a map that nobody sees: what is not declared is free.

    Args:
        workcell: of the station.
        robot: its arm.
        car: what the station says of the car.
        seed: of the planner.
    """

    def __init__(self, workcell: Workcell, robot: Robot, car: ParkedCarOnMap, seed: int) -> None:
        mapping = mapping_config(workcell, workcell.robot.T_world_base, robot.reach)
        alone = replace(unseen_is_empty(mapping), threads=1)
        self._recipe = Recipe(
            robot, (), solids_in_base(workcell), alone, guard_config(workcell), LIMIT
        )
        self._planner = self._recipe.planner()
        self._car = car
        self._rng = np.random.default_rng((seed, 77))
        self._snapshot: WorkspaceSnapshot | None = None
        self._asked = 0

    def found(self, port: SeenPort, lid_open: bool) -> None:
        """The car stands where its port is, and the port's lid open or not."""
        before = self._car.standing.keys()
        self._car.found(port.T_base_port, port.covariance)
        self._car.lid(port.T_base_port if lid_open else None)
        if self._car.standing.keys() != before:
            self._snapshot = None

    def plan(
        self, intent: JointIntent | PoseIntent, joints: JointVector, granted: bool = True
    ) -> Plan:
        """A way from (n,) joints at rest [rad], or why there is none.

        Args:
            intent: where to.
            joints: from where.
            granted: the contact that it asks for, if any, is permitted.
        """
        if self._snapshot is None:
            self._snapshot = self._look()
        self._asked += 1
        permit, grant, around = intent.permit, None, self._snapshot
        if permit is not None and granted:
            grant = Grant(permit.region, touching(self._recipe.robot, permit))
            around = replace(around, stamp=permit.region.exposure)  # no picture has dated it
        request = PlanRequest(self._asked, joints, intent, grant=grant)
        return self._planner.plan(request, request.surroundings(around), LIMIT, self._rng)

    def _look(self) -> WorkspaceSnapshot:
        solids = (*self._recipe.static, *self._car.solids)
        workspace = WorkspaceMap(self._recipe.robot, (), solids, self._recipe.mapping)
        snapshot = workspace.update((), JointHistory(), 0.0)
        workspace.close()
        return snapshot
