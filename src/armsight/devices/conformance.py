"""The conformance kit: what any driver, ours or a stranger's, is run against.

``armsight doctor --driver NAME`` prints it; a test of one's own is three lines::

    from armsight.devices.conformance import failures
    def test_my_camera():
        assert not failures("camera", MyCamera, CameraSettings("front", {"serial": "123"}))

A driver is opened, read for a while, closed, and opened again. Nothing is commanded unless
``commands`` says so: then an arm moves its last joint by about a degree to and fro.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armsight.devices.camera_checks import (
    check_lens,
    check_pair,
    check_pose,
    check_range,
    check_rate,
    checked_color,
    clean_depth,
)
from armsight.devices.clock_map import ClockMap
from armsight.devices.line import OPEN_SECONDS, STOP_SECONDS
from armsight.devices.port import Kind
from armsight.errors import DeviceError

READ_SECONDS = 1.0
"""No read may take longer [s]."""
ARM_READ_SECONDS = 0.25
"""No read of an arm may take longer: commands wait for it [s]."""
DRAIN_SECONDS = 0.02
"""Readings that wait in an arm's driver are read for at most so long [s]."""
NUDGE = 0.04
"""Speed of the last joint in the test of commands [rad/s]."""
NUDGE_SECONDS = 0.5
"""How long it moves to each side [s]."""


@dataclass(frozen=True)
class DriverCheck:
    """One thing that was looked at.

    Attributes:
        good: whether it is as it has to be.
        title: what was looked at; found: what was found.
    """

    good: bool
    title: str
    found: str


def failures(
    kind: Kind, opener: Callable[[Any], Any], settings: Any, **options: Any
) -> list[DriverCheck]:
    """What is wrong with a driver; see :func:`conformance`."""
    return [r for r in conformance(kind, opener, settings, **options) if not r.good]


def conformance(
    kind: Kind,
    opener: Callable[[Any], Any],
    settings: Any,
    *,
    seconds: float = 3.0,
    commands: bool = False,
) -> Iterator[DriverCheck]:
    """Run a driver against what the port asks of it.

    Args:
        kind: of device.
        opener: the driver's class.
        settings: of its kind, see :mod:`armsight.devices.port`.
        seconds: how long it is read [s].
        commands: move an arm or a gripper a little; keep clear.
    """
    bench = _Bench()
    try:
        driver, took = bench.call("opening", lambda: opener(settings), OPEN_SECONDS)
    except DeviceError as error:
        yield DriverCheck(False, "opens", str(error))
        return
    yield DriverCheck(True, "opens", f"in {took:.2f} s")
    report = None
    if kind in ("camera", "stereo"):
        try:
            report = bench.call("report", lambda: driver.report, READ_SECONDS)[0]
            yield _check_report(kind, report)
        except (DeviceError, AttributeError, TypeError) as error:
            yield DriverCheck(False, "reports", str(error))
            report = None
    sound = True
    for check in _read(bench, kind, driver, report, settings, seconds):
        sound = sound and check.good
        yield check
    if kind == "camera":
        yield _tried(bench, "colour", "want_color()", lambda: driver.want_color(True))
        if hasattr(driver, "want_infrared"):
            yield _tried(bench, "infrared", "want_infrared()", lambda: driver.want_infrared(True))
    if commands and kind == "arm" and not sound:
        yield DriverCheck(False, "obeys", "it was not moved: what it reads is wrong, see above")
    elif commands and kind == "arm":
        yield from _moved(bench, driver, settings)
    if commands and kind == "gripper":
        width = 0.5 * settings.opening
        yield _tried(bench, "moves", "move()", lambda: driver.move(width), READ_SECONDS)
    yield _tried(bench, "closes", "close()", driver.close)
    yield _tried(bench, "closes twice", "close()", driver.close)
    yield _reopens(bench, opener, settings, report)


def _read(
    bench: _Bench, kind: Kind, driver: Any, report: Any, settings: Any, seconds: float
) -> Iterator[DriverCheck]:
    """Read for a while and judge what came."""
    limit = ARM_READ_SECONDS if kind == "arm" else READ_SECONDS
    readings: list[tuple[Any, float]] = []
    slowest, last = 0.0, object()
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        try:
            reading, took = bench.call("read()", driver.read, limit)
        except DeviceError as error:
            yield DriverCheck(False, "reads", str(error))
            return
        slowest = max(slowest, took)
        if reading is None or (reading.stamp is not None and reading.stamp == last):
            time.sleep(0.001)
            continue
        last = reading.stamp
        readings.append((reading, time.perf_counter()))
        if took < 1e-4:
            time.sleep(0.0005)
    if len(readings) < 3:
        yield DriverCheck(False, "reads", f"{len(readings)} new readings in {seconds:g} s")
        return
    rate = (len(readings) - 1) / (readings[-1][1] - readings[0][1])
    yield DriverCheck(
        True, "reads", f"{rate:.1f} readings a second, slowest read {1e3 * slowest:.1f} ms"
    )
    told = getattr(report, "rate", None)
    if told is not None:
        good = 0.7 * told < rate < 1.4 * told
        yield DriverCheck(good, "rate", f"{rate:.1f} Hz, its report says {told:.1f} Hz")
    yield _judged("values", lambda: _values(kind, [r for r, _ in readings], report, settings))
    yield _judged("time", lambda: _time(readings))


