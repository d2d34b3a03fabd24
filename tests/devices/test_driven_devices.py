"""Devices behind drivers: nothing that a driver does can hold up or fool who uses it."""

import threading
import time
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
    WrenchDouble,
)

from armsight.devices.clock import WallClock
from armsight.devices.conformance import conformance
from armsight.devices.data import DepthNoise, RgbdCameraInfo, StereoInfo
from armsight.devices.driven_arm import DrivenArm
from armsight.devices.driven_cameras import DrivenCamera, DrivenStereo
from armsight.devices.driven_hand import DrivenGripper, DrivenWrench
from armsight.devices.line import Line
from armsight.devices.port import (
    ArmSettings,
    CameraSettings,
    GripperSettings,
    WrenchSettings,
)
from armsight.errors import DeviceError, DeviceLostError
from armsight.geometry.pose import make_pose
from armsight.robots.robot import JointLimits

ONES = np.ones(6)
LIMITS = JointLimits(-3.0 * ONES, 3.0 * ONES, 2.0 * ONES, 5.0 * ONES, 50.0 * ONES)
SETTINGS = ArmSettings("double", {}, tuple("abcdef"), 1.0 * ONES, 5.0 * ONES, 250.0, 0.3)


def until(condition, seconds=20.0):
    """Wait for something that has to come; what it said at the end."""
    end = time.monotonic() + seconds
    while not (found := condition()) and time.monotonic() < end:
        time.sleep(0.002)
    return found


def raised(call, seconds=20.0):
    """The first error of a call that is repeated."""

    def attempt():
        try:
            call()
        except DeviceError as error:
            return error
        return None

    found = until(attempt, seconds)
    assert found is not None, "nothing was raised"
    return found


def make_arm(log=None, **kwargs):
    log = log or Log()
    made = []

    def opener(settings):
        made.append(ArmDouble(settings, log, **kwargs))
        return made[-1]

    arm = DrivenArm(SETTINGS, LIMITS, opener, WallClock())
    return arm, made, log


def make_camera(log=None, clock=None, **kwargs):
    log = log or Log()
    made = []

    def opener(settings):
        made.append(CameraDouble(settings, log, **kwargs))
        return made[-1]

    def describe(report):
        return RgbdCameraInfo(
            "c", report.model, report.depth, report.color, report.T_depth_color, "base",
            np.eye(4), report.rate, report.latency, report.range, report.noise,
        )  # fmt: skip

    camera = DrivenCamera(CameraSettings("c"), opener, describe, clock or WallClock())
    return camera, made, log


# --- arm -------------------------------------------------------------------------------------


def test_an_arm_is_read_commanded_stopped_and_closed():
    arm, _, log = make_arm()
    state = until(arm.read)
    assert state.position == pytest.approx(np.zeros(6), abs=1e-6)
    sent = arm.command_velocity(np.array([0.5, -0.1, 0, 0, 0, 0]))
    assert sent == pytest.approx([0.5, -0.1, 0, 0, 0, 0])
    assert until(lambda: arm.read().position[0] > 0.001)
    # as much too fast as the cell allows less: slowed as one
    assert arm.command_velocity(np.array([4.0, -2.0, 0, 0, 0, 0])) == pytest.approx(
        [1.0, -0.5, 0, 0, 0, 0]
    )
    arm.stop()
    assert log.calls[-1][0] == "stop"
    arm.close()
    arm.close()
    assert [call[0] for call in log.calls[-2:]] == ["stop", "close"]
    with pytest.raises(DeviceError, match="closed"):
        arm.read()


def test_the_stamps_of_an_arm_are_the_cells():
    clock = WallClock()
    log = Log()
    arm = DrivenArm(SETTINGS, LIMITS, lambda s: ArmDouble(s, log), clock)
    state = until(arm.read)
    assert -0.5 < clock.now() - state.stamp < 0.5
    assert arm.health().stage == "open"
    arm.close()


def test_an_arm_that_nobody_commanded_is_closed_without_a_stop():
    arm, _, log = make_arm()
    until(arm.read)
    arm.close()
    assert [call[0] for call in log.calls] == ["open", "close"]


