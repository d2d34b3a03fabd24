"""Joints in the past: between readings, at the ends, and where nothing is known."""

import numpy as np
import pytest

from armsight.devices.data import JointState, Wrench
from armsight.devices.history import JointHistory
from armsight.devices.recorded import RecordedWrench


def reading(stamp, position, velocity=1.0):
    return JointState(stamp, np.array([position]), np.array([velocity]))


@pytest.fixture
def history():
    h = JointHistory(seconds=1.0)
    for k in range(5):
        h.add(reading(0.1 * k, 0.1 * k))
    return h


@pytest.mark.parametrize("stamp", [0.0, 0.05, 0.1, 0.237, 0.4])
def test_a_steady_motion_is_found_everywhere(history, stamp):
    assert history.at(stamp).position[0] == pytest.approx(stamp)


def test_just_outside_velocity_carries_on(history):
    assert history.at(0.43).position[0] == pytest.approx(0.43)
    assert history.at(-0.03).position[0] == pytest.approx(-0.03)


def test_far_outside_nothing_is_known(history):
    assert history.at(0.46) is None
    assert history.at(-0.2) is None
    assert JointHistory().at(0.0) is None


def test_old_and_doubled_readings_are_ignored(history):
    history.add(reading(0.2, 99.0))
    history.add(reading(0.4, 99.0))
    assert history.at(0.2).position[0] == pytest.approx(0.2)
    assert history.latest.position[0] == pytest.approx(0.4)


def test_a_clock_that_is_turned_back_begins_anew():
    history = JointHistory()
    for stamp in (50.0, 50.1, 3.0, 3.1):
        history.add(reading(stamp, stamp))
    assert history.at(3.05).position[0] == pytest.approx(3.05)
    assert history.at(50.05) is None
    assert history.latest.stamp == 3.1


def test_it_forgets(history):
    history.add(reading(1.35, 1.35))
    assert history.at(0.2) is None
    assert history.at(0.4) is not None


def test_what_was_felt_about_a_time():
    history = JointHistory(seconds=1.0)
    for k in range(600):
        history.feel(Wrench(0.002 * k, np.array([k, 0.0, 0.0]), np.zeros(3)))
    assert history.felt(1.0)[0] == pytest.approx(500.0)
    assert history.felt(1.202)[0] == pytest.approx(597.0, abs=2.0)  # the newest are still to come
    assert history.felt(1.3) is None
    assert history.felt(0.1) is None  # forgotten
    assert history.copy().felt(1.0)[0] == pytest.approx(500.0)
    history.feel(Wrench(1.2, np.array([np.nan, 0.0, 0.0]), np.zeros(3)))
    history.feel(Wrench(1.1, np.array([99.0, 0.0, 0.0]), np.zeros(3)))
    assert history.felt(1.198)[0] == pytest.approx(595.5, abs=2.0)
    history.feel(Wrench(0.0, np.ones(3), np.ones(3)))  # the clock was turned back
    assert history.felt(0.0) == pytest.approx(np.ones(6))
    assert history.felt(1.0) is None


def test_a_recorded_force_sensor_hands_over_every_reading():
    sensor = RecordedWrench()
    for k in range(3):
        sensor.deliver(Wrench(0.002 * k, np.ones(3), np.zeros(3)))
    stamps = [sensor.read().stamp for _ in range(3)]
    assert stamps == [0.0, 0.002, 0.004]
    assert sensor.read() is None
    sensor.deliver(Wrench(1.0, np.ones(3), np.zeros(3)))
    sensor.deliver(None)
    assert sensor.read() is None