def _values(kind: Kind, readings: Sequence[Any], report: Any, settings: Any) -> str:
    """Shapes, types, units of every reading.

    Raises:
        DeviceError: something cannot be.
    """
    first = readings[0]
    if kind == "camera":
        shares = []
        for r in readings:
            depth = clean_depth("camera", r.depth, report.depth)
            shares.append(float(np.isfinite(depth).mean()))
            if r.color is not None:
                checked_color("camera", "color", r.color, report.color)
        if max(shares) == 0.0:
            raise DeviceError("no pixel of any picture has a depth")
        shared = np.shares_memory(readings[-1].depth, readings[-2].depth)
        words = "; pictures share memory, which is allowed: they are copied" if shared else ""
        return f"{100 * float(np.mean(shares)):.0f} % of the pixels have a depth{words}"
    if kind == "stereo":
        for r in readings:
            checked_color("stereo", "left", r.left, report.left)
            checked_color("stereo", "right", r.right, report.right)
        return f"pairs of {report.left.width}x{report.left.height} px"
    if kind == "arm":
        return _joints(readings, settings)
    if kind == "wrench":
        values = np.array([np.concatenate([r.force, r.torque]) for r in readings], float)
        if values.shape[1:] != (6,) or not np.all(np.isfinite(values)):
            raise DeviceError("force and torque are not 3 finite numbers each")
        force, torque = np.linalg.norm(values.mean(axis=0).reshape(2, 3), axis=1)
        return f"mean force {force:.2f} N, torque {torque:.3f} N m (is the tool's weight in it?)"
    if kind == "switch":
        if not all(isinstance(r.on, bool) for r in readings):
            raise DeviceError(f"on is {first.on!r}, expected True or False")
        return f"on in {sum(r.on for r in readings)} of {len(readings)} readings"
    width = float(first.width)
    if not -0.01 <= width <= 1.5 * settings.opening + 0.01:
        raise DeviceError(f"width {width:g}, expected metres up to {settings.opening:g}")
    return f"width {1e3 * width:.1f} mm"


def _joints(readings: Sequence[Any], settings: Any) -> str:
    n = len(settings.joint_names)
    for r in readings:
        for what in ("position", "velocity"):
            values = np.asarray(getattr(r, what), float)
            if values.shape != (n,) or not np.all(np.isfinite(values)):
                raise DeviceError(f"{what} is {values.tolist()}, expected {n} finite numbers")
    q = np.array([r.position for r in readings], float)
    worst = int(np.argmax(np.abs(q).max(axis=0)))
    if np.abs(q[:, worst]).max() > 4.0 * np.pi:
        raise DeviceError(
            f"joint {settings.joint_names[worst]} reads {q[0, worst]:.4g}, expected radians"
        )
    return f"{n} joints within {np.abs(q).max():.2f} rad, mode {readings[-1].mode}"


def _time(readings: Sequence[tuple[Any, float]]) -> str:
    """How well a device's clock can be followed.

    Raises:
        DeviceError: it lies.
    """
    if readings[0][0].stamp is None:
        return "the device tells none: readings are dated by their arrival"
    times = ClockMap("the device")
    for reading, arrival in readings:
        times.map(reading.stamp, arrival)
    drift = f", drift {1e6 * times.drift:+.0f} ppm" if times.drift else ""
    return f"stamps to {1e3 * times.error:.2f} ms{drift}, its latency aside"


def _check_report(kind: Kind, report: Any) -> DriverCheck:
    if kind == "stereo":
        check_lens("stereo", "left", report.left)
        check_lens("stereo", "right", report.right)
        check_pair("stereo", report.T_left_right)
        found = (
            f"{report.model}: baseline {1e3 * np.linalg.norm(report.T_left_right[:3, 3]):.1f} mm"
        )
    else:
        check_lens("camera", "depth", report.depth)
        if report.color is not None:
            check_lens("camera", "color", report.color)
        check_pose("camera", "T_depth_color", report.T_depth_color)
        check_range("camera", report.range, report.noise)
        near, far = report.range
        sigma = 1e3 * float(report.noise.sigma(np.float64(0.5 * (near + far))))
        lens = report.depth
        found = (
            f"{report.model}: {lens.width}x{lens.height}, {near:g}-{far:g} m, noise {sigma:.1f} mm "
            "in the middle"
        )
    check_rate(kind, report.rate, report.latency)
    return DriverCheck(True, "reports", found)