@pytest.mark.parametrize("command", [np.full(6, np.nan), np.zeros(5), np.full(6, np.inf)])
def test_an_absurd_command_never_reaches_the_driver(command):
    arm, _, log = make_arm()
    with pytest.raises(DeviceError, match="6 finite numbers"):
        arm.command_velocity(command)
    assert log.count("command") == 0
    arm.close()


def test_a_command_that_is_not_renewed_is_stopped():
    arm, _, log = make_arm()
    arm.command_velocity(0.1 * ONES)
    assert until(lambda: log.count("stop"))
    stops = log.count("stop")
    time.sleep(0.05)
    assert log.count("stop") == stops  # told once
    arm.close()


class Gated(ArmDouble):
    """Its read, or its command, waits for somebody; ``here`` tells when it does."""

    def __init__(self, settings, log, gate):
        super().__init__(settings, log)
        self.gate, self.here, self.let = gate, threading.Event(), threading.Event()
        self.armed = False

    def wait(self, what):
        if self.armed and self.gate == what:
            self.here.set()
            self.let.wait(5.0)

    def read(self):
        self.wait("read")
        return super().read()

    def command_velocity(self, velocity):
        self.wait("command")
        super().command_velocity(velocity)


@pytest.mark.parametrize("gate", ["read", "command"])
def test_a_command_that_was_on_its_way_when_the_arm_was_stopped_does_not_move_it(gate):
    log, made = Log(), []
    opener = lambda s: made.append(Gated(s, log, gate)) or made[-1]  # noqa: E731
    arm = DrivenArm(SETTINGS, LIMITS, opener, WallClock())
    until(arm.read)
    driver, errors = made[0], []
    driver.armed = True

    def command():
        try:
            arm.command_velocity(0.1 * ONES)
        except DeviceError as error:
            errors.append(str(error))

    if gate == "read":
        assert driver.here.wait(5.0)
    thread = threading.Thread(target=command)
    thread.start()
    assert driver.here.wait(5.0)
    assert gate == "command" or until(lambda: arm._line._calls)
    arm.stop()
    driver.armed = False
    driver.let.set()
    thread.join(5.0)
    time.sleep(0.02)
    assert np.array_equal(driver.v, np.zeros(6))
    if gate == "read":
        assert "told to stop before" in errors[0]
        assert log.count("command") == 0
    else:
        assert [call[0] for call in log.calls[-2:]] == ["command", "stop"]
    assert arm.command_velocity(0.1 * ONES) == pytest.approx(0.1 * ONES)  # a new one is sent
    arm.close()


@pytest.mark.parametrize("said", ["fast", [1.0], np.full(6, np.nan), {"v": 1}, True])
def test_what_a_driver_cannot_have_sent_is_a_refusal(said):
    arm, made, _ = make_arm()
    made[0].command_velocity = lambda velocity: said
    with pytest.raises(DeviceError, match=r"says it sent .*expected 6 finite numbers or None"):
        arm.command_velocity(0.1 * ONES)
    assert until(arm.read) is not None
    arm.close()


@pytest.mark.parametrize("what", ["read", "command", "stop"])
def test_an_arm_that_hangs_is_lost_for_good_and_told_to_stop(what):
    arm, made, log = make_arm()
    until(arm.read)
    made[0].hangs.add(what)
    if what == "read":
        error = raised(arm.read)
    elif what == "command":
        error = raised(lambda: arm.command_velocity(0.1 * ONES))
    else:
        error = raised(arm.stop)
    name = {"read": "read()", "command": "command_velocity()", "stop": "stop()"}[what]
    assert f"arm double: {name} has not returned" in str(error)
    if what != "stop":
        assert isinstance(error, DeviceLostError)
        assert isinstance(raised(arm.read), DeviceLostError)
        arm.stop()
        arm.close()
    else:
        with pytest.raises(DeviceError, match="stop"):  # at once: nobody waits twice
            arm.close()
    assert log.count("stop") >= 1
    assert log.count("close") == 1


def test_an_arm_is_stopped_where_the_system_has_no_more_threads(monkeypatch):
    arm, _, log = make_arm()
    until(arm.read)

    def refuse(thread):
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", refuse)
        arm.stop()
    assert log.count("stop") == 1
    arm.close()


def test_an_arm_whose_close_hangs_says_so():
    arm, _, _ = make_arm(hangs=("close",))
    with pytest.raises(DeviceError, match=r"close\(\) has not returned"):
        arm.close()


