"""Contact permits: what is granted, what it changes, and that nothing else changes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.experiments.quick_cell import Ball, QuickCell
from armsight.geometry.pose import from_rpy, make_pose
from armsight.motion.collision import CollisionModel
from armsight.motion.contact_speed import ContactSpeed
from armsight.motion.guard_config import GuardConfig
from armsight.motion.intents import VelocityIntent
from armsight.motion.nearest import Hazards
from armsight.motion.permits import PermitRequest, PermitState, granted, request_fault
from armsight.motion.permitted import Grant, permitted, somebody_beside
from armsight.motion.regions import Region, region_fault
from armsight.motion.separation_monitor import SeparationMonitor
from armsight.robots import load_robot, load_tool
from armsight.robots.kinematics import tcp_pose

from .scenes import CubeOracle, ball, make_snapshot

RADIUS = 0.03


def sphere(center, exposure=0.0, radius=RADIUS, **more):
    return Region("sphere", (radius, 0.0, 0.0), make_pose(None, center), exposure, **more)


def request(region, **more):
    given = {"parts": ("wrist_3_link",), "reach": 0.12, "speed": 0.02, "seconds": 30.0}
    return PermitRequest("ball", "thing", region, **(given | more))


# -- regions --------------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), shape=st.sampled_from(["sphere", "box", "capsule"]))
def test_distances_to_a_region_are_those_to_densely_sampled_matter(seed, shape):
    rng = np.random.default_rng(seed)
    size = tuple(rng.uniform(0.03, 0.2, 3))
    T = from_rpy(rng.uniform(-3, 3, 3), rng.uniform(-1, 1, 3))
    region = Region(shape, size, T, 1.0, velocity=rng.uniform(-1, 1, 3))
    when = rng.uniform(1.0, 2.0)
    if shape == "capsule":
        core = np.linspace(-0.5, 0.5, 400)[:, None] * size[1] * np.array([0, 0, 1.0])
    elif shape == "box":
        axes = [np.linspace(-0.5, 0.5, 41) * s for s in size]
        core = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    else:
        core = np.zeros((1, 3))
    matter = core @ T[:3, :3].T + T[:3, 3] + (when - 1.0) * np.asarray(region.velocity)
    points = matter.mean(axis=0) + rng.normal(size=(20, 3)) * 0.3
    expected = np.linalg.norm(points[:, None] - matter[None], axis=2).min(axis=1)
    expected -= 0.0 if shape == "box" else size[0]
    got = region.distance(points, when)
    outside = expected > 0.02
    assert got[outside] == pytest.approx(expected[outside], abs=0.006)
    # From inside, too, one gets away as it names, and out at the nearest place.
    out = region.outward(points, when)
    assert region.distance(points + 0.005 * out, when) == pytest.approx(got + 0.005, abs=1e-6)
    # Along the way that it names, the distance falls as fast as one goes.
    step = points + 0.005 * region.towards(points, when)
    assert region.distance(step, when)[outside] == pytest.approx(got[outside] - 0.005, abs=1e-6)


@pytest.mark.parametrize("shape", ["sphere", "box", "capsule"])
def test_a_lattice_stands_for_all_of_a_region_and_nothing_else(shape):
    """Every place in it is within half a cube's diagonal of a point, but for its very skin."""
    region = Region(shape, (0.08, 0.12, 0.1), from_rpy((0.3, 0.4, 0.5), (0.4, 0.1, 0.3)), 1.0,
                    velocity=np.array([0.1, 0.0, 0.0]))  # fmt: skip
    points = region.lattice(2.0, 0.03)
    assert (region.distance(points, 2.0) <= 1e-6).all()
    assert np.linalg.norm(points - region.center(2.0), axis=1).min() < 1e-9
    rng = np.random.default_rng(0)
    within = region.center(2.0) + rng.uniform(-1, 1, (9000, 3)) * 0.5 * region.extent
    within = within[region.distance(within, 2.0) < -0.03]
    assert len(within) > 20
    away = np.linalg.norm(within[:, None] - points[None], axis=2).min(axis=1)
    assert away.max() <= 0.5 * np.sqrt(3.0) * 0.03 + 1e-9
    half = region.half_box()
    assert (np.abs(points - region.center(2.0)) <= half + 1e-9).all()
    everything = region.center(2.0) + rng.uniform(-1, 1, (4000, 3)) * 0.5 * region.extent
    inside = everything[region.distance(everything, 2.0) <= 0.0] - region.center(2.0)
    assert np.abs(inside).max(axis=0) == pytest.approx(half, rel=0.12)


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("shape", "cone", "cone"),
        ("size", (0.0, 0.0, 0.0), "above 0"),
        ("size", (0.03, -0.1, 0.0), "above 0"),
        ("size", (np.nan, 0.0, 0.0), "three numbers"),
        ("size", None, "three numbers"),
        ("size", "big", "cannot be read"),
        ("T_base_region", np.full((4, 4), np.nan), "no finite"),
        ("size", ("0.04", 0.0, 0.0), "three numbers"),
        ("T_base_region", np.diag([2.0, 1, 1, 1]), "rotation"),
        # What is no array the guard could not count with, and would raise in its own tick.
        ("T_base_region", np.eye(4).tolist(), "its pose is a list; expected an array of numbers"),
        ("velocity", (0.0, 0.0, 0.0), "its velocity is a tuple; expected an array"),
        ("covariance", None, "its covariance is a NoneType; expected an array"),
        ("T_base_region", np.eye(3), "no finite"),
        ("T_base_region", make_pose(None, [np.nan, 0.0, 0.3]), "no finite"),
        ("velocity", np.array([np.inf, 0, 0]), "velocity"),
        ("velocity", np.zeros(2), "velocity"),
        ("covariance", np.diag([-1.0, 1, 1]), "positive"),
        ("covariance", np.eye(3) + np.eye(3, k=1), "symmetric"),
        ("covariance", np.eye(2), "3 x 3"),
        ("drift", -1.0, "drift"),
        ("drift", np.inf, "drift"),
        ("exposure", 10.02, "in the future"),
        ("exposure", np.nan, "time in seconds"),
    ],
)
def test_a_wrong_region_is_refused_in_words(field, value, says):
    assert region_fault(sphere([0.4, 0.0, 0.3]), 10.0) == ""
    assert says in region_fault(replace(sphere([0.4, 0.0, 0.3]), **{field: value}), 10.0)


