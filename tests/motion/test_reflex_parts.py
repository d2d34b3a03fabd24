"""The reflex alone: what is a way back, how fast something comes, when the danger is over."""

from types import SimpleNamespace

import numpy as np
import pytest

from armsight.motion.executed import Executed
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import Hazards, MovingBody
from armsight.motion.reflex import GAIN, MEMORY, SHORTEST, Approach, Reflex, ReflexStage
from armsight.motion.separation_kernels import Law
from armsight.robots import load_robot

ROBOT = load_robot("ur5")
CONFIG = GuardConfig()
LAW = Law(2.0, 0.05, 0.2, 0.016, 0.0173, 0.045)


class Surroundings:
    """Distances that grow on the way back as they are told; everything is proven free, or not."""

    def __init__(self, here, gained, free=True):
        self.here, self.gained, self.free = here, gained, free
        self.law, self.body = LAW, self
        self.start = None

    def view(self, q, q_dot, hazards, law):
        assert not q_dot.any()
        self.start = q if self.start is None else self.start
        away = self.here if q is self.start else self.here + self.gained
        return SimpleNamespace(least=away)

    def path_valid(self, path, snapshot, at):
        return self.free


def chosen(gained, length=1.0, free=True):
    """What the reflex does, at the end of a straight motion of some length [rad]."""
    executed = Executed()
    for x in np.linspace(0.0, length, 200):
        executed.add(ROBOT.home + np.array([x, 0.0, 0.0, 0.0, 0.0, 0.0]))
    reflex = Reflex(CONFIG, ROBOT.limits.scaled(0.5, 0.6))
    reflex.begin(0.1)
    q = ROBOT.home + np.array([length, 0.0, 0.0, 0.0, 0.0, 0.0])
    around = Surroundings(0.12, gained, free)
    reflex.choose(q, executed, around, None, around, None)
    return reflex


def test_a_way_back_is_taken_if_it_is_free_long_enough_and_leads_away():
    back = chosen(2.0 * GAIN)
    assert back.stage == ReflexStage.RETRACE
    end = back.route.trajectory.position(back.route.trajectory.duration)
    assert end[0] - ROBOT.home[0] == pytest.approx(1.0 - CONFIG.retrace_share, abs=0.02)
    assert chosen(0.5 * GAIN).stage == ReflexStage.FLEE, "that leads nowhere"
    assert chosen(-GAIN).stage == ReflexStage.FLEE
    assert chosen(2.0 * GAIN, free=False).stage == ReflexStage.FLEE
    assert chosen(2.0 * GAIN, 0.5 * SHORTEST / CONFIG.retrace_share).stage == ReflexStage.FLEE
    assert chosen(2.0 * GAIN, 0.0).route is None


def test_how_fast_something_comes_is_known_by_the_last_third_of_a_second_alone():
    approach = Approach()
    times = np.arange(0.0, 2.0, 0.033)
    for t in times:
        approach.add(t, 0.9 - 0.5 * max(t - 1.5, 0.0))
    assert approach.speed == pytest.approx(0.5, abs=0.01)
    assert len(approach._seen) <= MEMORY / 0.033 + 2


@pytest.mark.parametrize(("times", "known"), [
    ([0.0, 0.1, 0.2], False),
    ([0.0, 0.1, 0.2, 0.3], True),
    ([0.0, 0.03, 0.06, 0.09, 0.12], False),
    ([0.0, 0.05, 0.1, 0.15, 0.2], True),
])  # fmt: skip
def test_of_few_looks_nothing_is_known(times, known):
    approach = Approach()
    for t in times:
        approach.add(t, 1.0 - t)
    assert approach.speed == pytest.approx(1.0 if known else 0.0)


def test_a_reflex_is_over_once_what_is_near_has_been_away_for_a_while():
    reflex = Reflex(CONFIG, ROBOT.limits)
    reflex.begin(0.05)
    apart = 0.05 + CONFIG.release + 0.01
    assert apart > CONFIG.reflex_distance
    assert not reflex.over(1.0, apart - 0.02)
    assert not reflex.over(1.1, apart)
    assert not reflex.over(1.1 + 0.9 * CONFIG.recovery, apart)
    assert not reflex.over(1.4, apart - 0.02), "it came back"
    assert not reflex.over(1.5, apart)
    assert reflex.over(1.5 + 1.1 * CONFIG.recovery, apart)
    # What was already far when it began need only be farther than anything is fled from.
    reflex.begin(0.2)
    far = CONFIG.reflex_distance + CONFIG.release
    assert not reflex.over(3.0, far - 0.01)
    assert not reflex.over(4.0, far + 0.01)
    assert reflex.over(4.3, far + 0.01)


def test_what_does_not_move_the_arm_is_given_up_only_where_nothing_comes_nearer():
    reflex = Reflex(CONFIG, ROBOT.limits)
    reflex.begin(0.1)
    reflex.stage = ReflexStage.RETRACE
    reflex.try_other(0.1)
    assert reflex.stage == ReflexStage.FLEE
    for t in np.arange(0.0, 0.4, 0.033):
        reflex.approach.add(t, 0.3 - 0.5 * t)
    reflex.try_other(0.1)
    assert reflex.active, "somebody comes"
    reflex.approach.clear()
    reflex.try_other(0.1)
    assert not reflex.active


def test_what_was_given_up_is_forgotten_only_once_it_is_far():
    """Nearer than where a reflex ends it is the same that the arm found no way to leave."""
    far = CONFIG.reflex_distance + CONFIG.release
    for between, due in ((far - 0.01, False), (far + 0.01, True)):
        reflex = Reflex(CONFIG, ROBOT.limits)
        reflex.begin(0.1)
        reflex.stage = ReflexStage.FLEE
        reflex.try_other(0.1)
        assert not reflex.due(0.1)
        assert not reflex.due(between)
        assert reflex.due(0.1) == due


def test_the_nearest_pair_are_points_of_both_surfaces():
    body = MovingBody(ROBOT, ROBOT.limits.acceleration)
    still = np.zeros(6)
    center = body.motion(ROBOT.home, still)[0]
    for k, way in ((3, [0.0, 1.0, 0.0]), (7, [0.6, 0.0, -0.8]), (len(center) - 1, [1.0, 0.0, 0.0])):
        hazard = center[k] + 0.4 * np.array(way)
        hazards = Hazards.at(hazard[None], 0.0173)
        view = body.view(ROBOT.home, still, hazards, LAW)
        mine, other = body.pair(view, hazards, k)
        assert other == pytest.approx(hazard, abs=1e-6)
        assert np.linalg.norm(mine - center[k]) == pytest.approx(body.radius[k])
        assert np.linalg.norm(other - mine) == pytest.approx(view.distance[k] + 0.0173, abs=1e-6)
    hazards = Hazards.at(center[3][None], 0.0173)
    mine, _ = body.pair(body.view(ROBOT.home, still, hazards, LAW), hazards, 3)
    assert np.linalg.norm(mine - center[3]) == pytest.approx(body.radius[3], abs=1e-5)
    nobody = Hazards.at(np.empty((0, 3)), 0.0173)
    assert body.pair(body.view(ROBOT.home, still, nobody, LAW), nobody, 3) is None