def test_an_arm_that_does_not_open():
    with pytest.raises(DeviceError, match=r"opening failed .KeyError: 'host'."):
        DrivenArm(SETTINGS, LIMITS, lambda s: s.connection["host"], WallClock())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"shape": (7,)}, r"position has shape \(7,\), expected \(6,\)"),
        ({"q": np.array([0, 0, np.nan, 0, 0, 0])}, "is not finite"),
        ({"q": np.full(6, 57.3)}, "are its joints radians"),
        ({"q": np.full(6, 1.0)}, "jumped by 1 rad"),
        ({"lie": lambda t: 1e3 * t}, "lies about time"),
        ({"mode": None}, "its mode is None, expected one of running, ready"),
        ({"mode": ["running"]}, "its mode is .'running'., expected one of"),
        ({"mode": "RUNNING"}, "its mode is 'RUNNING', expected one of"),
        ({"speed": np.nan}, "its speed is nan, expected a share"),
        ({"effort": np.zeros(5)}, r"effort has shape \(5,\), expected \(6,\)"),
        ({"raises": DeviceError("arm double: cable out")}, "cable out"),
        ({"raises": ZeroDivisionError("oops")}, r"read\(\) failed .ZeroDivisionError: oops"),
    ],
)
def test_an_arm_that_says_what_cannot_be_is_lost(change, words):
    arm, made, _ = make_arm()
    until(arm.read)
    for name, value in change.items():
        setattr(made[0], name, value)
    error = raised(arm.read)
    assert isinstance(error, DeviceLostError)
    assert "\n" not in str(error)
    with pytest.raises(DeviceLostError, match=words):
        arm.read()
    arm.close()


def test_an_arm_with_nothing_new_is_lost():
    arm, made, _ = make_arm()
    until(arm.read)
    made[0].lie = lambda t: 7777.0
    assert "nothing new" in str(raised(arm.read))
    arm.close()


def test_a_refusal_is_no_loss_and_the_controllers_word_is_told():
    arm, made, _ = make_arm()
    until(arm.read)
    assert arm.status.obeys
    made[0].mode, made[0].message = "protective_stop", "joint 3 hit something"
    assert until(lambda: not arm.status.obeys)
    assert str(arm.status) == "protective stop: joint 3 hit something"
    with pytest.raises(DeviceError, match="refused: protective_stop"):
        arm.command_velocity(0.1 * ONES)
    made[0].mode, made[0].speed = "running", 0.5
    assert until(lambda: arm.status.speed == 0.5 and arm.status.obeys)
    assert arm.command_velocity(0.1 * ONES) == pytest.approx(0.1 * ONES)
    arm.close()


# --- cameras ---------------------------------------------------------------------------------


@pytest.mark.parametrize("waits", [True, False])
def test_a_camera_gives_its_newest_frame_once_cleaned_and_dated(waits):
    clock = WallClock()
    camera, _, _ = make_camera(clock=clock, waits=waits)
    frame = until(camera.read)
    assert frame.camera == "c"
    assert np.isnan(frame.depth[0, 0])
    assert frame.depth[1, 1] == 1.5
    assert frame.color is None
    assert frame.stamp <= frame.arrival <= clock.now()
    assert clock.now() - frame.stamp < 1.0
    camera.want_color(True)
    colored = until(lambda: (f := camera.read()) is not None and f.color is not None and f)
    assert colored.sequence > frame.sequence
    camera.close()