def test_a_region_may_be_new_never_lost_and_known_better_one_way_than_another():
    T = from_rpy((0.3, -1.2, 2.5), (0.4, 0.0, 0.3))
    unsure = T[:3, :3] @ np.diag([1e-4, 4e-4, 0.0]) @ T[:3, :3].T
    region = Region("box", (0.1, 0.2, 0.1), T, 10.005, covariance=unsure, drift=0.0)
    assert region_fault(region, 10.0) == ""
    assert region_fault(replace(region, shape="capsule", size=(0.1, 0.0, 0.0)), 10.0) == ""
    assert "above 0" in region_fault(replace(region, size=(0.1, 0.2, 0.0)), 10.0)
    assert region.deviation(99.0) == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("kind", "hug", "hug"),
        ("kind", ["thing"], "its kind is"),
        ("parts", None, "its parts are None; expected names"),
        ("parts", "tool", "its parts are 'tool'; expected names"),
        ("parts", (None,), "no part None"),
        ("parts", ("nose",), "no part nose"),
        ("parts", (), "no part given"),
        ("parts", ("tool",), "carries no tool"),
        ("speed", 0.0, "above 0"),
        ("force", float("nan"), "above 0"),
        ("seconds", "long", "above 0"),
        ("region", "there", "cannot be"),
        ("out", np.array([0.0, 0.0, 2.0]), "its way out is [0. 0. 2.]; expected a unit vector"),
        ("out", "up", "its way out is up"),
        ("out", np.full(3, np.nan), "unit vector"),
    ],
)
def test_a_wrong_request_is_refused_in_words(field, value, says):
    robot = load_robot("ur5")
    good = request(sphere([0.4, 0.0, 0.3]))
    assert request_fault(good, robot, 1.0) == ""
    assert says in request_fault(replace(good, **{field: value}), robot, 1.0)
    assert "PermitRequest" in request_fault("may I?", robot, 1.0)
    single = replace(good, speed=np.float32(0.05), force=np.float32(5.0))
    assert request_fault(single, robot, 1.0) == ""