def _moved(bench: _Bench, driver: Any, settings: Any) -> Iterator[DriverCheck]:
    """Move an arm a little; whatever comes in between, Ctrl-C included, it is told to stop."""
    stopped = None
    try:
        yield from _nudge(bench, driver, settings)
    except Exception as error:  # whatever a stranger's readings are
        yield DriverCheck(False, "obeys", str(error))
    finally:
        stopped = _tried(bench, "stops", "stop()", driver.stop)
    yield stopped


def _nudge(bench: _Bench, driver: Any, settings: Any) -> Iterator[DriverCheck]:
    """Move the last joint to and fro; let the watchdog stop it."""
    n = len(settings.joint_names)
    start = _newest(bench, driver)
    for sign in (1.0, -1.0):
        speed = np.zeros(n)
        speed[-1] = sign * NUDGE
        before, began = _newest(bench, driver).position[-1], time.perf_counter()
        end = time.perf_counter() + NUDGE_SECONDS
        while time.perf_counter() < end:
            try:
                bench.call("command_velocity()", lambda: driver.command_velocity(speed), 0.25)  # noqa: B023
            except DeviceError as error:
                yield DriverCheck(False, "obeys", str(error))
                return
            _newest(bench, driver)
            time.sleep(0.004)
        moved = _newest(bench, driver).position[-1] - before
        wanted = sign * NUDGE * (time.perf_counter() - began)
        good = 0.4 * abs(wanted) < sign * moved < 1.8 * abs(wanted)
        found = f"{moved:+.4f} rad, about {wanted:+.4f} was asked for"
        yield DriverCheck(bool(good), "obeys", found)
        if not good:
            return
    end = time.perf_counter() + settings.watchdog + 1.0
    while time.perf_counter() < end:
        resting = _newest(bench, driver)
    still = bool(np.abs(resting.velocity).max() < 0.25 * NUDGE)
    yield DriverCheck(still, "watchdog", "stops by itself" if still else "goes on without commands")
    if not still:
        bench.call("stop()", driver.stop, STOP_SECONDS)
    off = float(np.abs(resting.position - start.position).max())
    yield DriverCheck(off < 0.05, "returns", f"{off:.4f} rad from where it was")


def _newest(bench: _Bench, driver: Any) -> Any:
    """The newest reading: those that wait in the driver are read first."""
    newest, stamp = None, object()
    end = time.perf_counter() + DRAIN_SECONDS
    while newest is None or time.perf_counter() < end:
        reading, took = bench.call("read()", driver.read, ARM_READ_SECONDS)
        nothing_new = reading is None or (reading.stamp is not None and reading.stamp == stamp)
        if reading is not None:
            newest, stamp = reading, reading.stamp
        if newest is not None and (nothing_new or took > 1e-3):
            return newest
        if nothing_new:
            time.sleep(0.0005)
    return newest


def _reopens(
    bench: _Bench, opener: Callable[[Any], Any], settings: Any, report: Any
) -> DriverCheck:
    try:
        driver, took = bench.call("opening", lambda: opener(settings), OPEN_SECONDS)
        bench.call("read()", driver.read, READ_SECONDS)
        again = getattr(driver, "report", None)
        bench.call("close()", driver.close, STOP_SECONDS)
    except DeviceError as error:
        return DriverCheck(False, "opens again", str(error))
    lens = getattr(report, "depth", getattr(report, "left", None))
    if report is not None and lens != getattr(again, "depth", getattr(again, "left", None)):
        return DriverCheck(False, "opens again", "it reports other intrinsics than before")
    return DriverCheck(True, "opens again", f"in {took:.2f} s")


def _tried(
    bench: _Bench, title: str, what: str, job: Callable[[], Any], limit: float = STOP_SECONDS
) -> DriverCheck:
    try:
        _, took = bench.call(what, job, limit)
    except DeviceError as error:
        return DriverCheck(False, title, str(error))
    return DriverCheck(True, title, f"in {1e3 * took:.1f} ms")


def _judged(title: str, judge: Callable[[], str]) -> DriverCheck:
    try:
        return DriverCheck(True, title, judge())
    except (DeviceError, TypeError, ValueError, AttributeError) as error:
        return DriverCheck(False, title, str(error))


class _Bench:
    """Calls a driver so that nothing it does can hold up the kit."""

    def call(self, what: str, job: Callable[[], Any], limit: float) -> tuple[Any, float]:
        """A result, and how long it took [s].

        Raises:
            DeviceError: it raised, or did not return within ``limit`` [s].
        """
        told: list[Any] = []

        def run() -> None:
            began = time.perf_counter()
            try:
                told.append((job(), time.perf_counter() - began))
            except BaseException as error:
                told.append(error)

        thread = threading.Thread(target=run, name=f"conformance-{what}", daemon=True)
        thread.start()
        thread.join(limit)
        if not told:
            raise DeviceError(f"{what} has not returned for {limit:g} s")
        if isinstance(told[0], BaseException):
            words = f"{type(told[0]).__name__}: {told[0]}".splitlines()[0]
            raise DeviceError(f"{what} failed ({words})") from told[0]
        result: tuple[Any, float] = told[0]
        return result
