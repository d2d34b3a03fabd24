"""V's equations and Master, and our law on an arm with delayed drives."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.devices.data import JointState
from armsight.geometry.pose import inverse, look_at, transform
from armsight.robots import load_robot
from armsight.robots.kinematics import sphere_centers, tcp_jacobian, tcp_pose
from armsight.servoing.aim import (
    Aim,
    Weights,
    held_under,
    joint_velocity,
    joints_for,
    pose_error,
)
from armsight.servoing.approach import Funnel, facing, side, touch_aim
from armsight.servoing.ceiling import Ceiling
from armsight.servoing.docking import docking
from armsight.servoing.law import LawConfig, VelocityLaw
from armsight.servoing.master import Frustum, PaperMaster, Source
from armsight.servoing.modes import tool_direction
from armsight.servoing.segments import SegmentConfig, SegmentPlanner
from armsight.servoing.sighting import Look, Sighting
from armsight.tasks.servo import chase_config
from armsight.workcell import load_workcell, robot_in
from armsight.workcell.packaged import packaged

UR10 = load_robot("ur10")
HOME = np.deg2rad([-32, -20, -103, 123, 58, 0])
UP, FRONT = np.array([0, 0, -1.0]), np.array([1.0, 0, 0])


def look(camera, eye, place, stamp=1.0, wrist=False, target=(0.7, 0.0, 1.1)):
    sightings = ()
    if place is not None:
        at = np.asarray(place, float)
        sightings = (Sighting("ball", camera, stamp, at, np.eye(3) * 1e-6, at, None, wrist),)
    return Look(camera, stamp, wrist, look_at(eye, target), sightings)


CORNERS = {"fl": (1.7, 1.4, 2), "fr": (1.7, -1.4, 2), "br": (-1.3, -1.4, 2), "bl": (-1.3, 1.4, 2)}


def test_the_mean_of_the_two_closest_that_see_it():
    master = PaperMaster()
    places = {"fl": (0.71, 0, 1.1), "fr": (0.69, 0.02, 1.1), "br": (0.6, 0, 1.1), "bl": (0.8, 0, 1)}
    for name, eye in CORNERS.items():
        master.add(look(name, eye, places[name]))
    choice = master.choose(1.0)
    assert choice.source == Source.TWO
    assert set(choice.cameras) == {"fl", "fr"}
    assert np.allclose(choice.position, (0.70, 0.01, 1.1))


def test_a_camera_that_is_covered_is_left_out_and_one_alone_must_do():
    master = PaperMaster()
    for name, eye in CORNERS.items():
        master.add(look(name, eye, None if name == "fl" else (0.7, 0, 1.1)))
    assert "fl" not in master.choose(1.0).cameras
    for name in ("fr", "br"):
        master.add(look(name, CORNERS[name], None, 1.1))
    choice = master.choose(1.1)
    assert choice.source == Source.ALL
    assert choice.cameras == ("bl",)
    master.add(look("bl", CORNERS["bl"], None, 1.2))
    assert master.choose(1.2).source == Source.NONE


def test_the_pair_takes_over_five_centimetres_inside_and_hands_back_at_the_border():
    master, eye = PaperMaster(), np.array([0.4, 0.0, 1.1])
    frustum = Frustum()
    sources = []
    distances = np.concatenate([np.linspace(0.44, 0.25, 39), np.linspace(0.25, 0.44, 39)])
    for k, d in enumerate(distances):
        stamp = 1.0 + 0.1 * k
        place = eye + np.array((d, 0, 0))
        for name in ("fl", "fr"):
            master.add(look(name, CORNERS[name], place, stamp))
        master.add(look("wrist", eye, place, stamp, wrist=True, target=(2.0, 0.0, 1.1)))
        sources.append(master.choose(stamp).source)
    entered = next(d for d, s in zip(distances, sources) if s == Source.PAIR)
    last = max(k for k, s in enumerate(sources) if s == Source.PAIR)
    assert entered == pytest.approx(0.40 - 0.05, abs=0.006)
    assert distances[last] == pytest.approx(0.40, abs=0.006)
    assert len(master.switches) == 2
    assert frustum.depth_inside(look_at(eye, (2, 0, 1.1)), eye + np.array((0.3, 0, 0))) > 0.05


def test_the_pair_hands_back_as_soon_as_it_is_covered():
    master, eye = PaperMaster(), np.array([0.4, 0.0, 1.1])
    place = eye + np.array((0.28, 0, 0))
    master.add(look("fl", CORNERS["fl"], place + np.array((0.03, 0, 0))))
    master.add(look("wrist", eye, place, wrist=True, target=(2, 0, 1.1)))
    assert master.choose(1.0).source == Source.PAIR
    master.add(look("wrist", eye, None, 1.1, wrist=True, target=(2, 0, 1.1)))
    assert master.choose(1.1).source == Source.ALL
    assert PaperMaster(wrist=False).choose(1.0).source == Source.NONE


def planner():
    return SegmentPlanner(UR10, SegmentConfig(), UP, FRONT, -UP)


def run_segments(plan, target, seconds, q=HOME):
    rows = []
    for k in range(int(seconds / 0.008)):
        q, v = plan.waypoint(0.008 * k, q, target)
        rows.append((q, v))
    return np.array(rows)


def test_a_segment_goes_four_fifths_of_the_way_and_the_last_two_centimetres_whole():
    plan = planner()
    start = tcp_pose(UR10, HOME)[:3, 3]
    target = start + np.array((0.15, 0.05, 0.02))
    run_segments(plan, target, 0.3)
    first = tcp_pose(UR10, plan.running.end)[:3, 3]
    assert np.linalg.norm(first - (start + 0.8 * (target - start))) < 0.003
    rows = run_segments(plan, target, 8.0)
    end = tcp_pose(UR10, rows[-1, 0])[:3, 3]
    assert np.linalg.norm(end - target) < 0.001
    assert plan.iterations >= 3


def test_segments_keep_the_limits_and_come_to_rest_between():
    plan = planner()
    start = tcp_pose(UR10, HOME)[:3, 3]
    rows = run_segments(plan, start + np.array((0.2, 0.3, 0.1)), 6.0)
    limits = UR10.limits.scaled(0.5, 0.6)
    q, v = rows[:, 0], rows[:, 1]
    assert (np.abs(v) <= limits.velocity * 1.001).all()
    assert (np.abs(np.diff(v, axis=0) / 0.008) <= limits.acceleration * 1.02).all()
    assert np.abs(np.diff(q, axis=0) / 0.008 - v[1:]).max() < 0.05
    assert plan.running.at(plan.running.begin)[1] == pytest.approx(0)


def test_a_goal_outside_the_box_is_held_in_it():
    plan = planner()
    plan.config = SegmentConfig(upper=(0.6, 1.0, 1.0), lower=(-1, -1, -1))
    rows = run_segments(plan, np.array([1.2, 0.0, 0.7]), 6.0)
    assert tcp_pose(UR10, rows[-1, 0])[0, 3] == pytest.approx(0.6, abs=0.002)


@pytest.mark.parametrize("seed", range(5))
def test_joints_for_an_aim_reach_it_and_point(seed):
    rng = np.random.default_rng(seed)
    start = tcp_pose(UR10, HOME)[:3, 3]
    place = start + rng.uniform(-0.15, 0.15, 3)
    axis = facing(place, UP, FRONT)
    aim = Aim(place, np.zeros(3), axis, -UP)
    q = joints_for(UR10, aim, HOME, rounds=60)
    error = pose_error(UR10, q, aim)
    assert np.linalg.norm(error[:3]) < 5e-4
    assert np.linalg.norm(error[3:]) < 0.02
    v = np.array([0.1, -0.05, 0.02])
    dt = 1e-5
    moved = tcp_pose(UR10, q + dt * joint_velocity(UR10, q, v))[:3, 3]
    assert np.allclose((moved - tcp_pose(UR10, q)[:3, 3]) / dt, v, atol=0.004)


def test_the_tool_points_to_the_operators_side():
    for angle in np.linspace(-np.pi, np.pi, 25):
        axis = facing(np.array([np.cos(angle), np.sin(angle), 0.3]), UP, FRONT)
        assert axis @ FRONT >= np.cos(np.deg2rad(60)) - 1e-9
        assert abs(axis @ UP) < 1e-12
        if abs(angle) < np.deg2rad(60):
            assert np.arctan2(axis[1], axis[0]) == pytest.approx(angle)


def test_the_funnel_lets_nobody_touch_who_is_not_aligned():
    funnel = Funnel()
    axis, touched = FRONT, np.array([0.7, 0, 0.7])
    assert funnel.standoff(touched - 0.05 * axis, touched, axis) == 0.0
    assert funnel.standoff(touched + np.array((-0.05, 0.03, 0)), touched, axis) > 0.02
    assert funnel.standoff(touched + np.array((0.1, 0, 0)), touched, axis) == pytest.approx(
        funnel.most
    )


def test_what_is_pressed_is_pressed_by_a_tip_that_is_aligned():
    """A straw that goes on by 12 mm behind the surface met a face 18 mm beside its mouth."""
    funnel, touched = Funnel(gap=-0.012), np.array([0.7, 0, 0.7])

    def standoff(beside):
        return funnel.standoff(touched + np.array((-0.02, beside, 0)), touched, FRONT)

    assert standoff(0.0) == standoff(0.004) == -0.012
    assert -0.012 < standoff(0.006) < 0.0
    assert standoff(0.008) == 0.0
    assert standoff(0.02) > 0.01
    assert np.all(np.diff([standoff(b) for b in np.linspace(0.0, 0.1, 100)]) >= 0.0)


def test_what_is_round_is_touched_from_where_a_floating_tip_is_and_come_round_to_otherwise():
    """On its way the tip hardly enters the ball, also where it begins beside it."""
    middle, radius = np.array([0.7, 0.0, 0.7]), 0.04
    before = None
    for degrees in range(0, 111, 2):
        angle = np.deg2rad(degrees)
        out = np.array([-np.cos(angle), np.sin(angle), 0.0])
        tip = middle + (radius + 0.002) * out
        way, beside = side(tip, middle, FRONT)
        off = np.rad2deg(np.arccos(np.clip(way @ FRONT, -1, 1)))
        assert off == pytest.approx(min(degrees, 30.0), abs=1e-3)
        aim = touch_aim(tip, middle - radius * way, np.zeros(3), FRONT, -UP, Funnel(), beside)
        if degrees <= 30:
            assert aim.position == pytest.approx(middle + radius * out)
        else:
            assert (aim.position - middle) @ FRONT <= -radius * np.cos(np.deg2rad(30.0)) + 1e-9
        if before is not None and degrees <= 60:
            assert np.linalg.norm(aim.position - before) < 0.006, "it does not jump"
        before = aim.position
        steps = tip + np.linspace(0, 1, 200)[:, None] * (aim.position - tip)
        assert np.linalg.norm(steps - middle, axis=1).min() > radius - 0.004


class Drives:
    """An arm whose commands act later, with its reading; no ramp: the law has to bear the worst."""

    def __init__(self, q, delay, period=0.008):
        self.q, self.v = np.array(q), np.zeros(6)
        self.queue = [np.zeros(6)] * round(delay / period)
        self.period, self.now = period, 0.0
        self.limits = UR10.limits.scaled(0.5, 0.6)

    def step(self, command):
        self.queue.append(command)
        wanted = self.queue.pop(0)
        most = self.limits.acceleration * self.period
        self.v = self.v + np.clip(wanted - self.v, -most, most)
        self.q = self.q + self.period * self.v
        self.now += self.period
        return JointState(self.now, self.q.copy(), self.v.copy())


class Word:
    """The part of the guard's word that the law reads."""

    def __init__(self, stamp, command):
        self.stamp, self.command, self.wanted = stamp, command, None
        self.goal, self.reached, self.permit, self.reason = "", False, None, ""