# -- what the permit of a thing changes ------------------------------------------------------


def test_only_what_is_in_the_region_is_no_hazard_any_more():
    rng = np.random.default_rng(3)
    center = np.array([0.5, 0.1, 0.4])
    snapshot = make_snapshot([])
    points = (center + rng.uniform(-0.3, 0.3, (4000, 3))).astype(np.float32)
    snapshot = replace(snapshot, hazards=points, hazard_unknown=rng.random(4000) < 0.5)
    region = sphere(center, snapshot.stamp)
    seen = permitted(snapshot, Grant(region, np.zeros(3, bool)))
    away = np.linalg.norm(points - center, axis=1)
    kept = {tuple(p) for p in seen.hazards}
    near = away < RADIUS + snapshot.hazard_radius
    far = away > RADIUS + snapshot.hazard_radius + 0.02
    assert not any(tuple(p) in kept for p in points[near])
    assert all(tuple(p) in kept for p in points[far])
    assert len(seen.hazards) == len(seen.hazard_unknown)
    pairs = {tuple(p): u for p, u in zip(points, snapshot.hazard_unknown)}
    assert all(pairs[tuple(p)] == u for p, u in zip(seen.hazards, seen.hazard_unknown))


def test_a_stray_voxel_beside_a_thing_is_the_things_own_and_three_are_somebody():
    """Noise puts a voxel beside the ball now and then: it must not stop the arm that touches it."""
    center = np.array([0.5, 0.1, 0.4])
    region = sphere(center, make_snapshot([]).stamp)
    nobody = np.zeros(3, bool)
    shell = center + (RADIUS + 0.055) * np.eye(3)
    for count, person, kept in ((1, False, 0), (2, False, 0), (3, False, 3), (1, True, 1)):
        snapshot = replace(
            make_snapshot([]),
            hazards=shell[:count].astype(np.float32),
            hazard_unknown=np.zeros(count, bool),
        )
        assert len(permitted(snapshot, Grant(region, nobody, person)).hazards) == kept
        assert bool(somebody_beside(snapshot, region)) == (count == 3)
    far = replace(snapshot, hazards=(center + np.array([[RADIUS + 0.12, 0, 0]])).astype(np.float32))
    assert len(permitted(far, Grant(region, nobody)).hazards) == 1


