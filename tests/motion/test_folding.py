"""Velocities that fold the arm onto itself: led beside, never onto, never at rest."""

import numpy as np
import pytest

from armsight.experiments.quick_cell import QuickCell
from armsight.motion.collision import CollisionModel
from armsight.motion.folding import NEAR, PARTS, ROOM, SETTLES, unfolded
from armsight.motion.intents import VelocityIntent
from armsight.robots import load_robot
from armsight.robots.kinematics import tcp_jacobian, tcp_pose

from .scenes import make_snapshot

STEP = 1e-6


@pytest.fixture(scope="module")
def model():
    return CollisionModel(load_robot("ur5"))


def gaps(model, q):
    """{two links: least gap of their spheres} by plain numpy [m]."""
    body = model.body
    model.clearance(q, free_space())
    centers = np.array(model.scratch().centers)
    a, b = body.pairs.T
    gap = np.linalg.norm(centers[a] - centers[b], axis=1) - body.pair_radius
    link = np.concatenate([body.link, np.zeros(len(body.fixed_radius), np.int64)])
    out = {}
    for one, other, g in zip(link[a], link[b], gap):
        key = (int(one), int(other))
        out[key] = min(out.get(key, np.inf), float(g))
    return out


def free_space():
    return make_snapshot(lower=(-1.5, -1.5, -1.5), upper=(1.5, 1.5, 1.5), voxel=0.1)


def near_itself(model, rng):
    """A place where two links are 4 to 30 mm apart, the pair, and how joints bring it together."""
    snapshot, limits = free_space(), model.robot.limits
    while True:
        q = rng.uniform(np.maximum(limits.lower, -3.0), np.minimum(limits.upper, 3.0))
        if not model.valid(q, snapshot):
            continue
        at = gaps(model, q)
        moved = [gaps(model, q + STEP * row) for row in np.eye(6)]
        for pair, gap in at.items():
            closes = np.array([(gap - other[pair]) / STEP for other in moved])
            if 0.004 < gap < 0.03 and np.linalg.norm(closes) > 0.1:
                return q, pair, closes


def test_links_close_no_faster_than_they_can_stop(model):
    rng, floor, changed = np.random.default_rng(2), model.config.floor, 0
    for _ in range(25):
        q, _, _ = near_itself(model, rng)
        wanted = rng.normal(scale=0.5, size=6)
        led = unfolded(model, q, q, wanted)
        before, after = gaps(model, q), gaps(model, q + STEP * led.motion)
        wished = gaps(model, q + STEP * wanted)
        bad = False
        for pair, gap in before.items():
            most = (gap - floor - ROOM) / SETTLES
            closing, was = (gap - after[pair]) / STEP, (gap - wished[pair]) / STEP
            bad |= gap < NEAR and was > max(most, 0.0) + 1e-3
            if gap < NEAR:
                assert closing <= max(most, -PARTS * max(was, 0.0), 0.0) + 2e-3
        assert (led.links is not None) == bad
        if led.links is None:
            assert (led.motion == wanted).all()
        changed += bad
    assert changed > 8


def test_what_turns_the_tool_gives_way_before_what_moves_its_tip(model):
    rng, tip, turn = np.random.default_rng(3), [], []
    while len(tip) < 20:
        q, _, _ = near_itself(model, rng)
        J = tcp_jacobian(model.robot, q)
        if np.linalg.svd(J, compute_uv=False)[-1] < 0.05:
            continue
        wanted = np.linalg.solve(J, np.concatenate([rng.normal(scale=0.1, size=3), np.zeros(3)]))
        led = unfolded(model, q, q, wanted)
        if led.links is not None:
            change = J @ (led.motion - wanted)
            tip.append(np.linalg.norm(change[:3]))
            turn.append(0.1 * np.linalg.norm(change[3:]))
    assert np.median(tip) < 0.5 * np.median(turn)


def test_where_it_would_stand_counts_and_not_only_where_it_is(model):
    rng = np.random.default_rng(4)
    for _ in range(5):
        q, pair, closes = near_itself(model, rng)
        slowly = 1e-3 * closes / np.linalg.norm(closes) ** 2  # at 1 mm/s: it has 8 mm/s at least
        assert unfolded(model, q, q, slowly).links is None
        there = q + gaps(model, q)[pair] * closes / np.linalg.norm(closes) ** 2
        assert gaps(model, there)[pair] < ROOM  # braking would bring the two together
        led = unfolded(model, q, there, slowly)
        assert led.links is not None
        assert led.motion @ closes < 0.0


def test_none_wanted_is_none_moved(model):
    q, _, _ = near_itself(model, np.random.default_rng(5))
    assert not unfolded(model, q, q, np.zeros(6)).motion.any()


@pytest.mark.parametrize("bound", [True, False])
def test_an_arm_that_is_folded_up_goes_on_beside_itself(bound):
    """Found by ``servo-straw``: an arm folded against its forearm stood in its own way for
    seconds, pressed by the face that it should have left."""
    world = QuickCell(robot="ur5")
    for _ in range(50):
        world.tick(goal=None)
    start, model = tcp_pose(world.robot, world.q)[:3, 3], world.guard._filter.model
    velocity, least, said = np.array([-0.1, 0.0, -0.05, 0.0, 0.0, 0.0]), np.inf, set()
    for _ in range(1200):
        wish = VelocityIntent("v", velocity, "base", world.now - 0.1, world.now + 0.2, bound=bound)
        decision = world.tick(goal=wish)
        said.add(decision.status.reason)
        least = min(least, *gaps(model, world.q).values())
    way = float(np.linalg.norm(tcp_pose(world.robot, world.q)[:3, 3] - start))
    assert least > model.config.floor - 1e-4
    if bound:  # it may not turn: it stands, and says so
        assert way < 0.6
        assert "keeps room to stop" in said
    else:
        assert way > 0.95
        assert "upper_arm_link is in the way of wrist_3_link" in said
