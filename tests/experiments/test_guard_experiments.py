"""Patrol, approach and false-stops: what they make up, how they count, what they say."""

import contextlib
import os
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from toy_episode import doubled

from armsight.errors import ArmsightError
from armsight.experiments import (
    approach_episode,
    approach_people,
    approach_permit,
    approach_use,
    episodes,
    false_stops,
    hand_search,
    patrol,
)
from armsight.experiments.approach_rows import contact_rows
from armsight.experiments.cache import RunCache
from armsight.motion.data import GuardMode, GuardStatus
from armsight.motion.guard_config import GuardConfig


def status(stamp, mode, reached=False, reason=""):
    return GuardStatus(
        stamp,
        mode,
        reason,
        "A",
        reached,
        np.zeros(6),
        0.0,
        1.0,
        0.5,
        None,
        None,
        None,
        None,
        0,
        0.0,
    )


# -- runs that go on where they stopped -------------------------------------------------------


def never(seed, run):
    raise AssertionError("computed although it was remembered")


def test_remembered_runs_are_not_done_again(tmp_path, monkeypatch):
    monkeypatch.setenv("ARMSIGHT_CACHE", str(tmp_path))
    for run in range(3):
        RunCache("toy", 5, {"a": 1}).get(run, lambda run=run: {"run": run})
    told = []
    found = episodes.run_episodes(
        "toy", never, range(3), 5, lambda stage, done: told.append(done), {"a": 1}
    )
    assert [f["run"] for f in found] == [0, 1, 2]
    assert told == [1.0]


@pytest.mark.parametrize("workers", [1, 2])
def test_worn_out_workers_are_replaced(tmp_path, monkeypatch, workers):
    """One worker that replaced itself hung for ever after its first batch."""
    monkeypatch.setenv("ARMSIGHT_CACHE", str(tmp_path))
    monkeypatch.setattr(episodes, "FRESH", 2)
    monkeypatch.setattr(episodes, "WORKERS", workers)
    found = episodes.run_episodes("toy", doubled, range(5), 7, lambda stage, done: None)
    assert found == [doubled(7, run) for run in range(5)]


def test_a_package_that_changes_on_the_way_ends_the_experiment(tmp_path, monkeypatch):
    """Workers load it as it is when they start: half of the runs would be another code's."""
    monkeypatch.setenv("ARMSIGHT_CACHE", str(tmp_path))
    monkeypatch.setattr(episodes, "code_digest", lambda: "of files that were changed since")
    with pytest.raises(ArmsightError, match="files have changed"):
        episodes.run_episodes("toy", doubled, range(1), 7, lambda stage, done: None)


PARENT = """
from armsight.experiments import episodes
from toy_episode import waits
episodes.run_episodes("toy", waits, range(1), 7, lambda stage, done: None)
"""