def test_the_region_is_solid_for_all_but_the_parts_that_may_touch():
    """Random poses about a ball: each sphere is judged as brute force over the cubes judges it."""
    robot = load_robot("ur5").with_tool(load_tool("pen"))
    model = CollisionModel(robot)
    tip = tcp_pose(robot, robot.home)[:3, 3]
    other = ball(tip + np.array([0.0, 0.25, 0.0]), 0.05)
    snapshot = make_snapshot([ball(tip, RADIUS), other])
    touching = np.zeros(len(robot.spheres.radius), bool)
    touching[-len(robot.tool.spheres.radius) :] = True
    seen = permitted(snapshot, Grant(sphere(tip, snapshot.stamp), touching))
    whole, rest = CubeOracle(snapshot), CubeOracle(make_snapshot([other]))
    rng = np.random.default_rng(1)
    touched = blocked = 0
    for _ in range(60):
        q = robot.home + rng.normal(size=6) * 0.08
        clear = model.clearances(q, seen)
        center, radius = model.scratch().centers[: len(clear)], model.body.radius
        may = touching[model.body.original]
        expected = np.where(may, rest.distance(center), whole.distance(center)) - radius
        near = expected < 0.019
        assert (clear[near] < 0.0).tolist() == (expected[near] < 0.0).tolist()
        apart = near & (expected >= 0.0)
        assert clear[apart] == pytest.approx(expected[apart], abs=1e-4)
        touched += bool((may & (whole.distance(center) < radius)).any())
        blocked += bool((~may & (expected < 0.0)).any())
    assert touched > 20
    assert not model.valid(robot.home, snapshot)
    assert model.valid(robot.home, seen)
    assert model.edge_valid(robot.home, robot.home + 0.02, seen)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_from_the_allowed_speed_a_part_brakes_to_the_contact_speed_at_the_border(seed):
    """On at the speed for T_a, then braking: exactly, for steps end later than they should.

    And where the region comes faster than anybody knows, by as much as that is unsure.
    """
    rng = np.random.default_rng(seed)
    robot = load_robot("ur5")
    brake = robot.limits.acceleration
    gate = SeparationMonitor(robot, GuardConfig(), brake)
    gate.set_reaction(0.2, 0.0173)
    body, q = gate.body, robot.home + rng.normal(size=6) * 0.2
    motion = rng.normal(size=6)
    part = int(rng.choice(np.flatnonzero(body.link == robot.n)))
    center = body.motion(q, motion)[0][part]
    moves = rng.normal(size=3) * 0.1
    where = center + rng.normal(size=3) * 0.2
    region = sphere(where, 5.0, velocity=moves)
    parts = np.arange(len(body.radius)) == part
    unsure = float(rng.choice([0.0, 0.03, 0.1]))
    gate.contact = ContactSpeed("ball", parts, region, 5.0, 0.05, 0.004, unsure=unsure)
    view = gate.judge(q, motion, Hazards.at(np.empty((0, 3)), 0.0))
    share = float(view.share[part])
    velocity, radius = view.velocity[part], body.radius[part]
    towards = (where - center) / np.linalg.norm(where - center)
    spin = body.turning(q, motion)[part] * radius
    gap = np.linalg.norm(where - center) - RADIUS - radius - 0.004
    if gap <= 0.0:
        s = min(share, 1.0)
        relative = np.linalg.norm(s * velocity - moves) + s * spin
        assert relative <= 0.05 + 1e-5 or s == 0.0
        return
    closing = velocity @ towards + spin
    if share >= 1.0:
        share = 1.0
    speed = share * closing - moves @ towards
    if speed <= 0.05 + 1e-9:
        return
    speed += unsure
    deceleration = (np.linalg.norm(velocity) + spin) / view.stopping[part]
    left = gap - speed * gate.law.T_arm
    at_border = np.sqrt(max(speed**2 - 2.0 * deceleration * left, 0.0))
    assert at_border <= 0.05 + 1e-6
    assert set(np.flatnonzero(view.share < 1.0)) <= {part}


