"""What strays from its prediction is touched and left; what keeps to it is touched and kept to."""

from dataclasses import dataclass

import numpy as np
import pytest

from armsight.robots.sprung_tip import SprungTip
from armsight.servoing.docking import DOCK_NAMES, docking
from armsight.servoing.modes import BRAKES, LATE, LEAST_BRAKES, MEETS, meeting_speed
from armsight.servoing.straying import FADES, OFF, WILD, Straying


@dataclass
class Known:
    """The part of an estimate that is read."""

    seen: float
    stamp: float
    position: np.ndarray
    velocity: np.ndarray


def follow(path, reserve, seconds=4.0, ahead=0.16, late=0.08):
    """Errors and stand-offs of a tip that is at the surface all the time; looks every 40 ms."""
    watch, errors, offs = Straying(reserve), [], []
    seen = 0.0

    def velocity(t):
        return (path(t + 1e-3) - path(t - 1e-3)) / 2e-3

    for k in range(int(seconds / 0.008)):
        now = 0.008 * k
        if now - late > seen + 0.04:
            seen = now - late
        known = Known(seen, seen, path(seen), velocity(seen))
        watch.seen(known, np.array([1.0, 0.0, 0.0]))
        watch.predicted(now + ahead - late, known.position + (now + 0.062 - seen) * known.velocity)
        errors.append(watch.error)
        offs.append(watch.keeps_off(now, 0.002))
    return np.array(errors), np.array(offs)


def straight(t):
    return np.array([0.2 * t, 0.0, 0.1])


def shaken(t):
    return np.array([0.08 * np.sin(4.0 * t), 0.0, 0.1])


def test_what_goes_straight_on_is_kept_to():
    errors, offs = follow(straight, 0.002, ahead=0.142)
    assert errors.max() < 5e-4
    assert not offs.any()


def test_what_is_shaken_is_left_as_soon_as_it_was_touched_and_come_to_again():
    errors, offs = follow(shaken, 0.002, ahead=0.142)
    # 1.3 m/s^2 over a sixth of a second, more than nothing and less than twice that.
    assert 0.5 * 1.28 * 0.1**2 < errors[100:].max() < 1.28 * 0.2**2
    assert offs[100:].max() == pytest.approx(0.03)
    _, calm = follow(shaken, np.inf, ahead=0.142)
    assert not calm.any()


def test_a_tip_that_has_left_comes_again():
    watch = Straying(0.002)
    watch.error, watch.speed = 0.01, 0.05
    assert watch.keeps_off(1.0, 0.02) == pytest.approx(0.005)
    assert watch.keeps_off(1.05, 0.004) == pytest.approx(0.005), "errors may still bring it there"
    assert watch.keeps_off(1.1, 0.002) > 0.02
    assert watch.keeps_off(1.5, 0.03) > 0.02
    assert watch.keeps_off(2.0, 0.03) == pytest.approx(0.005)


def test_before_what_strays_it_stays_off_by_as_much_as_that_strays_along_the_tool():
    """Not before what stands, nor for errors beside the tool."""
    for speed, error, beside, off in (
        (0.3, 0.0015, 0.0, 0.0), (0.3, 0.006, 0.0, 0.0055), (0.3, 0.006, 0.03, 0.0055),
        (0.5, 0.04, 0.0, 0.03), (0.02, 0.02, 0.0, 0.002), (0.0, 0.02, 0.0, 0.0),
    ):  # fmt: skip
        watch = Straying(0.002)
        velocity = np.array([0.0, speed, 0.0])
        watch.predicted(0.5, np.zeros(3))
        known = Known(0.5, 0.5, np.array([error, 0.0, beside]), velocity)
        watch.seen(known, np.array([1.0, 0.0, 0.0]))
        assert watch.keeps_off(1.0, 0.05) == pytest.approx(off)


def test_what_strays_may_turn_as_its_errors_say_and_what_goes_as_hands_do():
    watch = Straying(0.002)
    watch.predicted(0.5, np.zeros(3))
    known = Known(0.5, 0.5, np.array([0.008, 0.0, 0.0]), np.array([0.0, 0.1, 0.0]))
    watch.seen(known, np.array([1.0, 0.0, 0.0]))
    assert watch.turns(0.2) == pytest.approx(0.4), "0.4 m/s^2 over 0.2 s are 8 mm"
    assert watch.speed_error(0.2) == pytest.approx(0.08)
    watch.error = 0.0
    assert watch.turns(0.2) == pytest.approx(0.25)


@pytest.mark.parametrize("turns", [0.0, 0.5, 1.5])
def test_from_its_meeting_speed_a_tip_still_stops_before_what_turns(turns):
    slows = max(BRAKES - turns, LEAST_BRAKES)
    for left in (0.005, 0.02, 0.1, 0.3):
        speed = meeting_speed(left, turns)
        assert speed == pytest.approx(MEETS) or speed * LATE + speed**2 / (2 * slows) <= left + 1e-9
    assert meeting_speed(-0.01, turns) == MEETS


BALLS = ["ball", "held_ball"]
"""What gives way: on a light stand, and in a hand."""


def test_an_error_fades_and_only_what_gives_way_has_a_reserve():
    errors, _ = follow(lambda t: shaken(t) if t < 1.0 else shaken(1.0), 0.002, ahead=0.142)
    assert errors[-1] < 0.07 * errors.max()
    assert [name for name in DOCK_NAMES if np.isfinite(docking(name).reserve())] == BALLS
    assert docking("ball").reserve() == pytest.approx(0.002)
    assert docking("held_ball").reserve() == pytest.approx(0.015)


def swung(t):
    """Two swings of 1.5 m/s within 0.4 s, and a pause of 2.6 s between them."""
    rest = min(max(t - 1.0, 0.0), 0.4) + min(max(t - 4.0, 0.0), 0.4)
    return np.array([0.3 * np.sin(rest / 0.4 * np.pi) ** 2, 0.0, 0.1])


def test_what_was_swung_about_is_not_believed_to_be_calm_in_its_first_pause():
    """A recorded hand paused for half a second: chased at 0.2 m/s, it came back into the tip."""
    reserve = docking("ball").reserve(SprungTip(200.0, 0.03, 1.0))
    errors, offs = follow(swung, reserve, seconds=3.9, ahead=0.142)
    assert errors.max() > 0.05
    half, second = (int((1.4 + pause) / 0.008) for pause in (0.5, 1.0))
    assert offs[half] > 0.0
    assert errors[second] > reserve
    less, offs = follow(lambda t: 0.08 * swung(t), reserve, seconds=3.9, ahead=0.142)
    assert 0.01 < less.max() < OFF
    assert less[second] < 0.3 * less.max(), "what is less is soon forgotten"


def test_the_first_predictions_say_nothing_of_how_a_target_moves():
    for first, kept in ((0.1, False), (1.0, True)):
        watch = Straying(0.022)
        watch.predicted(0.1, np.zeros(3))
        watch.predicted(max(first, 0.2), np.zeros(3))
        stamp, axis = max(first, 0.2) + 0.01, np.array([1.0, 0.0, 0.0])
        watch.seen(Known(stamp, stamp, np.array([0.08, 0.0, 0.0]), np.zeros(3)), axis)
        watch.seen(Known(stamp + 1.2, stamp + 1.2, np.zeros(3), np.zeros(3)), axis)
        assert watch.error == pytest.approx(0.08 * np.exp(-1.2 / (WILD if kept else FADES)))