def chase(target, seconds, delay=0.056, **settings):
    """Errors of the tip behind a target (position, velocity)(t), and the commands."""
    law = VelocityLaw(UR10, LawConfig(delay=0.056, **settings))
    drives = Drives(HOME, delay)
    joints = JointState(0.0, HOME, np.zeros(6))
    errors, commands = [], []
    for _ in range(int(seconds / 0.008)):
        now = drives.now
        place, velocity = target(now + 0.056)
        aim = Aim(place, velocity, FRONT, -UP)
        command = law.command(now, joints, aim)
        law.hear(Word(now, command))
        joints = drives.step(command)
        commands.append(command)
        errors.append(np.linalg.norm(tcp_pose(UR10, drives.q)[:3, 3] - target(drives.now)[0]))
    return np.array(errors), np.array(commands)


START = tcp_pose(UR10, HOME)[:3, 3]


def test_the_law_comes_to_a_target_at_rest_without_overshoot_and_stays():
    place = START + np.array((0.12, 0.1, 0.05))
    errors, commands = chase(lambda t: (place, np.zeros(3)), 3.0)
    assert errors[-60:].max() < 5e-4
    settled = int(np.argmax(errors < 0.004))
    assert errors[settled:].max() < 0.006
    assert (np.abs(commands) <= UR10.limits.scaled(0.5, 0.6).velocity * 1.0001).all()