@pytest.mark.parametrize("held", [False, True])
def test_out_of_a_region_a_part_may_go_as_fast_as_it_likes_unless_it_is_held(held):
    """Of a ball that came at 10 cm/s a tip in it could get away at the contact speed alone."""
    robot = load_robot("ur5")
    gate = SeparationMonitor(robot, GuardConfig(), robot.limits.acceleration)
    gate.set_reaction(0.2, 0.0173)
    body, q = gate.body, robot.home.copy()
    part = int(np.flatnonzero(body.link == robot.n)[-1])
    center = body.motion(q, np.zeros(6))[0][part]
    J = body.jacobian(q, part)
    away = np.array([0.0, 0.6, 0.8])
    inside = float(body.radius[part]) + RADIUS - 0.004
    parts = np.arange(len(body.radius)) == part
    region = sphere(center - inside * away, 5.0)
    gate.contact = ContactSpeed("ball", parts, region, 5.0, 0.02, 0.004, held)
    for velocity, share in ((0.2 * away, 0.1 if held else np.inf), (-0.2 * away, 0.1)):
        motion = np.linalg.solve(J, np.concatenate([velocity, np.zeros(3)]))
        view = gate.judge(q, motion, Hazards.at(np.empty((0, 3)), 0.0))
        assert view.share[part] == pytest.approx(share, rel=0.02)
    # What rubs is slowed alone, and what leaves goes on.
    beside = np.array([0.2, 0.0, 0.0])
    wanted = np.linalg.solve(J, np.concatenate([0.1 * away + beside, np.zeros(3)]))
    got = (J @ gate.contact.ease(body, q, wanted, gate.law))[:3]
    assert abs(got @ beside) / 0.2 < 0.021
    assert got @ away == pytest.approx(0.01 if held else 0.1, rel=0.2)


class Reacher:
    """Goes straight at a ball by velocities, asking to touch it, as a servo task would."""

    def __init__(self, cell, where, permit=True, **more):
        self.cell, self.where, self.permit, self.more = cell, where, permit, more

    def __call__(self):
        cell = self.cell
        now = cell.now
        target = np.asarray(self.where(now - 0.05), float)
        tip = tcp_pose(cell.robot, cell.q)[:3, 3]
        way = target - tip
        away = max(np.linalg.norm(way), 1e-9)
        velocity = np.zeros(6)
        speed = (np.asarray(self.where(now)) - np.asarray(self.where(now - 0.05))) / 0.05
        velocity[:3] = speed + way / away * min(0.4, 2.0 * max(away - 0.02, 0.0))
        region = sphere(target, now - 0.05, velocity=speed, drift=0.05)
        permit = request(region, **self.more) if self.permit else None
        return VelocityIntent("touch", velocity, "base", now - 0.05, now + 0.2, permit)


def go(cell, seconds, reacher, stop=lambda: False):
    for _ in range(round(seconds / cell.config.period)):
        cell.tick(goal=reacher())
        if stop():
            break
    return cell


def reach(ball_at, seconds=6.0, others=(), permit=True, **more):
    cell = QuickCell([Ball(ball_at, RADIUS), *others])
    tip = tcp_pose(cell.robot, cell.q)[:3, 3]
    go(cell, seconds, Reacher(cell, ball_at, permit, **more))
    return cell, tip


def standing(t):
    return np.array([0.45, -0.5, 0.35])


def speeds_at(cell, touches):
    """Speed of the touching sphere's centre [m/s] at the first of the touches, by its log."""
    at = touches[0].time
    index = np.searchsorted([s.stamp for s in cell.log], at) - 1
    return cell.log[max(index, 0)]


def test_a_ball_on_a_stand_is_touched_at_the_contact_speed_and_not_without_a_permit():
    cell, _ = reach(standing, permit=False)
    assert min(m.distance for m in cell.margins) > 0.3
    assert not cell.touches
    cell, _ = reach(standing)
    assert {s.permit.state for s in cell.log[20:]} == {PermitState.GRANTED}
    touches = [t for t in cell.touches if t.ball == 0]
    assert touches
    hand = cell.guard.body.link[[t.sphere for t in touches]]
    assert set(hand) == {6}, "only the wrist touches"
    first = touches[0].time
    near = [m for m in cell.margins if first - 0.02 < m.time <= first + 0.5]
    # The fastest point of the whole arm may be faster than the part that touches; not by much.
    assert max(m.speed for m in near) < 0.06
    gaps = np.array([m.distance for m in cell.margins if m.time <= first])
    times = np.array([m.time for m in cell.margins if m.time <= first])
    closing = -np.gradient(gaps, times)[-5:]
    assert closing.max() <= 0.022
    fastest = max(m.speed for m in cell.margins)
    assert fastest > 0.25, "and it did not creep all the way"


