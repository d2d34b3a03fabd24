"""The page's table of what the devices say of themselves: the arm's mode, hand, drivers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armsight.devices.data import ArmStatus, GripperState, Wrench
from armsight.devices.line import DeviceHealth
from armsight.viewer.html import BAD, GOOD, table, table_row


def devices(readings: Sequence[Any], health: Sequence[DeviceHealth]) -> str:
    """The newest word of the arm, the force sensor and the gripper, and how drivers do."""
    rows = []
    for reading in readings:
        if isinstance(reading, ArmStatus):
            mode = reading.mode.replace("_", " ")
            color = GOOD if reading.obeys else BAD
            values = (mode, f"{100 * reading.speed:.0f} %")
            rows.append(table_row(color, "arm", values, reading.message))
        elif isinstance(reading, Wrench):
            force, torque = (float(np.linalg.norm(v)) for v in (reading.force, reading.torque))
            rows.append(table_row(GOOD, "force", (f"{force:.1f} N", f"{torque:.2f} N m"), ""))
        elif isinstance(reading, GripperState):
            word = "moves" if reading.moving else "holds" if reading.holding else "rests"
            values = (word, f"{1e3 * reading.width:.0f} mm")
            rows.append(table_row(GOOD, "gripper", values, ""))
    for device in health:
        color = GOOD if device.stage == "open" else BAD
        values = (device.stage, f"±{1e3 * device.clock_error:.1f} ms")
        rows.append(table_row(color, device.name, values, device.reason))
    return table(("device", "", ""), rows) if rows else ""
