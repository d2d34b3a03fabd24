"""A camera that lies about time by 20 ms is told from a target that moves, and named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armsight.experiments.servo_ball import joints_before, path_of
from armsight.experiments.servo_eyes import Errors
from armsight.experiments.servo_world import Trial, make_eyes, make_task, set_up, world_to_base
from armsight.geometry.pose import make_pose
from armsight.servoing.clocks import ClockWatch

from .test_estimate import look

NAMES = ("a", "b", "c", "wrist")
RATE = {"a": 5.0, "b": 5.0, "c": 5.0, "wrist": 10.0}


def watched(lies, path, camera=lambda t: np.zeros(3), seconds=15.0):
    """Looks at a path, each camera with a bias of its own; the wrist's goes along with it."""
    rng, watch = np.random.default_rng(4), ClockWatch(NAMES)
    off = {name: rng.normal(0.0, 0.004, 3) for name in NAMES}
    events = sorted(
        (k / RATE[name] + 0.03 * i, name)
        for i, name in enumerate(NAMES)
        for k in range(round(seconds * RATE[name]))
    )
    for at, name in events:
        stamp = at + lies.get(name, 0.0)
        seen = path(at) + off[name] + rng.normal(0.0, 0.001, 3)
        one = look(name, stamp, seen, 0.001)
        if name == "wrist":  # it stands where the joints were at the stamp
            T = make_pose(None, camera(stamp))
            seen = seen + camera(stamp) - camera(at)
            one = replace(look(name, stamp, seen, 0.0002), T_base_camera=T)
        watch.see(one, path(at))
    return watch


def circle(t):
    turn = 0.25 / 0.12
    return np.array([0.8, 0.12 * np.sin(turn * t), 0.7 + 0.12 * np.cos(turn * t)])


def still(t):
    return np.array([0.8, 0.0, 0.7])


def sways(t):
    return np.array([0.0, 0.1 * np.sin(2.5 * t), 0.1 * np.cos(2.0 * t)])


@pytest.mark.parametrize("who", ["a", "wrist"])
@pytest.mark.parametrize("lie", [-0.02, 0.02])
def test_who_lies_by_20_ms_is_named_with_how_much(who, lie):
    watch = watched({who: lie}, circle)
    assert watch.words.startswith(f"{who}: stamps about ")
    assert ("late" if lie > 0.0 else "early") in watch.words
    assert watch.lies()[who][0] == pytest.approx(lie, abs=0.006)


def test_clocks_that_are_right_are_not_blamed():
    for path, camera in ((circle, still), (circle, sways), (still, still), (still, sways)):
        assert watched({}, path, camera).words == ""


def test_before_a_target_at_rest_nobody_is_blamed_for_a_pair_that_lies_on_a_moving_arm():
    """It is wrong by its own speed then, and right when the arm stands."""
    watch = watched({"wrist": 0.02}, still, sways)
    assert watch.words == ""
    assert watch.lies() == {}


def test_before_a_target_at_rest_a_lie_cannot_be_told_and_does_no_harm():
    """All that a fixed camera says there is the same at any time."""
    watch = watched({"a": 0.02}, still)
    assert watch.words == ""
    assert watch.lies() == {}


def test_all_that_lie_alike_cannot_be_told():
    assert watched(dict.fromkeys(NAMES, 0.02), circle).words == ""


def test_of_two_cameras_nobody_knows_which():
    rng, watch = np.random.default_rng(5), ClockWatch(("a", "b"))
    for k in range(200):
        for i, name in enumerate("ab"):
            at = 0.1 * k + 0.05 * i
            seen = circle(at) + rng.normal(0.0, 0.001, 3)
            watch.see(look(name, at + 0.025 * i, seen, 0.001), circle(at))
    assert watch.words.startswith("a or b: stamps about ")


def test_a_target_that_is_carried_off_blames_nobody():
    jumps = np.random.default_rng(6).uniform(-0.3, 0.3, (20, 3))
    assert watched({}, lambda t: circle(t) + jumps[int(t)]).words == ""


def test_a_pair_that_lies_in_a_guarded_trial_is_named_on_the_page_and_pushes_nothing():
    setup = set_up(1.0, 1.0)
    rng = np.random.default_rng((78, 0))
    place = world_to_base(setup, [list(rng.uniform((0.7, -0.2, 1.1), (0.9, 0.2, 1.3)))])[0]
    path = path_of(place, 0.2, rng)
    eyes = make_eyes(setup, Errors(), rng)
    eyes.lies = {"wrist": 0.02}
    run = Trial(setup, eyes, make_task(setup, "ours"), path, joints_before(setup, path(0.0)))
    while run.now < 20.0 and not run.task.chase.warning:
        run.step()
    assert run.task.chase.warning.startswith("wrist: stamps about")
    assert run.task.face().reason == run.task.chase.warning
    assert run.course.nudges.harm == 0