def test_where_a_planned_way_ends_with_other_joints_the_law_goes_on_from_those():
    """It led the arm all the way back to the solution that it had been blocked on before."""
    aim = Aim(START + np.array((0.05, 0.05, 0.0)), np.zeros(3), FRONT, -UP)
    law = VelocityLaw(UR10, LawConfig())
    own = joints_for(UR10, aim, HOME, rounds=300)
    other = joints_for(UR10, aim, np.array((-1.2, -2.0, -2.0, 3.5, -0.1, -2.2)), rounds=300)
    for q in (own, other):
        assert np.linalg.norm(tcp_pose(UR10, q)[:3, 3] - aim.position) < 1e-3
    assert 1.0 < np.abs(other - own).max() < 3.0
    law.command(0.0, JointState(0.0, HOME, np.zeros(6)), aim)
    there = JointState(1.0, other, np.zeros(6))
    assert np.abs(law.command(1.0, there, aim)).max() > 0.5
    law.led()
    assert np.abs(law.command(1.008, there, aim)).max() < 0.02


def circle(t):
    w = 0.25 / 0.12
    place = START + np.array((0.08, 0.12 * np.sin(w * t), 0.12 * (1 - np.cos(w * t))))
    return place, 0.25 * np.array([0, np.cos(w * t), np.sin(w * t)])


