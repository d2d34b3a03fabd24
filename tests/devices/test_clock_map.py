"""Device time to host time against synthetic clocks with known offset, drift and delays."""

import numpy as np
import pytest

from armsight.devices.clock import WallClock
from armsight.devices.clock_map import ClockMap, lower_line
from armsight.errors import DeviceError

LATENCY = 0.03


def clocks(seconds, rate, offset, drift, delay, rng):
    """True times [s], the device's stamps, and arrivals."""
    true = np.arange(0.0, seconds, 1.0 / rate)
    stamps = offset + (1.0 + drift) * true
    return true, stamps, true + LATENCY + delay(rng, len(true))


def gamma(rng, n):
    return rng.gamma(2.0, 0.002, n)


def busy(rng, n):
    """Mostly prompt, now and then held up by 80 ms."""
    return rng.gamma(2.0, 0.001, n) + 0.08 * (rng.random(n) < 0.05)


@pytest.mark.parametrize("delay", [gamma, busy])
@pytest.mark.parametrize("rate", [15.0, 500.0])
@pytest.mark.parametrize("drift", [0.0, 80e-6, -80e-6])
def test_mapped_stamps_are_as_good_as_stated(delay, rate, drift):
    rng = np.random.default_rng(5)
    true, stamps, arrivals = clocks(40.0, rate, 1.7e9, drift, delay, rng)
    times = ClockMap("camera 'c'", LATENCY)
    late, stated = [], []
    for i in range(len(true)):
        mapped = times.map(stamps[i], arrivals[i])
        assert mapped <= arrivals[i] - LATENCY + 1e-9
        late.append(mapped - true[i])
        stated.append(times.error)
    settled = true > 5.0
    errors, stated = np.abs(late)[settled], np.array(stated)[settled]
    assert np.mean(errors <= stated + 1e-3) > 0.99
    assert stated[-1] < 0.006
    assert errors[-len(errors) // 3 :].max() < 0.004  # the delays alone are up to 85 ms
    assert times.drift == pytest.approx(-drift, abs=60e-6)


def test_a_device_without_time_is_dated_by_arrival():
    times = ClockMap("wrench", 0.004)
    assert times.map(None, 12.0) == pytest.approx(11.996)
    assert times.drift == 0.0


def test_a_clock_that_was_set_once_is_followed():
    times = ClockMap("camera 'c'")
    for i in range(50):
        times.map(100.0 + 0.1 * i, 0.1 * i)
    assert times.map(5.0, 5.1) == pytest.approx(5.1)  # back to the start: a restarted camera
    assert times.map(5.1, 5.2) == pytest.approx(5.2)


@pytest.mark.parametrize(
    ("lie", "words"),
    [
        (lambda t: 1e3 * t, "are its stamps seconds"),  # milliseconds
        (lambda t: np.nan, "dates a reading nan"),
        (lambda t: 1.02 * t, "% against the computer's"),
        (lambda t: t if int(10 * t) % 2 else t + 3.0, "its clock jumped"),
        (lambda t: -t, "its clock jumped"),
    ],
)
def test_lies_about_time_are_told(lie, words):
    times = ClockMap("camera 'c'")

    def listen():
        for i in range(1000):
            times.map(lie(0.1 * i), 0.1 * i)

    with pytest.raises(DeviceError, match="camera 'c' lies about time") as told:
        listen()
    assert words in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("held_up", [0.3, 0.8, 1.5])
def test_a_reading_that_was_held_up_is_as_old_as_it_is(held_up):
    """A bus or a process stood still: dated by its arrival an old picture would be a new one."""
    times = ClockMap("camera 'c'", LATENCY)
    for i in range(60):
        times.map(0.05 * i, 0.05 * i + LATENCY)
    first = 3.0 + held_up + LATENCY
    for i in range(int(held_up / 0.05)):  # then all that waited comes at once
        assert times.map(3.0 + 0.05 * i, first + 1e-3 * i) == pytest.approx(3.0 + 0.05 * i)
    now = 3.0 + held_up
    assert times.map(now, now + LATENCY) == pytest.approx(now)


def test_who_is_late_for_long_is_told_so():
    """A driver that reads slower than its device sends: every reading waits longer."""
    times = ClockMap("camera 'c'")

    def listen():
        for i in range(1000):
            assert times.map(0.05 * i, 0.1 * i) < 0.05 * i + 0.3

    with pytest.raises(DeviceError, match="later than they used to") as told:
        listen()
    assert "does its driver read the newest one" in str(told.value)


def test_the_line_is_below_all_points_and_nearest():
    rng = np.random.default_rng(0)
    device = np.sort(rng.uniform(0.0, 60.0, 40))
    host = 3.0 + 1.0001 * device + rng.exponential(0.01, 40)
    (d0, h0), drift = lower_line(list(zip(device.tolist(), host.tolist())))
    gaps = host - (h0 + (1.0 + drift) * (device - d0))
    assert gaps.min() > -1e-9
    # No line through two points that has none below it is nearer on average.
    best = np.inf
    for i in range(40):
        for j in range(i):
            slope = (host[i] - host[j]) / (device[i] - device[j])
            others = host - (host[j] + slope * (device - device[j]))
            if others.min() > -1e-9:
                best = min(best, others.mean())
    assert gaps.mean() == pytest.approx(best, abs=1e-9)


def test_a_pause_of_the_clock_does_not_make_old_readings_new():
    ticks = [100.0]
    clock = WallClock(source=lambda: ticks[0])
    ticks[0] = 101.0
    assert clock.at(100.5) == pytest.approx(0.5)
    clock.pause()
    ticks[0] = 109.0
    assert clock.now() == pytest.approx(1.0)
    assert clock.at(108.9) == pytest.approx(0.9)
    clock.resume()
    ticks[0] = 110.0
    assert clock.at(109.5) == pytest.approx(1.5)
