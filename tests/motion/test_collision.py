"""Collision checks against brute force in plain numpy."""

from __future__ import annotations

import numpy as np

from armsight.motion.body import make_body
from armsight.motion.collision import CollisionModel
from armsight.motion.kernels import body_centers

from .scenes import arm6, ball, box, make_snapshot, oracle_centers


def test_body_centers_match_plain_numpy():
    robot = arm6()
    body = make_body(robot)
    rng = np.random.default_rng(0)
    out = np.empty_like(body.center)
    for q in rng.uniform(-3, 3, (50, 6)):
        body_centers(body, q, out)
        np.testing.assert_allclose(out, oracle_centers(robot, q)[body.original], atol=1e-12)


def test_free_and_colliding_configurations():
    robot = arm6()
    model = CollisionModel(robot)
    empty = make_snapshot()
    assert model.valid(robot.home, empty)
    tip = oracle_centers(robot, robot.home)[-1]
    blocked = make_snapshot([ball(tip, 0.05)])
    assert not model.valid(robot.home, blocked)
    assert model.clearance(robot.home, blocked) < 0
    assert "touches" in model.contact(robot.home, blocked)


def test_edge_through_a_wall_is_refused():
    robot = arm6()
    model = CollisionModel(robot)
    snapshot = make_snapshot([box((0.5, 0.0, 0.5), (0.5, 0.04, 1.0))])
    a = np.array([1.2, 1.0, 0.6, 0.0, 0.0, 0.0])
    b = np.array([-1.2, 1.0, 0.6, 0.0, 0.0, 0.0])
    assert model.valid(a, snapshot)
    assert model.valid(b, snapshot)
    assert not model.edge_valid(a, b, snapshot)
    assert model.edge_valid(a, a + 0.05, snapshot)