def test_a_worker_ends_with_its_parent(tmp_path):
    """One whose parent had been killed waited for work for ever, with all its memory."""
    here = str(Path(__file__).parent)
    path = os.pathsep.join([here, *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "ARMSIGHT_CACHE": str(tmp_path), "PYTHONPATH": path}
    parent = subprocess.Popen([sys.executable, "-c", PARENT], env=environment)
    try:
        worker = int(_until(lambda: (tmp_path / "worker").read_text("utf-8")))
    finally:
        parent.kill()
        parent.wait()
    _until(lambda: not Path(f"/proc/{worker}").exists())


def _until(ask):
    """What it says as soon as that is something; fails after a minute."""
    for _ in range(600):
        with contextlib.suppress(OSError):
            if said := ask():
                return said
        time.sleep(0.1)
    pytest.fail("nothing happened")


# -- false stops ------------------------------------------------------------------------------


def test_a_stop_counts_once_and_only_with_a_goal_to_reach():
    P, S, R = GuardMode.PREDICTIVE, GuardMode.STOPPED, GuardMode.REFLEX
    log = [status(k, mode) for k, mode in enumerate([P, S, S, P, R, S, P, P])]
    assert false_stops.stops(log) == 2
    assert false_stops.stops([status(0, S), *log]) == 3
    assert false_stops.stops([status(0, P), status(1, S, reached=True)]) == 0
    assert false_stops.stops([]) == 0


def test_reasons_count_together_whatever_their_figures():
    a = "unseen space 0.43 m from wrist_3_link, at (1.07, 0.29, -0.15)"
    b = "unseen space 0.51 m from wrist_3_link, at (1.11, 0.01, -0.15)"
    assert false_stops.kind(a) == false_stops.kind(b.replace("wrist_3", "wrist_2")) != ""


# -- patrol -----------------------------------------------------------------------------------


def test_the_obstacle_is_the_same_for_every_method_and_never_too_fast():
    made = [patrol.Obstacle("moving", np.random.default_rng((3, 1))) for _ in range(2)]
    times = np.arange(0.0, 60.0, 0.02)
    first, second = (np.array([o.target(t) for t in times]) for o in made)
    np.testing.assert_array_equal(first, second)
    speeds = np.linalg.norm(np.diff(first, axis=0), axis=1) / 0.02
    assert speeds.max() <= patrol.SPEED * 1.001
    away = np.linalg.norm(first - patrol.AWAY, axis=1)
    assert away.min() == 0.0
    inside = (np.abs(first - patrol.IN) <= patrol.SPREAD + 1e-9).all(axis=1)
    assert 0.05 < inside.mean() < 0.6


def test_the_static_obstacle_stays_where_the_first_visit_goes():
    obstacle = patrol.Obstacle("static", np.random.default_rng(0))
    np.testing.assert_array_equal(obstacle.target(0.0), obstacle.target(55.5))
    assert (np.abs(obstacle.target(0.0) - patrol.IN) <= patrol.SPREAD).all()


class Reached:
    def __init__(self, times):
        self.times = times


def test_a_round_that_was_broken_off_counts_as_the_limit():
    whole = patrol.Rounds(Reached([2.0 + 3.0 * k for k in range(2 * patrol.ROUNDS + 1)]))
    assert whole.executions() == [6.0] * patrol.ROUNDS
    assert patrol.Rounds(Reached([2.0, 5.0, 8.0, 11.0])).executions() == [6.0, patrol.LIMIT]
    assert patrol.Rounds(Reached([])).executions() == [patrol.LIMIT]


def test_the_baseline_needs_only_room_to_stop():
    baseline = patrol.reactive(GuardConfig())
    assert baseline.separation.protective_distance(0.0, 0.2, 5.0) == pytest.approx(0.02)
    assert baseline.separation.person_speed == 0.0
    assert not baseline.risk.reflexive(10.0, 0.01)


def rounds(condition, executions, contacts=0):
    return {
        "condition": condition,
        "executions": executions,
        "planned": [2.0, 2.0, 2.0],
        "planning": [0.01],
        "optimisation": [0.02],
        "contacts": contacts,
        "reflexes": 1,
        "replans": 3,
    }


def test_ratio_is_of_means_and_budgets_are_ours_alone():
    by = {name: [rounds(name, [6.0, 6.0]), rounds(name, [6.0, 6.0])] for name in patrol.CONDITIONS}
    by["3 ours, moving"] = [rounds("", [6.0, 12.0]), rounds("", [9.0, 9.0], contacts=1)]
    by["direct, nobody inside"] = [rounds("", [5.0, 5.0])]
    rows = patrol._rows(by, np.random.default_rng(0))
    assert len({(r.key, r.condition) for r in rows}) == len(rows)
    ratio = {r.condition: r for r in rows if r.key == "patrol_ratio"}
    assert ratio["3 ours, moving"].value == pytest.approx(1.5)
    assert ratio["3 ours, moving"].met is False
    assert ratio["4 ours, static"].value == pytest.approx(1.2), "both have the word"
    assert ratio["1 reactive, static"].met is None
    contacts = {r.condition: r for r in rows if r.key == "contacts"}
    assert contacts["3 ours, moving"].value == 1
    assert contacts["3 ours, moving"].met is False


# -- approach ---------------------------------------------------------------------------------


@pytest.mark.parametrize("run", range(12))
def test_visitors_come_from_the_seed_and_stand_clear_of_the_base(run):
    cap = approach_episode.CAPS[run % 2]
    first = approach_people.visitor(np.random.default_rng((0, run)), run, cap)
    assert first == approach_people.visitor(np.random.default_rng((0, run)), run, cap)
    assert first.max_hand_speed == cap
    assert first.start_s < approach_people.SECONDS
    if approach_people.from_afar(run):
        assert np.hypot(*first.position[:2]) > 3.0
    if first.motion == "script":
        assert np.hypot(*first.position[:2]) > 0.9
    else:
        assert episodes.find_clips()


def seen(contacts=0, cap=1.6):
    return {
        "cap": cap,
        "how": "wave",
        "led": False,
        "contacts": contacts,
        "other_contacts": 0,
        "standing_contacts": 2,
        "worst": [],
        "least": 0.1,
        "least_moving": 0.3,
        "goals": 2,
        "reflexes": 0,
        "moved": 0.5,
        "stopped": 0.2,
        "trace": {},
    }


def test_contacts_are_counted_by_cap_and_a_single_one_misses():
    hunts = [
        {"cap": c, "margin": 0.1, "genes": [], "contacts": 0, "trials": 60} for c in (1.6, 2.0)
    ]
    rows = contact_rows([seen(), seen(cap=2.0), seen(contacts=1, cap=2.0)], hunts)
    assert len({(r.key, r.condition) for r in rows}) == len(rows)
    found = {(r.key, r.condition): r for r in rows}
    assert found["contacts", "all episodes"].met is False
    assert found["contacts", "hands up to 1.6 m/s"].met
    share = found["contact_share", "all episodes"]
    assert share.value == pytest.approx(1 / 3)
    assert share.low < 1 / 3 < share.high
    assert found["search_contacts", "hand at 2.0 m/s"].met


def looked_at(distance, speed, around, afar, goals=1):
    return {
        "distance": [distance] * 100,
        "tip_speed": [speed] * 100,
        "around": [around] * 100,
        "from_afar": afar,
        "goals": goals,
    }


def test_what_an_arm_is_good_for_is_counted_beside_what_others_would_allow():
    """Reckoned by hand: K + v_h T_r is 0.25 m for T_r = 0.1 s and 0.47 m for the baselines."""
    alone = [{"goals": 2, "speed": 0.5, "top": 0.9, "reach": 0.7}]
    rows = approach_use.use_rows(
        [
            looked_at(0.2, 0.0, 0.6, False),  # too near for anybody
            looked_at(0.40, 0.3, 1.0, False),  # the arm goes on; distance alone would stop it
            looked_at(1.2, 0.0, 1.8, True),  # it could, and does not
            looked_at(3.0, 0.5, 3.5, True, goals=3),  # nobody is near
        ],
        alone,
        15.0,
    )
    found = {(r.key, r.condition): r.value for r in rows}
    assert found["never_moved", "somebody near from the start"] == 0.5
    assert found["never_moved", "nobody near at first"] == 0.5
    assert found["moving_share_near", "all episodes"] == 0.5
    assert found["goals_per_minute", "all episodes"] == pytest.approx(1.5 * 15.0)
    assert found["empty_goals_per_minute", "all episodes"] == 30.0
    # S_p of the full speed: 2.0 (0.21 + 0.3) + 0.9 * 0.21 + 0.135 + 0.05 = 1.394 m beyond 0.7 m.
    assert found["zone_goals_per_minute", "all episodes"] == pytest.approx(0.25 * 30.0)
    slow = approach_use.distance_alone([looked_at(0.76, 0.0, 1.0, False)], 0.5)
    v = 0.5 * slow
    there = approach_use.Separation().protective_distance(v, 0.21, approach_use.BRAKE)
    assert there == pytest.approx(0.76)
    assert found["ssm_goals_per_minute", "all episodes"] == pytest.approx(0.5 * 30.0)


def test_a_hand_in_a_part_that_stands_is_no_contact_while_the_wrist_still_moves():
    # The search counted two hands in an upper arm that stood, the wrist coming to rest at 0.06 m/s.
    def touched(joint, link):
        cell = hand_search.QuickCell([])
        center, _ = cell.guard.body.motion(cell.q, cell.v)
        place = center[np.flatnonzero(cell.guard.body.link == link)[-1]]
        cell.balls = [hand_search.Ball(lambda t: place)]
        velocity = np.zeros(cell.robot.n)
        velocity[joint] = 0.5
        cell.send(velocity)
        cell.drive(0.4)
        assert min(m.distance for m in cell.margins) < 0.0
        assert cell.moving_touches, "some part of the arm moves"
        return min(m.moving for m in cell.margins)

    wrist, upper_arm = 3, 2
    assert touched(wrist, upper_arm) > 0.2
    assert touched(wrist, 6) < 0.0
    assert touched(0, upper_arm) < 0.0


def test_a_hunting_hand_keeps_to_its_speed():
    genes = np.array([0.2, 0.4, 1.0, 0.7, 0.9, 0.1])
    hunter = hand_search.Hunter(genes, 2.0)
    cell = hand_search.QuickCell(hunter.balls(), hand_search.GOALS, rate=15.0)
    hunter.cell = cell
    cell.run(1.6)
    path = np.array([hunter.at(t) for t in np.arange(0.0, 1.6, hand_search.DT)])
    speeds = np.array([np.linalg.norm(b - a) for a, b in pairwise(path)]) / hand_search.DT
    assert speeds[: round(0.65 / hand_search.DT)].max() == 0.0
    assert 1.9 < speeds.max() <= 2.0 + 1e-9
    assert min(m.distance for m in cell.margins) < 0.3
    assert not cell.moving_touches


@pytest.mark.slow
def test_an_episode_of_each_kind_touches_nobody(gl):
    for run in (3, 5):
        found = approach_episode.episode(1000, run)
        assert found["contacts"] == 0
        assert found["moved"] > 0.2
    assert found["led"]


# -- approach-permit: a search about what is touched -------------------------------------------


def test_a_hunter_waits_about_what_is_touched():
    ball = np.array([0.4, -0.3, 0.3])
    at = hand_search.Hunter(np.array([0.5, 0.2, 0.9, 3.0, 0.5, 0.1]), 2.0, ball).at(0.0) - ball
    assert np.hypot(at[0], at[1]) == pytest.approx(0.9)
    assert np.arctan2(at[1], at[0]) == pytest.approx(0.5)
    assert at[2] == pytest.approx(0.2)


@pytest.mark.parametrize(("away", "contacts"), [(0.0, 0), (5.0, 2)])
def test_a_touch_within_the_region_is_none_and_one_outside_is(monkeypatch, away, contacts):
    """The search counts by where the hand was: here the region is taken away from the hand."""

    class Beside(hand_search.Hunter):
        def balls(self):
            return [hand_search.Ball(lambda t: ball, 0.05)]

        def at(self, time):
            return ball + away

    ball = approach_permit._Touched(np.random.default_rng((0, 9, 2)), 1).place
    monkeypatch.setattr(approach_permit, "Hunter", Beside)
    monkeypatch.setattr(approach_permit, "MOVING", 0.0)
    monkeypatch.setattr(hand_search, "GENERATIONS", 1)
    monkeypatch.setattr(hand_search, "POPULATION", 2)
    found = approach_permit.search(0, 2)
    assert found["kind"] == "hand"
    assert found["trials"] == 2
    assert found["contacts"] == contacts
