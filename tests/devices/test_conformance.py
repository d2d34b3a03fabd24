"""The conformance kit finds nothing wrong with a good driver, and what is wrong with a bad one."""

from dataclasses import replace

import numpy as np
import pytest
from port_doubles import (
    LENS,
    ArmDouble,
    CameraDouble,
    GripperDouble,
    Log,
    StereoDouble,
    SwitchDouble,
    WrenchDouble,
    hang,
)

from armsight.commands.driver_check import check_driver, connection_of
from armsight.devices.conformance import conformance, failures
from armsight.devices.port import (
    ArmReading,
    ArmSettings,
    CameraSettings,
    GripperSettings,
    SwitchSettings,
    WrenchSettings,
)
from armsight.errors import DeviceError, UsageError

ARM = ArmSettings("double", {}, tuple("abcdef"), np.ones(6), np.ones(6), 250.0, 0.1)
GRIPPER = GripperSettings({}, 0.08, 0.1, 40.0)


class GoodArm(ArmDouble):
    """With a watchdog of its own, as an arm must have."""

    def __init__(self, settings, log=None, **kwargs):
        super().__init__(settings, log or Log(), **kwargs)
        self.heard = 0.0

    def command_velocity(self, velocity):
        super().command_velocity(velocity)
        self.heard = self.at

    def read(self):
        if self.at > self.heard + self.settings.watchdog:
            self.v = np.zeros(self.n)
        return super().read()


@pytest.mark.parametrize(
    ("kind", "opener", "settings"),
    [
        ("arm", GoodArm, ARM),
        ("camera", lambda s: CameraDouble(s, Log()), CameraSettings("c")),
        ("camera", lambda s: CameraDouble(s, Log(), waits=False), CameraSettings("c")),
        ("stereo", lambda s: StereoDouble(s, Log()), CameraSettings("c")),
        ("wrench", lambda s: WrenchDouble(s, Log()), WrenchSettings({}, 100.0)),
        ("gripper", lambda s: GripperDouble(s, Log()), GRIPPER),
        ("switch", lambda s: SwitchDouble(s, Log()), SwitchSettings({}, 20.0)),
    ],
)
def test_good_drivers_conform(kind, opener, settings):
    wrong = failures(kind, opener, settings, seconds=0.5, commands=True)
    assert [w for w in wrong if w.title != "rate"] == []  # its clock is that of a loaded machine


def test_looking_sends_no_command():
    log = Log()
    assert not failures("arm", lambda s: GoodArm(s, log), ARM, seconds=0.2)
    assert {call[0] for call in log.calls} == {"open", "close"}


def camera_that(change):
    return lambda s: CameraDouble(s, Log(), change=change)


class NoWatchdog(ArmDouble):
    def __init__(self, settings):
        super().__init__(settings, Log())


class Degrees(GoodArm):
    def read(self):
        r = super().read()
        return ArmReading(r.stamp, np.full(6, 90.0), r.velocity)


class Stuck(GoodArm):
    def command_velocity(self, velocity):
        pass


class ClosesOnce(CameraDouble):
    def __init__(self, settings):
        super().__init__(settings, Log())
        self.closed = False

    def close(self):
        if self.closed:
            raise OSError("bad descriptor")
        self.closed = True


class OpensOnce(CameraDouble):
    opened = 0

    def __init__(self, settings):
        OpensOnce.opened += 1
        if OpensOnce.opened % 2 == 0:
            raise DeviceError("device is busy")
        super().__init__(settings, Log())


class NoIntrinsics(CameraDouble):
    report = None

    def __init__(self, settings):
        super().__init__(settings, Log())


class BadLens(CameraDouble):
    report = replace(CameraDouble.report, depth=replace(LENS, fy=-1.0))

    def __init__(self, settings):
        super().__init__(settings, Log())