def test_infrared_comes_where_it_is_asked_for_and_checked(monkeypatch):
    """What a live calibration finds the board in."""
    monkeypatch.setattr(CameraDouble, "report", replace(CameraDouble.report, infrared_scale=2))
    camera, made, _ = make_camera()
    assert until(camera.read).infrared is None
    camera.want_infrared(True)
    seen = until(lambda: (f := camera.read()) is not None and f.infrared is not None and f)
    assert seen.infrared.shape == (48, 64)
    made[0].change = lambda r: replace(r, infrared=np.zeros((24, 32), np.uint8))
    assert r"expected uint8 of shape (48, 64)" in str(raised(camera.read))
    camera.close()
    monkeypatch.setattr(CameraDouble, "report", replace(CameraDouble.report, infrared_scale=0))
    camera, made, _ = make_camera()
    camera.want_infrared(True)
    assert "reports an infrared_scale of 0" in str(raised(camera.read))
    camera.close()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda r: replace(r, depth=r.depth[:-1]), r"shape \(23, 32\), expected float32 metres"),
        (lambda r: replace(r, depth=r.depth.astype(np.uint16)), "depth is uint16"),
        (lambda r: replace(r, depth=r.depth * 1000), "looks like millimetres"),
        (lambda r: replace(r, stamp=np.inf), "lies about time"),
        (lambda r: replace(r, stamp=1e3 * r.stamp), "are its stamps seconds"),
    ],
)
def test_a_camera_that_delivers_nonsense_is_lost_with_its_reason(change, words):
    camera, made, _ = make_camera()
    until(camera.read)
    made[0].change = change
    error = raised(camera.read)
    assert not isinstance(error, DeviceLostError)
    assert "\n" not in str(error)
    with pytest.raises(DeviceError, match=words):
        camera.read()
    camera.close()


@pytest.mark.parametrize("how", ["raises", "hangs", "silent"])
def test_a_lost_camera_is_opened_again(how):
    camera, made, log = make_camera()
    until(camera.read)
    if how == "raises":
        made[0].raises = DeviceError("camera 'c': unplugged")
    elif how == "hangs":
        made[0].hangs.add("read")
    else:
        made[0].change = lambda reading: None
    words = {"raises": "unplugged", "hangs": "has not returned", "silent": "nothing new"}[how]
    assert words in str(raised(camera.read))
    assert camera.health().stage == "lost"
    assert words in camera.health().reason

    def again():
        try:
            return camera.read()
        except DeviceError:
            return None

    assert until(again) is not None
    assert camera.health().stage == "open"
    assert camera.health().opened == 2
    assert log.count("close") == 1
    camera.close()


def test_another_camera_than_before_is_refused():
    camera, made, _ = make_camera()
    until(camera.read)
    CameraDouble.report = replace(CameraDouble.report, depth=replace(LENS, fx=31.0))
    try:
        made[0].raises = DeviceError("camera 'c': unplugged")
        assert until(lambda: "other intrinsics" in str(raised(camera.read)))
    finally:
        CameraDouble.report = replace(CameraDouble.report, depth=LENS)
    camera.close()


@pytest.mark.parametrize(
    "report",
    [
        replace(CameraDouble.report, depth=replace(LENS, fx=np.nan)),
        replace(CameraDouble.report, depth=replace(LENS, width=0)),
        replace(CameraDouble.report, range=(4.0, 0.2)),
        replace(CameraDouble.report, rate=0.0),
        replace(CameraDouble.report, infrared_scale=9),
        replace(CameraDouble.report, noise=DepthNoise(np.nan, 0.0, 0.0)),
        replace(CameraDouble.report, noise=DepthNoise(0.001, -0.01, 0.0)),
        replace(CameraDouble.report, T_depth_color=np.full((4, 4), np.nan)),
        replace(CameraDouble.report, T_depth_color=(0.1, 0.0, 0.0)),
        replace(CameraDouble.report, depth=replace(LENS, distortion=np.zeros((1, 5)))),
    ],
)
def test_a_report_that_cannot_be_is_refused_at_the_start(report, monkeypatch):
    monkeypatch.setattr(CameraDouble, "report", report)
    with pytest.raises(DeviceError, match="camera 'c': its driver reports"):
        make_camera()


def test_a_device_whose_driver_hangs_every_time_is_given_up():
    gone = threading.Event()

    class Hangs:
        def close(self):
            pass

    line = Line("sensor", Hangs, lambda d: gone.wait(60.0), deadline=0.02, reopen=True)
    line.wait_open()
    assert until(lambda: "given up" in str(raised(line.check)), 30.0)
    gone.set()
    line.close()


# --- pair, force sensor, gripper ----------------------------------------------------------------


def test_a_stereo_pair_delivers_when_it_is_wanted():
    def describe(r):
        return StereoInfo("p", r.model, r.left, r.right, r.T_left_right, "flange", np.eye(4), 20.0, 0.0)  # fmt: skip  # noqa: E501

    pair = DrivenStereo(
        CameraSettings("p"), lambda s: StereoDouble(s, Log()), describe, WallClock()
    )
    time.sleep(0.1)
    assert pair.read() is None
    pair.want_pictures(True)
    frame = until(pair.read)
    assert (frame.camera, frame.left[0, 0, 0], frame.right[0, 0, 0]) == ("p", 9, 10)
    pair.close()