def test_feed_forward_keeps_the_tip_on_a_circle_and_without_it_the_tip_trails():
    with_it, _ = chase(circle, 6.0)
    without, _ = chase(circle, 6.0, predict=False)
    assert np.sqrt(np.mean(with_it[250:] ** 2)) < 0.006
    assert np.sqrt(np.mean(without[250:] ** 2)) > 0.03


def test_three_times_the_gain_shows_the_limit_that_the_delay_sets():
    """The law believes in a delay of 56 ms; the drives take 200: the safe gain stays calm."""
    place = START + np.array((0.1, 0.1, 0.0))
    calm, _ = chase(lambda t: (place, np.zeros(3)), 5.0, delay=0.104)
    wild, _ = chase(lambda t: (place, np.zeros(3)), 5.0, delay=0.104, gain=60.0)
    assert calm[-100:].max() < 0.003
    assert wild[-100:].max() > 2 * calm[-100:].max()


def test_the_compiled_joints_are_those_of_its_plain_twin():
    rng = np.random.default_rng(2)
    for _ in range(20):
        q = HOME + rng.uniform(-0.5, 0.5, 6)
        axis = facing(rng.normal(0, 1, 3), UP, FRONT)
        aim = Aim(START + rng.uniform(-0.3, 0.3, 3), np.zeros(3), axis, -UP)
        assert np.allclose(joints_for(UR10, aim, q, rounds=3), plain_joints(aim, q, 3), atol=1e-9)


