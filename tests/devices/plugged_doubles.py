"""The doubles as a cell file names them: ``driver = "plugged_doubles:Arm"``."""

from __future__ import annotations

import os

from port_doubles import (
    ArmDouble,
    CameraDouble,
    GripperDouble,
    Log,
    StereoDouble,
    SwitchDouble,
    WrenchDouble,
)

from armsight.errors import DeviceError

LOG = Log()
HOME = {"ur5": [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]}


class Arm(ArmDouble):
    """Stands at the UR5's home; hangs in what ``connection.hangs`` names."""

    def __init__(self, settings):
        hangs = [str(settings.connection.get("hangs", ""))]
        super().__init__(settings, LOG, hangs, len(settings.joint_names))
        self.q = self.q + HOME["ur5"]
        self.reads = 0

    def read(self):
        self.reads += 1
        later = self.settings.connection.get("hangs_later", "")
        if later and self.reads > 100:
            self.hangs.add(str(later))
        return super().read()

    def close(self):
        report = os.environ.get("PLUGGED_DOUBLES_REPORT")
        if report:
            with open(report, "w", encoding="utf-8") as file:
                file.write(f"{LOG.count('command')} {LOG.count('stop')}")
        super().close()


class Camera(CameraDouble):
    def __init__(self, settings):
        if settings.name == "dead":
            raise DeviceError("camera 'dead': not there")
        super().__init__(settings, LOG)


class Stereo(StereoDouble):
    def __init__(self, settings):
        super().__init__(settings, LOG)


class Switch(SwitchDouble):
    def __init__(self, settings):
        super().__init__(settings, LOG)


class Wrench(WrenchDouble):
    def __init__(self, settings):
        super().__init__(settings, LOG)


class Gripper(GripperDouble):
    def __init__(self, settings):
        super().__init__(settings, LOG)
