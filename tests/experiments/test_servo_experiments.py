"""The model of the cameras, and a whole trial without pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armsight.experiments.servo_accuracy import fixed
from armsight.experiments.servo_ball import LIMIT, _drawn, joints_before, one, path_of, waypoints
from armsight.experiments.servo_eyes import RADIUS, Errors
from armsight.experiments.servo_world import Trial, make_eyes, make_task, set_up, world_to_base
from armsight.robots.kinematics import sphere_centers, tcp_pose

EXACT = Errors(*[0.0] * 10)


def test_exact_cameras_say_what_is_so_and_say_it_late():
    setup = set_up()
    eyes = make_eyes(setup, EXACT, np.random.default_rng(0))
    place = world_to_base(setup, [[0.8, 0.1, 1.2]])[0]
    for k in range(60):
        eyes.expose(0.008 * k, setup.robot.home, lambda t: place)
    assert eyes.arrived(0.05) == ()
    newest = {p.perceiver: p.evidence.looks[0] for p in eyes.arrived(0.6)}
    assert set(newest) == {f"eye/{c.name}" for c in setup.workcell.camera} | {"eye/wrist"}
    for look in newest.values():
        assert look.sightings
        assert np.allclose(look.sightings[0].position, place, atol=1e-9)
        away = np.linalg.norm(look.sightings[0].surface - place)
        if not look.wrist:  # its planes end at 0.40 m
            assert 0.5 * RADIUS < away < 1.1 * RADIUS
    assert np.allclose(newest["eye/wrist"].mark, 0.0, atol=1e-12)


def test_what_stands_before_a_ball_hides_it():
    setup = set_up()
    eyes = make_eyes(setup, EXACT, np.random.default_rng(0))
    eye = eyes.fixed[0].true[:3, 3]
    wrist = tcp_pose(setup.robot, setup.robot.home)[:3, 3]
    behind = wrist + 0.3 * (wrist - eye) / np.linalg.norm(wrist - eye)
    assert eyes._covered(setup.robot.home, eye, behind)
    assert not eyes._covered(setup.robot.home, eye, wrist + 0.3 * (eye - wrist))


def test_a_guarded_trial_comes_to_the_ball_by_permit_and_does_no_harm():
    setup = set_up(1.0, 1.0)
    rng = np.random.default_rng(5)
    eyes = make_eyes(setup, Errors(), rng)
    place = world_to_base(setup, [[0.85, 0.1, 1.25]])[0]
    task = make_task(setup, "ours")
    trial = Trial(setup, eyes, task, lambda t: place, setup.robot.home)
    course = trial.run(4.0, until=lambda c: c.gap[-1] < 0.005)
    assert course.gap[-1] < 0.005
    assert course.nudges.harm == 0
    assert course.permits & {"granted", "granted less"}


@pytest.mark.parametrize("trial", [(61, 18), (12, 14)])
def test_a_ball_that_turns_as_the_tip_comes_is_not_pushed_through_the_spring(trial):
    """Both were: cameras said late how it turned, and the tip pressed it 33 and 29 mm deep."""
    setup = set_up(1.0, 1.0)
    found = one(setup, "ours", "moving", Errors(), trial)
    assert found["reached"]
    assert found["harm"] == 0
    assert found["press"] < 0.030  # the spring's travel


@pytest.mark.usefixtures("shared_data")
def test_a_hand_that_was_swung_about_is_not_chased_in_its_first_pause():
    """It was, at 0.2 m/s; it came back, the permit ended, and the tip pushed on for 5 ticks."""
    found = one(set_up(1.0, 1.0), "ours", "recorded", Errors(), (14, 46))
    assert found["reached"]
    assert found["harm"] == 0


def test_the_box_of_v_has_fourteen_places_that_the_arm_can_stand_before():
    setup = set_up()
    places = waypoints(setup)
    assert places.shape == (14, 3)
    assert np.allclose(np.ptp(places, axis=0), (0.5, 1.0, 0.5))
    for place in places:  # two corners were 0.2 and 0.3 m out of reach, and every third was tested
        tip = tcp_pose(setup.robot, joints_before(setup, place))[:3, 3]
        assert np.linalg.norm(tip - place) == pytest.approx(0.09, abs=0.001)


def test_paths_keep_their_speed_and_trials_repeat_bit_for_bit():
    rng = np.random.default_rng(3)
    path = path_of(np.array([0.7, 0.0, 0.7]), 0.3, rng)
    steps = [np.linalg.norm(path(t + 0.01) - path(t)) / 0.01 for t in np.arange(0, 20, 0.1)]
    assert max(steps) <= 0.36
    setup = set_up(1.0, 1.0)
    first, again = (one(setup, "ours", "rest", Errors(), (0, 3)) for _ in range(2))
    assert first == again


def test_v_s_errors_cost_v_s_mode_about_what_v_reports():
    """38 mm by V; the filter with a bias for each camera does better under the same errors."""
    from armsight.experiments.servo_eyes import PAPERS

    paper = np.median([np.median(fixed("paper", PAPERS, 7, k)) for k in range(3)])
    ours = np.median([np.median(fixed("ours", PAPERS, 7, k)) for k in range(3)])
    assert 19.0 < paper < 76.0
    assert ours < paper


def test_a_bullseye_is_docked_with_near_its_centre():
    from armsight.experiments.servo_bullseye import CELL
    from armsight.experiments.servo_bullseye import one as dock

    trial = dock(set_up(1.0, 1.0, CELL), "ours", Errors(), (901, 0))
    assert trial["mm"] < 5.0
    assert trial["harm"] == 0


def test_an_item_lands_on_a_palm_and_nobody_is_pressed():
    from armsight.experiments.servo_handover import CELL
    from armsight.experiments.servo_handover import one as hand_over

    trial = hand_over(set_up(1.0, 1.0, CELL), "ours", replace(Errors(), arm=0.0), (901, 1))
    assert trial["phase"] == "done"
    assert trial["mm"] < 30.0
    assert not trial["harm"]


def test_a_straw_stays_at_a_mouth_gently_though_the_map_shows_nothing_there():
    """The self-filter takes the face around the straw out of the map; in the rendered cell the
    force sensor was tared in contact by that, and the face pressed with 32 N. Three seconds."""
    from armsight.experiments.servo_straw import CELL
    from armsight.experiments.servo_straw import one as bring

    trial = bring(set_up(1.0, 1.0, CELL), "ours", replace(Errors(), arm=0.0), (901, 3))
    assert trial["touched"]
    assert trial["force"] < 5.0
    assert not trial["harm"]


def test_no_straw_s_trial_begins_with_the_wrist_in_the_forearm():
    """Trial 18 of seed 21 did, by 21 mm, and was counted as one that the arm lost."""
    from armsight.experiments.servo_straw import CELL, PLACES, _start
    from armsight.geometry.pose import from_rpy, inverse
    from armsight.motion.collision import CollisionModel
    from armsight.motion.kernels import body_centers, self_clearance

    setup = set_up(1.0, 1.0, CELL)
    upright = from_rpy((0.5 * np.pi, 0.0, -0.5 * np.pi))
    model = CollisionModel(setup.robot)
    for k in (2, 13, 18):
        rng = np.random.default_rng((21, k, 13))
        turn, off = rng.uniform(-0.25, 0.25, 3), rng.uniform(-0.03, 0.03, 3)
        T = inverse(setup.workcell.robot.T_world_base) @ from_rpy(turn, PLACES[k % 4] + off)
        q = _start(setup, T @ upright, k // 4 % 6)
        body_centers(model.body, q, model.scratch().centers)
        assert self_clearance(model.body, model.scratch().centers) > 0.0
        assert np.linalg.norm(tcp_pose(setup.robot, q)[:3, 3] - T[:3, 3]) < 0.4


def test_what_is_printed_on_a_face_is_seen_and_holds_no_straw_from_behind():
    from armsight.experiments.servo_cell import PushedCell, plate
    from armsight.experiments.servo_straw import CELL
    from armsight.simulation.targets import TargetSpec, target_object

    setup = set_up(1.0, 1.0, CELL)
    face = replace(target_object(TargetSpec("face", "smiley", np.eye(4))), mass=4.4, surface=150.0)
    middle = np.array([0.8, 0.0, 0.7])
    cell = PushedCell(
        setup, plate((0.24, 0.24), 0.12, np.eye(3), middle), lambda t: middle, setup.robot.home,
        face, np.eye(4),
    )  # fmt: skip
    model = cell.world.truth._cell.model
    touched = [g for g in range(model.ngeom) if model.geom_contype[g]]
    skin = [g for g in touched if model.body(model.geom_bodyid[g]).name == "face/skin"]
    cell.close()
    assert len(skin) == 1
    assert model.geom_size[skin[0]].min() > 0.05


@pytest.mark.parametrize("k", [1, 17, 105])
def test_no_ball_is_led_through_the_arm_where_it_begins(k):
    """Trial 17 of seed 16 was: the ball's stand pressed the upper arm with 26 N."""
    setup = set_up(1.0, 1.0)
    _, ball, _, _, start = _drawn(setup, "moving", Errors(), (16, k))
    way = np.array([ball(t) for t in np.arange(0.0, LIMIT, 0.02)])
    robot = setup.robot
    center, radius = sphere_centers(robot, start), robot.spheres.radius
    stylus = np.linalg.norm(center - tcp_pose(robot, start)[:3, 3], axis=1) < 0.07
    gap = np.linalg.norm(center[~stylus, None] - way[None], axis=2) - radius[~stylus, None]
    assert gap.min() > RADIUS - 1e-3
