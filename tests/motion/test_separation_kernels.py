"""The compiled search against plain numpy: nearest hazards, limits, motions, projections."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from armsight.geometry.pose import exp, transform
from armsight.motion.drive_kernels import drive_ahead, stop_path, stopping_times
from armsight.motion.hazard_kernels import in_reach, sort_into_blocks
from armsight.motion.nearest import HORIZON, Hazards, MovingBody
from armsight.motion.separation_kernels import Law, allowed_share
from armsight.motion.slide_kernels import limiting_rows, project
from armsight.robots import ROBOT_NAMES, load_robot
from armsight.robots.kinematics import link_poses, point_jacobian

LAW = Law(2.0, 0.05, 0.15, 0.15, 0.0173, 0.045)


def brute_force(body, center, velocity, stopping, fastest, points, law):
    """Distance, nearest, share by looking at every pair."""
    m = len(center)
    distance, share = np.full(m, np.inf), np.full(m, np.inf)
    for i in range(m):
        for p in points.astype(float):
            away = p - center[i]
            length = np.linalg.norm(away)
            d = length - body.radius[i] - law.hazard_radius
            if d < HORIZON:
                distance[i] = min(distance[i], d)
            closing = velocity[i] @ away / length
            if np.linalg.norm(velocity[i]) > 0.0:
                share[i] = min(share[i], allowed_share(d, closing, fastest, stopping[i], law))
    return distance, share


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_motion_of_spheres_against_jacobians(name):
    robot = load_robot(name)
    body = MovingBody(robot, robot.limits.acceleration)
    rng = np.random.default_rng(1)
    for _ in range(5):
        q = rng.uniform(np.maximum(robot.limits.lower, -3), np.minimum(robot.limits.upper, 3))
        v = rng.normal(size=robot.n)
        center, velocity = body.motion(q, v)
        poses = link_poses(robot, q)
        for k in range(len(body.radius)):
            link = int(body.link[k])
            expected = poses[link, :3, :3] @ body.local[k] + poses[link, :3, 3]
            assert center[k] == pytest.approx(expected, abs=1e-12)
            J = point_jacobian(robot, q, link, expected)
            assert velocity[k] == pytest.approx(J @ v, abs=1e-12)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_no_point_of_a_surface_is_faster_than_stated(name):
    """Against Jacobians of points all over the spheres, and not far too high."""
    robot = load_robot(name)
    body = MovingBody(robot, robot.limits.acceleration)
    rng = np.random.default_rng(2)
    for _ in range(5):
        q = rng.uniform(np.maximum(robot.limits.lower, -3), np.minimum(robot.limits.upper, 3))
        v = rng.normal(size=robot.n)
        center, velocity = body.motion(q, v)
        stated = body.fastest(q, v, velocity)
        fastest = 0.0
        for k in range(len(body.radius)):
            around = rng.normal(size=(60, 3))
            around *= body.radius[k] / np.linalg.norm(around, axis=1)[:, None]
            for point in center[k] + around:
                J = point_jacobian(robot, q, int(body.link[k]), point)
                fastest = max(fastest, float(np.linalg.norm(J @ v)))
        assert fastest <= stated + 1e-9
        assert stated <= 1.25 * fastest


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 100), st.floats(0.1, 2.5))
def test_scan_against_brute_force(seed, count, spread):
    rng = np.random.default_rng(seed)
    robot = load_robot("ur5")
    body = MovingBody(robot, robot.limits.acceleration)
    q = rng.uniform(-np.pi, np.pi, 6)
    v = rng.normal(size=6) * rng.choice([0.0, 0.05, 1.0, 3.0])
    points = (rng.normal(size=(count, 3)) * spread).astype(np.float32)
    hazards = Hazards.at(points, LAW.hazard_radius)
    view = body.view(q, v, hazards, LAW)
    fastest = body.fastest(q, v, view.velocity)
    distance, share = brute_force(
        body, view.center, view.velocity, view.stopping, fastest, points, LAW
    )
    assert view.distance == pytest.approx(distance, abs=1e-6)
    # Beyond a share of one nothing limits the motion: pruned pairs may be left out there.
    assert np.minimum(view.share, 1.0) == pytest.approx(np.minimum(share, 1.0), abs=1e-6)


def test_scan_of_a_dense_cloud_leaves_out_nothing_that_limits():
    """Most blocks are skipped; what limits a sphere is farther away than the nearest."""
    robot = load_robot("ur5")
    body = MovingBody(robot, robot.limits.acceleration)
    rng = np.random.default_rng(3)
    for _ in range(20):
        q, v = rng.uniform(-np.pi, np.pi, 6), rng.normal(size=6) * rng.choice([0.3, 1.0])
        center = body.motion(q, v)[0].mean(axis=0)
        points = rng.normal(size=(3000, 3))
        points *= rng.uniform(0.5, 1.3, 3000)[:, None] / np.linalg.norm(points, axis=1)[:, None]
        points = (points + center).astype(np.float32)
        view = body.view(q, v, Hazards.at(points, LAW.hazard_radius), LAW)
        away = points.astype(float) - view.center[:, None]
        length = np.linalg.norm(away, axis=2)
        gap = length - body.radius[:, None] - LAW.hazard_radius
        closing = np.einsum("mpi,mi->mp", away, view.velocity) / length
        towards = np.maximum(closing, 0.0)
        T_s = view.stopping[:, None]
        spare = gap - LAW.K - LAW.person * LAW.T_person
        # The root of towards T_s / 2 s^2 + b s - spare.
        b = LAW.person * T_s + towards * LAW.T_arm
        with np.errstate(divide="ignore", invalid="ignore"):
            root = (np.sqrt(b * b + 2 * towards * T_s * spare) - b) / (towards * T_s)
        share = np.where(spare > 0, np.where(towards * T_s > 1e-9, root, spare / b), 0.0)
        fastest = body.fastest(q, v, view.velocity)
        share = np.where(closing <= 0, np.maximum(share, LAW.retreat / fastest), share)
        assert view.distance == pytest.approx(gap.min(axis=1), abs=1e-6)
        least = np.minimum(share.min(axis=1), 2.0)
        assert np.minimum(view.share, 2.0) == pytest.approx(least, abs=1e-6)
        first = np.flatnonzero((least < 1.0) & (view.share < 1.0))
        limited = share[first, np.argmin(share[first], axis=1)]
        assert view.share[first] == pytest.approx(limited, abs=1e-6)


def test_what_is_as_near_as_the_nearest_is_no_fault_of_an_arm_at_rest():
    """Voxels all around a sphere: rounding alone tells which of them is nearest."""
    robot = load_robot("ur5")
    body = MovingBody(robot, robot.limits.acceleration)
    still = np.zeros(6)
    center = body.motion(robot.home, still)[0]
    ring = np.linspace(0.0, 2.0 * np.pi, 7)[1:]
    around = np.stack([np.cos(ring), np.sin(ring), 0.0 * ring], axis=1)
    for k in range(len(center)):
        for away in np.linspace(0.3, 1.1, 40):
            points = (center[k] + away * around).astype(np.float32)
            view = body.view(robot.home, still, Hazards.at(points, LAW.hazard_radius), LAW)
            expected = away - body.radius[k] - LAW.hazard_radius
            assert view.distance[k] == pytest.approx(expected, abs=1e-5)
            assert view.allowed >= 1.0


def test_a_mutant_that_drops_hazards_is_noticed():
    rng = np.random.default_rng(0)
    robot = load_robot("ur5")
    body = MovingBody(robot, robot.limits.acceleration)
    points = rng.uniform(-1, 1, (2000, 3)).astype(np.float32)
    wrong = 0
    for _ in range(60):
        q, v = rng.uniform(-np.pi, np.pi, 6), rng.normal(size=6)
        full = body.view(q, v, Hazards.at(points, 0.0173), LAW)
        kept = points[rng.random(len(points)) > 0.01]
        mutant = body.view(q, v, Hazards.at(kept, 0.0173), LAW)
        wrong += not np.allclose(full.distance, mutant.distance)
    assert wrong > 5


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 200), st.floats(0.3, 3.0))
def test_who_is_in_reach_of_a_stop_against_brute_force(seed, count, spread):
    rng = np.random.default_rng(seed)
    looks, spheres = 4, 7
    places = np.cumsum(rng.normal(size=(looks, spheres, 3)) * 0.05, axis=0) + rng.normal(size=3)
    radius, until = rng.uniform(0.02, 0.1, spheres), rng.uniform(0.0, 0.3, spheres)
    until[rng.random(spheres) < 0.3] = 0.0
    times = np.linspace(0.0, 0.3, looks)
    points = (rng.normal(size=(count, 3)) * spread).astype(np.float32)
    blocks = sort_into_blocks(points, 0.16)
    found = in_reach(blocks, places, radius, times, until, LAW)
    room = np.full(spheres, np.inf)
    for i in np.flatnonzero(until > 0.0):
        for k in range(looks):
            away = np.linalg.norm(points.astype(float) - places[k, i], axis=1)
            reached = LAW.person * (LAW.T_person + min(times[k], until[i]))
            skin = radius[i] + LAW.hazard_radius + LAW.K
            room[i] = min(room[i], (away - skin - reached).min(initial=np.inf))
    if found < 0:
        assert room.min() >= -1e-6
    else:
        assert room[found] < 1e-6


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 400))
def test_blocks_hold_every_hazard_once_and_bound_them(seed, count):
    rng = np.random.default_rng(seed)
    points = (rng.normal(size=(count, 3)) * 0.7).astype(np.float32)
    blocks = sort_into_blocks(points, 0.16)
    assert sorted(blocks.order) == list(range(count))
    assert np.array_equal(blocks.points, points[blocks.order])
    for k in range(blocks.lower.shape[1]):
        mine = blocks.points[blocks.first[k] : blocks.first[k + 1]]
        assert len(mine)
        assert (np.ptp(mine, axis=0) <= 0.16 + 1e-6).all()
        assert np.array_equal(mine.min(axis=0), blocks.lower[:, k])
        assert np.array_equal(mine.max(axis=0), blocks.upper[:, k])


def test_drives_against_small_steps():
    rng = np.random.default_rng(3)
    for _ in range(20):
        n, k = 6, 5
        q, v = rng.normal(size=n), rng.normal(size=n)
        ends = np.cumsum(rng.uniform(0.005, 0.2, k))
        targets, braking = rng.normal(size=(k, n)), rng.random(k) < 0.3
        a, b = rng.uniform(1, 4, n), rng.uniform(4, 8, n)
        fine_q, fine_v, t, h = q.copy(), v.copy(), 0.0, 4e-5
        while t < ends[-1] - h / 2:
            i = int(np.searchsorted(ends, t + h / 2))
            wanted = np.zeros(n) if braking[i] else targets[i]
            ramp = (b if braking[i] else a) * h
            before = fine_v.copy()
            fine_v = fine_v + np.clip(wanted - fine_v, -ramp, ramp)
            fine_q = fine_q + h * 0.5 * (before + fine_v)
            t += h
        drive_ahead(q, v, ends, targets, braking, a, b, 0.0)
        assert q == pytest.approx(fine_q, abs=2e-4)
        assert v == pytest.approx(fine_v, abs=2e-3)


def test_stop_path_ends_where_the_brakes_do():
    q, v = np.zeros(3), np.array([1.0, -2.0, 0.0])
    brake = np.array([5.0, 4.0, 3.0])
    path = stop_path(q, v, brake, 8)
    assert path[0] == pytest.approx(q)
    assert path[-1] == pytest.approx([0.1, -0.5, 0.0])
    moving = np.zeros(3, np.int64) + np.array([1, 2, 3])
    out = np.empty(3)
    stopping_times(v, brake, moving, out)
    assert out == pytest.approx([0.2, 0.5, 0.5])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_projection_against_an_optimiser(seed):
    rng = np.random.default_rng(seed)
    n, k = 6, rng.integers(1, 5)
    wanted, rows = rng.normal(size=n), rng.normal(size=(k, n))
    bounds = np.abs(rng.normal(size=k)) * 0.3  # zero motion is always feasible
    found = project(wanted, rows, bounds, 400)
    assert (rows @ found <= bounds + 1e-4).all()
    best = minimize(
        lambda x: 0.5 * np.sum((x - wanted) ** 2),
        np.zeros(n),
        jac=lambda x: x - wanted,
        constraints={"type": "ineq", "fun": lambda x: bounds - rows @ x, "jac": lambda x: -rows},
        method="SLSQP",
    )
    assert found == pytest.approx(best.x, abs=2e-3)


def test_rows_that_limit_a_motion_are_closing_speeds_whatever_way_the_axes_point() -> None:
    """Against differences of a chain of four joints with slanted axes."""
    rng = np.random.default_rng(3)
    axis = rng.normal(size=(4, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    between = [exp(rng.normal(size=6) * 0.4) for _ in range(4)]

    def chain(q):
        poses = [np.eye(4)]
        for offset, about, angle in zip(between, axis, q):
            poses.append(poses[-1] @ offset @ exp(np.append(np.zeros(3), angle * about)))
        return np.stack(poses)

    link = rng.integers(0, 5, 12)
    local = rng.normal(size=(12, 3)) * 0.3

    def centers(q):
        return np.stack([transform(chain(q)[k], p[None])[0] for k, p in zip(link, local)])

    q, speed, share = rng.normal(size=4), rng.normal(size=4), rng.uniform(0.0, 1.0, 12)
    center, hazard = centers(q), rng.normal(size=(12, 3))
    step = 1e-6
    J = np.stack([(centers(q + step * e) - centers(q - step * e)) / (2 * step) for e in np.eye(4)])
    velocity = np.einsum("jmc,j->mc", J, speed)
    way = (hazard - center) / np.linalg.norm(hazard - center, axis=1)[:, None]
    closing = np.sum(way * velocity, axis=1)
    tight = np.flatnonzero(link > 0)
    rows, bounds = limiting_rows(
        chain(q), axis, link, center, velocity, share, hazard[tight], tight
    )
    kept = tight[closing[tight] > 0.0]
    assert 2 < len(kept) < len(tight)
    np.testing.assert_allclose(rows, np.einsum("jmc,mc->mj", J, way)[kept], atol=1e-7)
    np.testing.assert_allclose(bounds, (share * closing)[kept], atol=1e-12)