@pytest.mark.parametrize(
    ("T", "words"),
    [
        (make_pose(None, (-0.06, 0.0, 0.0)), "are the lenses swapped, or the pose inverted"),
        (make_pose(None, (60.0, 0.0, 0.0)), "lenses 60 m apart; expected metres"),
        (np.eye(4), "lenses 0 m apart"),
        (np.full((4, 4), np.nan), "no 4 x 4 pose"),
        (None, "no 4 x 4 pose"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "no rotation"),
    ],
)
def test_a_pair_whose_lenses_cannot_stand_so_is_refused(T, words):
    """Swapped lenses, millimetres: triangulation would say something wrong of every target."""

    class Odd(StereoDouble):
        report = replace(StereoDouble.report, T_left_right=T)

    settings = CameraSettings("p")
    with pytest.raises(DeviceError, match=words):
        DrivenStereo(settings, lambda s: Odd(s, Log()), lambda r: None, WallClock())
    checks = conformance("stereo", lambda s: Odd(s, Log()), settings)
    said = next(check for check in checks if check.title == "reports")
    assert not said.good
    assert words in said.found


def test_a_force_sensor_and_what_it_cannot_feel():
    made = []
    sensor = DrivenWrench(
        WrenchSettings({}, 100.0),
        lambda s: made.append(WrenchDouble(s, Log())) or made[-1],
        WallClock(),
    )
    wrench = until(sensor.read)
    assert wrench.force == pytest.approx([1, 2, 3])
    assert wrench.torque == pytest.approx([-1, -2, -3])
    made[0].told = np.array([1.0, np.nan, 3.0])
    assert "expected 3 finite numbers" in str(raised(sensor.read))
    sensor.close()


def test_a_gripper_moves_within_its_opening():
    log = Log()
    gripper = DrivenGripper(
        GripperSettings({}, 0.08, 0.1, 40.0), lambda s: GripperDouble(s, log), WallClock()
    )
    assert until(gripper.read).width == pytest.approx(0.08)
    gripper.move(0.02)
    assert until(lambda: (s := gripper.read()) is not None and s.width == 0.02)
    for width in (-0.01, 0.2, np.nan):
        with pytest.raises(DeviceError, match=r"a width is 0 to 0.08 m"):
            gripper.move(width)
    assert log.count("move") == 1
    gripper.close()


def test_a_slow_gripper_is_not_lost_and_nobody_waits_for_it():
    """A serial bus at two readings a second: each transfer takes 0.4 s, commands as well."""
    log = Log()

    class Slow(GripperDouble):
        def read(self):
            time.sleep(0.4)
            return super().read()

        def move(self, width):
            time.sleep(0.4)
            super().move(width)

    gripper = DrivenGripper(
        GripperSettings({}, 0.08, 0.1, 40.0), lambda s: Slow(s, log), WallClock()
    )
    until(gripper.read)
    for width in (0.02, 0.03, 0.04):  # while it reads: only the last is wanted by then
        began = time.monotonic()
        gripper.move(width)
        assert time.monotonic() - began < 0.1
    assert until(lambda: (s := gripper.read()) is not None and s.width == 0.04)
    assert log.count("open") == 1
    assert log.count("move") == 1
    gripper.close()


def test_a_gripper_that_refuses_says_so_and_is_told_again():
    log = Log()

    class Refusing(GripperDouble):
        def move(self, width):
            if log.count("refused") < 2:
                log.calls.append(("refused", width))
                raise DeviceError("gripper: activate it first")
            super().move(width)

        def read(self):
            time.sleep(0.02)
            return super().read()

    gripper = DrivenGripper(
        GripperSettings({}, 0.08, 0.1, 40.0), lambda s: Refusing(s, log), WallClock()
    )
    until(gripper.read)
    gripper.move(0.02)
    assert "activate it first" in str(raised(gripper.read))
    assert until(lambda: _width(gripper) == 0.02)
    assert log.count("open") == 1
    gripper.close()


def _width(gripper):
    try:
        state = gripper.read()
    except DeviceError:
        return None
    return state and state.width