def test_a_ball_that_moves_is_followed_and_touched():
    def moving(t):
        return np.array([0.45, -0.6 + 0.03 * t, 0.35])

    cell, _ = reach(moving, seconds=7.0)
    assert [t for t in cell.touches if t.ball == 0]
    assert cell.log[-1].permit.holds


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_a_hand_that_comes_to_the_ball_is_not_touched_by_a_moving_arm(speed):
    def hand(t):
        x = 1.6 - np.clip((t - 2.0) * speed, 0.0, 1.06)
        return np.array([x, -0.5, 0.35])

    cell, _ = reach(standing, seconds=6.0, others=[Ball(hand)])
    assert [t for t in cell.moving_touches if t.ball == 1] == []
    states = [s.permit.state for s in cell.log]
    assert PermitState.GRANTED in states
    assert states[-1] == PermitState.WITHDRAWN
    assert cell.log[-1].permit.reason
    assert all(s.permit.state == PermitState.WITHDRAWN for s in cell.log[-50:])


def test_a_ball_in_a_hand_is_no_thing():
    def hand(t):
        return standing(t) + np.array([0.09, 0.0, 0.0])

    cell, _ = reach(standing, others=[Ball(hand)])
    assert {s.permit.state for s in cell.log[20:]} == {PermitState.REFUSED}
    assert cell.moving_touches == []
    assert somebody_beside(cell.snapshot, sphere(standing(0.0), cell.snapshot.stamp))


def test_what_is_lost_jumps_or_becomes_unsure_is_withdrawn_and_stays_so_until_asked_anew():
    cell = QuickCell([Ball(standing, RADIUS)])
    reacher = Reacher(cell, standing)
    go(cell, 1.0, reacher)
    assert cell.log[-1].permit.state == PermitState.GRANTED
    kept = reacher()
    for _ in range(100):
        cell.tick(goal=replace(kept, exposure=cell.now, valid_until=cell.now + 0.2))
    permit = cell.log[-1].permit
    assert permit.state == PermitState.WITHDRAWN
    assert "known to" in permit.reason
    go(cell, 0.2, reacher)
    assert cell.log[-1].permit.state == PermitState.WITHDRAWN, "asked again by the same breath"
    cell.tick(goal=None)
    go(cell, 0.2, reacher)
    assert cell.log[-1].permit.state == PermitState.GRANTED
    other = Reacher(cell, lambda t: standing(t) + np.array([0.0, 0.12, 0.0]))
    cell.tick(goal=other())
    assert "jumped by 0.12" in cell.log[-1].permit.reason


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"region": sphere([0.45, -0.5, 0.35], 0.9, radius=0.4)}, "large"),
        ({"region": sphere([0.45, -0.5, 0.35], 0.9, velocity=np.array([2.0, 0, 0]))}, "m/s"),
        ({"region": sphere([0.45, -0.5, 0.35], 0.9, covariance=0.01 * np.eye(3))}, "known to"),
        ({"region": sphere([1.15, -0.5, 0.35], 0.9)}, "mapped box"),
        ({"reach": 0.001}, "no sphere"),
    ],
)
def test_what_cannot_be_granted_is_refused_with_the_reason(change, says):
    cell = QuickCell([Ball(standing, RADIUS)])
    reacher = Reacher(cell, standing)
    go(cell, 1.0, lambda: None)
    wanted = reacher()
    cell.tick(goal=replace(wanted, permit=replace(wanted.permit, **change)))
    permit = cell.log[-1].permit
    assert permit.state == PermitState.REFUSED
    assert says in permit.reason