def plain_joints(aim, q, rounds):
    """V's eq. 2 in so many words of numpy."""
    weights = Weights()
    for _ in range(rounds):
        T = tcp_pose(UR10, q)
        z, y = T[:3, 2], T[:3, 1]
        turn = np.cross(z, aim.axis)
        sine = np.linalg.norm(turn)
        turn = turn * np.arctan2(sine, z @ aim.axis) / max(sine, 1e-9)
        down = aim.down - z * (z @ aim.down)
        down /= np.linalg.norm(down)
        roll = np.arctan2(np.cross(y, down) @ z, y @ down)
        error = np.concatenate([aim.position - T[:3, 3], turn + roll * z])
        W = weights.position * np.eye(6)
        along = np.outer(z, z)
        W[3:, 3:] = weights.axis * (np.eye(3) - along) + weights.roll * along
        A = W @ tcp_jacobian(UR10, q)
        step = np.linalg.solve(A.T @ A + np.diag(weights.posture**2), A.T @ (W @ error))
        step *= min(1.0, 0.25 / np.abs(step).max())
        q = np.clip(q + step, UR10.limits.lower + 0.01, UR10.limits.upper - 0.01)
    return q


def under(height, path):
    """Whether the arm stays under a height, link by link, at each of (k, n) joints."""
    rises = UR10.spheres.link > 1
    tops = [(sphere_centers(UR10, q) @ UP + UR10.spheres.radius)[rises].max() for q in path]
    return max(tops) < height + 0.002


def test_under_a_ceiling_the_tool_points_otherwise_before_the_arm_rises():
    """A ball in the upper half of the cell was come to with the elbow above what is mapped."""
    rng, ceiling = np.random.default_rng(0), Ceiling(UP, 0.0)
    missed = 0
    for _ in range(30):
        place = np.array([rng.uniform(0.6, 0.9), rng.uniform(-0.3, 0.3), rng.uniform(0.45, 0.9)])
        axis = facing(place, UP, FRONT) * np.cos(0.5) - np.sin(0.5) * UP
        aim = Aim(place, np.zeros(3), axis, -UP)
        free = joints_for(UR10, aim, HOME, rounds=200)
        q = joints_for(UR10, aim, HOME, rounds=200, ceiling=ceiling)
        assert under(0.0, [q])
        if under(-0.03, [free]):
            assert np.abs(q - free).max() < 1e-3  # far below it nothing changes
        missed += np.linalg.norm(pose_error(UR10, q, aim)[:3]) > 0.002
    assert missed <= 3


@pytest.mark.parametrize("high", [False, True])
def test_a_target_that_is_pulled_up_leads_no_part_above_the_ceiling_and_down_again(high):
    """Up by 25 cm at once, and down after 3 s: the arm goes along as far as it may, and returns.
    Without a ceiling it rises above it, as it did in the browser."""
    low, up = np.array([0.85, -0.02, 0.66]), np.array([0.85, -0.02, 0.35])
    ceiling = None if high else Ceiling(UP, 0.0)
    law = VelocityLaw(UR10, LawConfig(delay=0.056, ceiling=ceiling))
    drives, joints = Drives(HOME, 0.056), JointState(0.0, HOME, np.zeros(6))
    path, errors = [], []
    for k in range(1000):
        place = up if 375 <= k < 700 else low
        axis = np.array([np.cos(0.5), 0.0, np.sin(0.5)])
        command = law.command(drives.now, joints, Aim(place, np.zeros(3), axis, -UP))
        law.hear(Word(drives.now, command))
        joints = drives.step(command)
        path.append(drives.q.copy())
        errors.append(np.linalg.norm(tcp_pose(UR10, drives.q)[:3, 3] - place))
    assert under(0.005, path) != high
    assert errors[374] < 0.002
    assert errors[-1] < 0.002