@pytest.mark.parametrize(
    ("kind", "opener", "settings", "title", "words"),
    [
        ("camera", lambda s: s.connection["serial"], CameraSettings("c"), "opens", "KeyError"),
        ("camera", NoIntrinsics, CameraSettings("c"), "reports", "NoneType"),
        ("camera", BadLens, CameraSettings("c"), "reports", "which cannot be"),
        (
            "camera",
            camera_that(lambda r: replace(r, depth=r.depth.T)),
            CameraSettings("c"),
            "values",
            "expected float32 metres of shape (24, 32)",
        ),
        (
            "camera",
            camera_that(lambda r: replace(r, depth=np.zeros_like(r.depth))),
            CameraSettings("c"),
            "values",
            "no pixel",
        ),
        (
            "camera",
            camera_that(lambda r: replace(r, stamp=1e3 * r.stamp)),
            CameraSettings("c"),
            "time",
            "are its stamps seconds",
        ),
        ("camera", camera_that(lambda r: None), CameraSettings("c"), "reads", "0 new readings"),
        ("camera", camera_that(lambda r: hang()), CameraSettings("c"), "reads", "has not returned"),
        ("camera", ClosesOnce, CameraSettings("c"), "closes twice", "bad descriptor"),
        ("camera", OpensOnce, CameraSettings("c"), "opens again", "device is busy"),
        ("arm", NoWatchdog, ARM, "watchdog", "goes on without commands"),
        ("arm", Degrees, ARM, "values", "expected radians"),
        ("arm", Stuck, ARM, "obeys", "+0.0000 rad"),
        (
            "gripper",
            lambda s: GripperDouble(replace(s, opening=80.0), Log()),
            GRIPPER,
            "values",
            "expected metres",
        ),
    ],
)
def test_what_is_wrong_is_found_and_nothing_hangs(kind, opener, settings, title, words):
    wrong = failures(kind, opener, settings, seconds=0.3, commands=True)
    assert title in [w.title for w in wrong]
    assert words in next(w for w in wrong if w.title == title).found
    assert all("\n" not in w.found for w in wrong)


def test_the_kit_goes_on_after_a_failure_and_ends():
    titles = [c.title for c in conformance("camera", BadLens, CameraSettings("c"), seconds=0.2)]
    assert titles[-1] == "opens again"


def test_the_command_prints_and_says_whether_all_is_well(capsys):
    assert check_driver("plugged_doubles:Camera", "camera", ["serial=7"], "ur5", 0.3, False) == 0
    told = capsys.readouterr().out
    assert "double 1: 32x24" in told
    assert check_driver("plugged_doubles:Arm", "arm", [], "ur5", 0.3, False) == 0
    assert "--move tries them" in capsys.readouterr().out


def test_options_are_a_connection():
    assert connection_of(["host=a=b", "port=70", "x=0.5", "fast=true"]) == {
        "host": "a=b",
        "port": 70,
        "x": 0.5,
        "fast": True,
    }
    with pytest.raises(UsageError, match="expected KEY=VALUE"):
        connection_of(["host"])
    with pytest.raises(UsageError, match="say of which --kind"):
        check_driver("plugged_doubles:Camera", None, [], "ur5", 0.3, False)


class Breaks(GoodArm):
    """Its readings break off while it is moved."""

    def read(self):
        if self.log.count("command") > 3:
            raise DeviceError("cable out")
        return super().read()


def test_an_arm_whose_readings_break_off_while_it_is_moved_is_stopped():
    log = Log()
    checks = conformance("arm", lambda s: Breaks(s, log), ARM, seconds=0.1, commands=True)
    found = {check.title: check for check in checks}
    assert not found["obeys"].good
    assert "cable out" in found["obeys"].found
    assert log.count("stop") == 1


def test_an_arm_that_was_being_moved_is_stopped_after_ctrl_c():
    log = Log()
    checks = conformance("arm", lambda s: GoodArm(s, log), ARM, seconds=0.1, commands=True)
    assert next(check for check in checks if check.title == "obeys").good
    checks.close()  # what an interrupt leaves of it
    assert log.calls[-1][0] == "stop"


def test_an_arm_whose_joints_are_wrong_is_not_moved():
    log = Log()

    class Wrong(GoodArm):
        def read(self):
            return replace(super().read(), position=np.full(6, 90.0))

    checks = conformance("arm", lambda s: Wrong(s, log), ARM, seconds=0.1, commands=True)
    found = {check.title: check for check in checks}
    assert "not moved" in found["obeys"].found
    assert log.count("command") == 0
