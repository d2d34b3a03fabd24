"""The compiled loops of contact permits against plain numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armsight.mapping.tracked import SHELL, TOUCHES
from armsight.motion.contact_kernels import in_box, leave_out, share_within
from armsight.motion.nearest import MovingBody
from armsight.motion.permitted import Grant, grown_by, permitted, somebody_beside
from armsight.motion.regions import Region
from armsight.robots import load_robot
from armsight.robots.kinematics import link_poses, point_jacobian

from .scenes import make_snapshot

ROBOT = load_robot("ur5")
UP = np.array([0.0, 0.0, 1.0])


def scattered(seed):
    """A snapshot with hazards and things thrown about (0.3, 0, 0.3)."""
    rng = np.random.default_rng(seed)
    points = (np.array([0.3, 0.0, 0.3]) + rng.normal(size=(4000, 3)) * 0.15).astype(np.float32)
    return replace(
        make_snapshot([]),
        hazards=points,
        hazard_unknown=rng.random(4000) < 0.3,
        things=points[::7] + np.float32(0.01),
    )


def plain(snapshot, grant):
    """Which hazards are left, and which points may be touched: every point is looked at."""
    region, grown = grant.region, grown_by(snapshot, grant.region)
    distance = region.distance(snapshot.hazards.astype(float), snapshot.stamp)
    keep = distance > grown
    if not grant.person:
        shell = keep & (distance <= grown + SHELL * snapshot.grid.voxel)
        if shell.sum() < TOUCHES:
            keep &= ~shell
    above = snapshot.hazards @ np.float32(UP) > (grant.ceiling[1] if grant.ceiling else np.inf)
    keep |= above
    touchable = snapshot.hazards[~keep]
    if grant.person:
        inside = region.distance(snapshot.things.astype(float), snapshot.stamp) <= grown
        inside &= ~(
            snapshot.things @ np.float32(UP) > (grant.ceiling[1] if grant.ceiling else np.inf)
        )
        touchable = np.concatenate([touchable, snapshot.things[inside]])
    return keep, touchable


@pytest.mark.parametrize("person", [False, True])
@pytest.mark.parametrize("shape", ["sphere", "box", "capsule"])
@pytest.mark.parametrize("ceiling", [None, (UP, 0.33)])
def test_a_permitted_snapshot_is_what_looking_at_every_point_says(shape, person, ceiling):
    for seed in range(4):
        rng = np.random.default_rng((seed, 3))
        snapshot = scattered(seed)
        T = np.eye(4)
        T[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        T[:3, :3] *= np.sign(np.linalg.det(T[:3, :3]))
        T[:3, 3] = (0.3, 0.0, 0.3) + rng.normal(size=3) * (1.0 if seed == 0 else 0.1)
        region = Region(shape, (0.1, 0.15, 0.08), T, snapshot.stamp, rng.normal(size=3) * 0.1)
        grant = Grant(region, np.zeros(0, bool), person, ceiling)
        keep, touchable = plain(snapshot, grant)
        seen = permitted(snapshot, grant)
        np.testing.assert_array_equal(seen.hazards, snapshot.hazards[keep])
        np.testing.assert_array_equal(seen.hazard_unknown, snapshot.hazard_unknown[keep])
        np.testing.assert_array_equal(seen.touchable, touchable)


def test_who_is_beside_a_region_is_the_nearest_of_its_shell():
    snapshot = scattered(1)
    region = Region("sphere", (0.12, 0.0, 0.0), np.array(make_at(0.3, 0.0, 0.3)), snapshot.stamp)
    distance = region.distance(snapshot.hazards.astype(float), snapshot.stamp)
    distance[distance <= grown_by(snapshot, region)] = np.inf
    x, y, z = snapshot.hazards[np.argmin(distance)]
    assert f"({x:.2f}, {y:.2f}, {z:.2f})" in somebody_beside(snapshot, region)
    far = Region("sphere", (0.05, 0.0, 0.0), np.array(make_at(3.0, 0.0, 0.3)), snapshot.stamp)
    assert somebody_beside(snapshot, far) == ""


def make_at(x, y, z):
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def test_points_in_a_cube_and_all_but_some():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(500, 3)).astype(np.float32)
    center, found = np.array([0.2, -0.1, 0.4]), np.empty(500, np.int64)
    count = in_box(points, center, 0.7, found)
    expected = np.flatnonzero((np.abs(points - center) <= 0.7).all(axis=1))
    np.testing.assert_array_equal(found[:count], expected)
    marks = rng.random(500) < 0.5
    out, out_marks = np.empty((500 - count, 3), np.float32), np.empty(500 - count, bool)
    leave_out(points, marks, found[:count], out, out_marks)
    np.testing.assert_array_equal(out, np.delete(points, expected, axis=0))
    np.testing.assert_array_equal(out_marks, np.delete(marks, expected))


def test_turning_speeds_against_jacobians():
    body, rng = MovingBody(ROBOT, ROBOT.limits.acceleration), np.random.default_rng(4)
    for _ in range(5):
        q, v = rng.uniform(-3, 3, 6), rng.normal(size=6)
        poses = link_poses(ROBOT, q)
        for k, link in enumerate(body.link):
            # Two points 1 m apart on the link: their velocities differ by what turning does.
            at = poses[link, :3, 3]
            moves = [
                point_jacobian(ROBOT, q, int(link), at + offset) @ v
                for offset in (np.zeros(3), *np.eye(3))
            ]
            turned = np.array(moves[1:]) - moves[0]  # rows w x e_i
            w = np.array([turned[1, 2], turned[2, 0], turned[0, 1]])
            assert body.turning(q, v)[k] == pytest.approx(np.linalg.norm(w), abs=1e-9)


@pytest.mark.parametrize("free", [False, True])
def test_the_share_within_a_region_is_the_greatest_that_keeps_the_speed(free):
    """What leads out of it does not count where that is free: leaving presses nothing."""
    rng = np.random.default_rng(7)
    shares = np.linspace(0.0, 1.0, 20001)
    seen = set()
    for _ in range(200):
        velocity, region = rng.normal(size=3) * 0.2, rng.normal(size=3) * 0.08
        spin, most = rng.uniform(0, 0.05), rng.uniform(0.02, 0.15)
        outward = rng.normal(size=3)
        outward *= free / np.linalg.norm(outward)

        def excess_of(share, v=velocity, V=region, out=outward, spin=spin, most=most):
            moves = np.atleast_1d(share)[:, None] * v - V
            moves = moves - np.maximum(moves @ out, 0.0)[:, None] * out
            return np.linalg.norm(moves, axis=1) + share * spin - most

        excess = excess_of(shares)
        found = share_within(velocity, region, outward, spin, most)
        if excess[-1] <= 0.0:
            assert found == np.inf
            seen.add("all")
        elif found == 0.0:
            seen.add("none")
            # what carries it along, or standing, is looked for; nothing else starts the search
            along = np.clip(velocity @ region / (velocity @ velocity), 0, 1)
            assert excess_of(along)[0] > 0.0
            assert excess[0] > 0.0
        else:
            seen.add("some")
            assert found == pytest.approx(shares[np.flatnonzero(excess <= 0.0)[-1]], abs=1e-4)
    assert seen == {"all", "some", "none"}