def test_an_arm_above_its_ceiling_comes_down_and_one_below_is_held_the_least():
    rng, ceiling = np.random.default_rng(3), Ceiling(UP, 0.0)
    raised = UR10.home.copy()
    raised[1] = 0.3
    assert ceiling.under(UR10, raised) < 0.0
    for q in (UR10.home, raised):
        room = ceiling.under(UR10, q)
        for _ in range(20):
            wanted = rng.normal(0, 1, 6)
            held = held_under(UR10, q, wanted, ceiling)
            rises = (room - ceiling.under(UR10, q + 1e-6 * held)) / 1e-6
            assert rises <= 4.0 * room + 1e-3
            free = (room - ceiling.under(UR10, q + 1e-6 * wanted)) / 1e-6
            if free <= 4.0 * room - 1e-3:
                assert np.array_equal(held, wanted)


def test_a_ceiling_leaves_an_arm_the_room_that_it_needs_at_home():
    given = Ceiling(UP, -0.2)  # below the shoulder
    fitted = given.above(UR10)
    assert fitted.under(UR10, UR10.home) >= 0.03 - 1e-9
    assert Ceiling(UP, 0.5).above(UR10).height == 0.5


def test_no_way_is_planned_to_where_the_arm_would_have_to_rise_above_its_ceiling():
    law = VelocityLaw(UR10, LawConfig(ceiling=Ceiling(UP, 0.0)))
    joints = JointState(0.0, HOME, np.zeros(6))
    axis = np.array([np.cos(0.5), 0.0, np.sin(0.5)])
    for z, way in ((0.7, "as wished"), (0.5, "otherwise"), (0.1, None)):
        aim = Aim(np.array([0.8, 0.0, z]), np.zeros(3), axis, -UP)
        for _ in range(60):
            law.command(0.0, joints, aim)
        T = law.pose(aim)
        assert (T is None) == (way is None)
        if T is not None:
            assert np.linalg.norm(T[:3, 3] - aim.position) < 0.01
            assert (T[:3, 2] @ axis > 0.9999) == (way == "as wished")


def test_what_is_close_to_the_base_is_come_to_from_above() -> None:
    """There the wrist would come over the base's axis: half of the arm's slowest way is left."""
    workcell = load_workcell(packaged()["ur10_servoing"])
    robot = robot_in(workcell)
    config = chase_config(workcell, workcell.robot.T_world_base, docking("ball"))
    T = np.asarray(inverse(workcell.robot.T_world_base))

    def slowest(place: np.ndarray, axis: np.ndarray) -> float:
        aim = Aim(place - 0.04 * axis, np.zeros(3), axis, -config.vertical)
        q = joints_for(robot, aim, robot.home, rounds=300)
        assert np.linalg.norm(tcp_pose(robot, q)[:3, 3] - aim.position) < 2e-3
        return float(np.linalg.svd(tcp_jacobian(robot, q))[1][-1])

    for x, gains in ((0.44, 1.4), (0.50, 1.1)):
        place = transform(T, np.array([[x, 0.0, 1.3]]))[0]
        axis, _ = tool_direction(config, place, None)
        flat = facing(place, config.vertical, config.front)
        flatter = np.cos(config.pitch) * flat - np.sin(config.pitch) * config.vertical
        assert slowest(place, axis) > gains * slowest(place, flatter)
    far = transform(T, np.array([[0.8, 0.0, 1.3]]))[0]
    axis, _ = tool_direction(config, far, None)
    assert axis @ config.vertical == pytest.approx(-np.sin(config.pitch))
