"""Fixtures of the simulation's tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from simulation_cells import make_robot

from armsight.geometry.pose import make_pose
from armsight.robots.robot import Robot
from armsight.simulation.spec import ArmSpec, WorldSpec
from armsight.simulation.world import SimulatedWorld


@pytest.fixture(scope="session")
def robot() -> Robot:
    return make_robot()


@pytest.fixture
def arm_spec(robot: Robot) -> ArmSpec:
    return ArmSpec(robot, make_pose(None, (0, 0, 0.75)), robot.home)


@pytest.fixture
def cell(arm_spec: ArmSpec) -> Iterator[SimulatedWorld]:
    """The arm alone."""
    with SimulatedWorld(WorldSpec(arm_spec)) as world:
        yield world
