"""armsight: a robot arm that knows its surroundings.

Start with ``armsight --help`` or ``docs/index.md``. armsight is no certified safety function.

The names below are those that a program needs first; each is loaded when it is first used, so
``import armsight`` costs nothing. Everything else is imported from its room, such as
``armsight.motion.collision``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armsight.calibration.calibrate import Calibration
    from armsight.devices.data import JointState, RgbdFrame
    from armsight.errors import ArmsightError
    from armsight.geometry.camera import PinholeCamera
    from armsight.mapping.snapshot import WorkspaceSnapshot
    from armsight.mapping.workspace_map import WorkspaceMap
    from armsight.motion.data import GuardStatus
    from armsight.motion.guard import Guard
    from armsight.motion.guard_config import GuardConfig
    from armsight.motion.intents import JointIntent, PoseIntent, VelocityIntent
    from armsight.motion.permits import Permit, PermitRequest
    from armsight.motion.regions import Region
    from armsight.motion.task import Observation
    from armsight.recognition.any_arm.recogniser import ArmRecogniser
    from armsight.recording.recorder import Recorder
    from armsight.recording.replay import open_recording
    from armsight.robots import Robot, load_robot, load_urdf
    from armsight.runtime.session import Session
    from armsight.tasks.patrol import PatrolTask
    from armsight.viewer import LivePage
    from armsight.workcell import Cell, Workcell, load_workcell, open_cell
    from armsight.workcell.packaged import packaged

__version__ = "0.1.0"

__all__ = [
    "ArmRecogniser",
    "ArmsightError",
    "Calibration",
    "Cell",
    "Guard",
    "GuardConfig",
    "GuardStatus",
    "JointIntent",
    "JointState",
    "LivePage",
    "Observation",
    "PatrolTask",
    "Permit",
    "PermitRequest",
    "PinholeCamera",
    "PoseIntent",
    "Recorder",
    "Region",
    "RgbdFrame",
    "Robot",
    "Session",
    "VelocityIntent",
    "Workcell",
    "WorkspaceMap",
    "WorkspaceSnapshot",
    "__version__",
    "load_robot",
    "load_urdf",
    "load_workcell",
    "open_cell",
    "open_recording",
    "packaged",
]

_HOME = {
    "ArmRecogniser": "recognition.any_arm.recogniser",
    "ArmsightError": "errors",
    "Calibration": "calibration.calibrate",
    "Cell": "workcell",
    "Guard": "motion.guard",
    "GuardConfig": "motion.guard_config",
    "GuardStatus": "motion.data",
    "JointIntent": "motion.intents",
    "JointState": "devices.data",
    "LivePage": "viewer",
    "Observation": "motion.task",
    "Permit": "motion.permits",
    "PermitRequest": "motion.permits",
    "Region": "motion.regions",
    "PatrolTask": "tasks.patrol",
    "PinholeCamera": "geometry.camera",
    "PoseIntent": "motion.intents",
    "Recorder": "recording.recorder",
    "RgbdFrame": "devices.data",
    "Robot": "robots",
    "Session": "runtime.session",
    "VelocityIntent": "motion.intents",
    "Workcell": "workcell",
    "WorkspaceMap": "mapping.workspace_map",
    "WorkspaceSnapshot": "mapping.snapshot",
    "load_robot": "robots",
    "load_urdf": "robots",
    "load_workcell": "workcell",
    "open_cell": "workcell",
    "open_recording": "recording.replay",
    "packaged": "workcell.packaged",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
