"""The protective distance and its closed form, against the design's table and against bisection."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.motion.risk import PaperRisk
from armsight.motion.separation import ReactionTime, Separation
from armsight.motion.separation_kernels import Law, allowed_share, protective

K5 = Separation(intrusion=0.02, person_error=0.02, arm_error=0.01)

lengths = st.floats(0.0, 3.0)
times = st.floats(0.01, 0.5)
decelerations = st.floats(0.5, 10.0)


@pytest.mark.parametrize(
    ("T_r", "row"),
    # Design page "guard", 5.8: v_max at D = 0.2, 0.3, 0.5 and 1 m for a = 5 m/s^2, K = 5 cm, and
    # 1.6 m/s from half a metre on.
    [(0.15, (0, 0, 0.41, 1.20)), (0.1, (0, 0.10, 0.60, 1.41)), (0.045, (0.13, 0.33, 0.84, 1.66))],
)
def test_the_design_pages_table(T_r, row):
    for distance, expected in zip((0.2, 0.3, 0.5, 1.0), row):
        v_h = 2.0 if distance < 0.5 else 1.6
        law = Separation(person_speed=v_h)
        assert law.allowed_speed(distance, T_r, 5.0) == pytest.approx(expected, abs=0.006)


@pytest.mark.parametrize("distance", [0.3, 0.6, 0.9, 1.5])
def test_a_hand_that_starts_anywhere_meets_a_standing_arm(distance):
    """Integrated in small steps: an arm at v_max, a hand at 2 m/s from the exposure on."""
    T_r, T_a, a, dt = 0.2, 0.016, 3.0, 1e-4
    arm = K5.allowed_speed(distance, T_r, a, T_a)
    gap, v = distance, arm
    for k in range(round((T_r + arm / a) / dt)):
        t = (k + 0.5) * dt
        v = arm if t < T_r else max(arm - a * (t - T_r), 0.0)
        gap -= (2.0 + (v if t > T_r - T_a else 0.0)) * dt
    assert gap >= K5.K - 1e-3 if arm > 0.0 else distance <= K5.K + 2.0 * T_r
    slower = Separation(person_speed=1.6)  # what counted a hand as a walk from half a metre on
    assert slower.allowed_speed(distance, T_r, a, T_a) > arm or distance < 0.37


@settings(deadline=None)
@given(lengths, times, decelerations)
def test_the_closed_form_keeps_exactly_the_protective_distance(distance, T_r, a):
    v = K5.allowed_speed(distance, T_r, a)
    if v == 0.0:
        assert K5.protective_distance(0.0, T_r, a) >= distance - 1e-9
    else:
        assert K5.protective_distance(v, T_r, a) == pytest.approx(distance, abs=1e-9)


@settings(deadline=None)
@given(lengths, lengths, times, decelerations)
def test_closer_is_never_faster(d1, d2, T_r, a):
    near, far = sorted((d1, d2))
    assert K5.allowed_speed(near, T_r, a) <= K5.allowed_speed(far, T_r, a) + 1e-12


@settings(deadline=None)
@given(times, decelerations)
def test_no_distance_is_no_speed(T_r, a):
    for distance in (-1.0, 0.0, math.nan):
        assert K5.allowed_speed(distance, T_r, a) == 0.0


def law(T_person=0.15, T_arm=0.15, retreat=0.0):
    return Law(2.0, 0.05, T_person, T_arm, 0.0, retreat)


@settings(deadline=None)
@given(lengths, times, decelerations, st.floats(0.01, 3.0))
def test_the_compiled_share_is_the_closed_form(distance, T_r, a, closing):
    """Closing in straight: the share times the speed is v_max, with a = v / T_s."""
    share = allowed_share(distance, closing, closing, closing / a, law(T_r, T_r))
    assert share * closing == pytest.approx(K5.allowed_speed(distance, T_r, a), abs=1e-9)


@settings(deadline=None)
@given(lengths, st.floats(-2.0, 2.0), st.floats(0.0, 1.0), times)
def test_the_share_keeps_the_protective_distance(distance, closing, stopping, T_r):
    numbers = law(T_r, T_r)
    share = allowed_share(distance, closing, abs(closing) + 0.1, stopping, numbers)
    if 0.0 < share < 1e6:
        kept = protective(share * closing, share * stopping, numbers)
        # One pair of (closing, stopping) at the share: S_s scales with its square.
        assert kept <= distance + 1e-9


def test_the_stated_protective_distance_is_the_standards():
    """Term by term, where the arm's own time and the person's differ."""
    for v, T_r, T_a, a in ((0.0, 0.2, 0.016, 5.0), (0.5, 0.2, 0.016, 5.0), (1.2, 0.1, 0.05, 2.0)):
        expected = K5.protective_distance(v, T_r, a, T_a=T_a)
        assert protective(v, v / a, law(T_r, T_a)) == pytest.approx(expected, abs=1e-12)
        receding = K5.protective_distance(0.0, T_r, a, T_s=v / a)
        assert protective(-v, v / a, law(T_r, T_a)) == pytest.approx(receding, abs=1e-12)


def test_moving_away_is_always_allowed_slowly():
    for distance in (-0.1, 0.0, 0.2, 0.4):
        share = allowed_share(distance, -1.0, 1.0, 0.3, law(retreat=0.045))
        assert share >= 0.045
        assert allowed_share(distance, 0.001, 1.0, 0.3, law(retreat=0.045)) < 0.3


def test_reaction_time_is_the_worst_of_the_window_and_never_below_the_declared():
    T_r = ReactionTime(0.1, window=10.0)
    assert T_r.value == 0.1
    T_r.add(0.0, 0.08)
    assert T_r.value == 0.1
    T_r.add(1.0, 0.3)
    T_r.add(2.0, 0.2)
    T_r.add(3.0, math.inf)  # no picture yet: not a measurement
    assert T_r.value == 0.3
    T_r.add(11.5, 0.05)
    assert T_r.value == 0.2
    T_r.add(30.0, 0.05)
    assert T_r.value == 0.1
    T_r.clear()
    assert T_r.value == 0.1


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=60))
def test_reaction_time_against_a_plain_maximum(steps):
    T_r = ReactionTime(0.0, window=3.0)
    now, seen = 0.0, []
    for step, value in steps:
        now += step
        seen.append((now, value))
        T_r.add(now, value)
        assert T_r.value == max(v for t, v in seen if t >= now - 3.0)


def test_the_papers_risk():
    risk = PaperRisk()
    assert risk.risk(0.25, 0.04167) == pytest.approx(1.0, abs=1e-3)  # design 5.9: 4 cm, 67 cm
    assert risk.reflexive(1.0, 0.66)
    assert not risk.reflexive(1.0, 0.68)
    assert risk.risk(0.0, 0.0) == math.inf
    assert risk.reflexive(-1.0, 0.5)  # it cannot tell coming from going
