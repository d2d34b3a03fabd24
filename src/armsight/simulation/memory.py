"""What of a simulated cell outlives the program that steps it: where arm, plug and car stand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from armsight.simulation.arm import SimulatedArm
from armsight.simulation.gl import mujoco
from armsight.simulation.gripper import SimulatedGripper
from armsight.simulation.lid import Lid
from armsight.simulation.parked_car import ParkedCar


class Memory:
    """Takes down where everything stands, and puts it there in another program's world.

    A program that is killed takes its simulation with it; a real arm would stand where its
    watchdog stopped it.

    Args:
        model, data: MuJoCo's; arm: its drives; car, lid, gripper: or None.
    """

    def __init__(
        self,
        model: Any,
        data: Any,
        arm: SimulatedArm,
        car: ParkedCar | None,
        lid: Lid | None = None,
        gripper: SimulatedGripper | None = None,
    ) -> None:
        self._model, self._data, self._arm, self._car = model, data, arm, car
        self._lid, self._gripper = lid, gripper

    def take(self) -> dict[str, list[Any]]:
        """Joints, what the drives hold, car, lid's latch and gripper, as JSON knows them."""
        kept = {
            "joints": self._data.qpos.tolist(),
            "reference": self._arm.reference_position.tolist(),
        }
        if self._car is not None:
            kept["car"] = self._car.T_world_socket.tolist()
        if self._lid is not None:
            kept["latch"] = list(self._lid.latch)
        if self._gripper is not None:
            kept["gripper"] = [self._gripper.stands]
        return kept

    def put(self, kept: Mapping[str, list[Any]]) -> None:
        """Everything stands where it stood, at rest; for an arm that nobody has commanded yet."""
        self._data.qpos[:] = kept["joints"]
        self._data.qvel[:] = 0.0
        self._arm.reference_position = np.asarray(kept["reference"], float)
        self._arm.reference_velocity = np.zeros(len(self._arm.reference_position))
        if self._car is not None:
            self._car.T_world_socket = np.asarray(kept["car"], float)
        if self._lid is not None:
            self._lid.latch = (bool(kept["latch"][0]), bool(kept["latch"][1]))
        if self._gripper is not None:
            self._gripper.stand(float(kept["gripper"][0]))
        mujoco.mj_forward(self._model, self._data)