def test_too_much_is_granted_less_and_ends_in_time():
    cell = QuickCell([Ball(standing, RADIUS)])
    go(cell, 1.5, Reacher(cell, standing, speed=3.0, seconds=1.0))
    states = [s.permit.state for s in cell.log]
    assert PermitState.LESS in states
    less = next(s.permit for s in cell.log if s.permit.state == PermitState.LESS)
    assert less.speed == 0.02
    assert "speed 0.02 instead of 3" in less.reason
    assert "no force sensor" in less.reason
    assert "time is over" in cell.log[-1].permit.reason


@pytest.mark.parametrize(("kind", "allowed"), [("thing", 10.0), ("hand", 30.0)])
def test_no_more_force_is_granted_than_the_cell_allows(kind, allowed):
    asked = replace(request(sphere([0.4, 0.0, 0.3]), force=100.0), kind=kind)
    less = granted(asked, 0.0, hardest=allowed)
    assert less.state == PermitState.LESS
    assert less.force == allowed
    assert "force" in less.reason
    assert granted(asked, 0.0, hardest=120.0).force == 100.0
    config = GuardConfig(thing_force=5.0)
    cell = QuickCell([Ball(standing, RADIUS)], config=config)
    go(cell, 1.0, Reacher(cell, standing, force=40.0))
    assert cell.log[-1].permit.force == 5.0


def test_with_no_request_the_guard_does_what_it_did_before():
    """Bit for bit: an intent without a permit is judged as it always was."""
    runs = []
    for more in ({}, {"permit": None}):
        cell = QuickCell([Ball(standing, RADIUS)])
        for _ in range(200):
            cell.tick(
                goal=VelocityIntent("v", np.full(6, 0.1), "joint", cell.now, cell.now + 0.2, **more)
            )
        runs.append(np.array(cell.commands).tobytes())
    assert runs[0] == runs[1]


def beyond_the_drives(cell):
    """Commands (k,) that change sooner than the drives' ramp can, a stop and what follows it not.

    Until November 2026, where the law of contact eased a wish, a command went there at once.
    """
    sent = np.array(cell.commands)
    stops = sent[:, -1] > 0.0
    ramp = cell.robot.limits.acceleration * cell.config.acceleration * cell.config.period
    change = np.abs(np.diff(sent[:, :-1], axis=0))
    told = ~(stops[1:] | stops[:-1])
    return np.flatnonzero((change > ramp * (1.0 + 1e-6)).any(axis=1) & told)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("shares", [(1.0, 1.0), (0.5, 0.6)])
def test_no_command_asks_more_than_the_drives_ramp_whatever_is_permitted(seed, shares):
    """Wishes and permits at random: asked for, withdrawn, of a place that jumps, moves, is lost."""
    rng = np.random.default_rng(seed)
    place, moves = np.array([0.45, -0.5, 0.35]), rng.normal(size=3) * 0.08

    def wanders(t):
        return place + moves * np.sin(2.0 * t)

    config = GuardConfig(speed=shares[0], acceleration=shares[1])
    cell = QuickCell([Ball(wanders, RADIUS)], config=config, seed=seed)
    for _ in range(30):
        kind = rng.choice(["asks", "asks elsewhere", "asks not", "rests", "turns"])
        off = rng.normal(size=3) * rng.choice([0.0, 0.01, 0.05])
        more = {"speed": float(rng.choice([0.02, 0.1, 0.25])), "stiffness": 300.0}
        reacher = Reacher(cell, lambda t, off=off: wanders(t) + off, **more)
        reacher.permit = kind in ("asks", "asks elsewhere", "turns")
        spins = rng.normal(size=6) * 0.5
        for _ in range(int(rng.integers(3, 40))):
            wish = reacher()
            if kind == "rests":
                wish = None
            elif kind == "turns":
                wish = replace(wish, velocity=spins)
            cell.tick(goal=wish)
    assert any(s.permit is not None and s.permit.holds for s in cell.log)
    assert beyond_the_drives(cell).size == 0
