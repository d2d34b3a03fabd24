"""The guard's word and everybody's health as diagnostics, exact enough to be read back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from armsight.arrays import JointPath, JointVector, Vector3
from armsight.devices.line import DeviceHealth
from armsight.mapping.snapshot import CameraStatus
from armsight.motion.data import GuardMode, GuardStatus
from armsight.recording.permit_values import permit_from_values, permit_to_values
from armsight.runtime.view import ComponentHealth

Status = tuple[int, str, str, dict[str, str]]
"""Level (0 ok, 1 warn, 2 error, 3 stale), name, message, values: a DiagnosticStatus."""

GUARD = "guard"
_LEVELS = {GuardMode.SLOWED: 1, GuardMode.STOPPED: 2, GuardMode.REFLEX: 2}


def guard_to_status(status: GuardStatus) -> Status:
    """One tick of the guard; its paths travel as trajectories of their own."""
    values = {
        "stamp": repr(float(status.stamp)),
        "mode": status.mode.value,
        "goal": status.goal,
        "reached": str(status.reached),
        "command": _numbers(status.command),
        "speed_scale": repr(float(status.speed_scale)),
        "distance": repr(float(status.distance)),
        "protective_distance": repr(float(status.protective_distance)),
        "nearest_hazard": _numbers(status.nearest_hazard),
        "nearest_body": _numbers(status.nearest_body),
        "snapshot_sequence": str(status.snapshot_sequence),
        "snapshot_age": repr(float(status.snapshot_age)),
        "replans": str(status.replans),
        "reflexes": str(status.reflexes),
        "wanted": _numbers(status.wanted),
        "evidence_age": repr(float(status.evidence_age)),
    }
    values |= permit_to_values(status.permit)
    values |= {f"timing/{stage}": repr(float(seconds)) for stage, seconds in status.timings}
    return _LEVELS.get(status.mode, 0), GUARD, status.reason, values


def guard_from_status(
    message: str,
    values: Mapping[str, str],
    path: JointPath | None = None,
    executed: JointPath | None = None,
) -> GuardStatus | None:
    """The tick that :func:`guard_to_status` wrote; None if the values are not ours."""
    try:
        command = _vector(values["command"])
        return GuardStatus(
            stamp=float(values["stamp"]),
            mode=GuardMode(values["mode"]),
            reason=message,
            goal=values["goal"],
            reached=values["reached"] == "True",
            command=np.zeros(0) if command is None else command,
            speed_scale=float(values["speed_scale"]),
            distance=float(values["distance"]),
            protective_distance=float(values["protective_distance"]),
            nearest_hazard=_vector(values["nearest_hazard"]),
            nearest_body=_vector(values["nearest_body"]),
            path=path,
            executed=executed,
            snapshot_sequence=int(values["snapshot_sequence"]),
            snapshot_age=float(values["snapshot_age"]),
            replans=int(values["replans"]),
            reflexes=int(values["reflexes"]),
            permit=permit_from_values(values),
            wanted=_vector(values.get("wanted", "")),
            evidence_age=float(values.get("evidence_age", "nan")),
            timings=tuple(
                (key.removeprefix("timing/"), float(value))
                for key, value in values.items()
                if key.startswith("timing/")
            ),
        )
    except (KeyError, ValueError):
        return None


def health_to_statuses(
    components: Sequence[ComponentHealth],
    cameras: Sequence[CameraStatus],
    devices: Sequence[DeviceHealth] = (),
) -> list[Status]:
    """One status a component, a camera and a device behind a driver."""
    statuses: list[Status] = []
    for component in components:
        values = {
            "rounds": str(component.rounds),
            "missed": str(component.missed),
            "period_ms": f"{1e3 * component.period:.3f}",
            "median_ms": f"{1e3 * component.seconds[0]:.3f}",
            "p99_ms": f"{1e3 * component.seconds[1]:.3f}",
        }
        level = 2 if component.problem else 0
        statuses.append((level, f"component/{component.name}", component.problem, values))
    for camera in cameras:
        values = {
            "stamp": repr(float(camera.stamp)),
            "frames": str(camera.frames),
            "dropped": str(camera.dropped),
        }
        level = 0 if camera.alive else 2
        statuses.append((level, f"camera/{camera.name}", camera.reason, values))
    for device in devices:
        values = {
            "stage": device.stage,
            "readings": str(device.readings),
            "opened": str(device.opened),
            "clock_error_ms": f"{1e3 * device.clock_error:.3f}",
            "clock_drift_ppm": f"{1e6 * device.clock_drift:.1f}",
        }
        level = 0 if device.stage == "open" else 2
        statuses.append((level, f"device/{device.name}", device.reason, values))
    return statuses


def _numbers(values: JointVector | Vector3 | None) -> str:
    return "" if values is None else " ".join(repr(float(value)) for value in values)


def _vector(text: str) -> JointVector | None:
    return np.array([float(word) for word in text.split()]) if text else None
