"""The one family of errors that armsight raises for anything that came from outside."""

from __future__ import annotations


class ArmsightError(Exception):
    """Something from outside was wrong; the message is one line: what, where, and what to do.

    The command line prints the message alone and exits with ``exit_code``; a programmer's mistake
    raises the built-in errors instead and keeps its trace.
    """

    exit_code = 1


class UsageError(ArmsightError):
    """The command line or a call cannot be understood."""

    exit_code = 2


class WorkcellError(ArmsightError):
    """A workcell file is broken; names the file, the key, what was found and what is expected."""


class RobotError(ArmsightError):
    """A robot, a tool or its URDF is unknown or broken; names the file and the element."""


class DeviceError(ArmsightError):
    """A device is missing, dead, or says something that cannot be."""


class DeviceLostError(DeviceError):
    """A device is lost for good: nobody opens it again, and a run that needs it has to end."""


class RecordingError(ArmsightError):
    """A recording cannot be read or written."""


class DatasetError(ArmsightError):
    """A set of labelled pictures cannot be read, written or made; names the folder or file."""


class CalibrationError(ArmsightError):
    """A calibration cannot be made from what was seen; says what is missing or contradictory."""


class LoopError(ArmsightError):
    """A component of the running loop failed; the arm was stopped before this was raised."""


class CellBusyError(ArmsightError):
    """Another process is working with the same arm, or the same cell."""


class ViewerError(ArmsightError):
    """The page cannot be shown: its port is in use, or its address is none of this machine's."""


class RecognitionError(ArmsightError):
    """A network, its weights, its training or a picture given to it is not as it has to be."""


class TaskError(ArmsightError):
    """A task is unknown, broken, failed, or cannot run in this cell; names it and says why."""
