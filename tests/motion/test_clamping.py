"""Hands that could be held fast between the arm and something firm."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.experiments.quick_cell import QuickCell
from armsight.experiments.touch_cell import Target, TouchCell, Toucher
from armsight.geometry.body_regions import BODY_REGIONS
from armsight.geometry.pose import make_pose
from armsight.mapping.snapshot import OCCUPIED
from armsight.motion.clamping import GAP, LOOKED, RISE, Clamp, firm_near
from armsight.motion.contact_speed import GentleSpeed
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import Hazards
from armsight.motion.regions import Region
from armsight.motion.separation_monitor import SeparationMonitor
from armsight.robots import load_robot

HAND = BODY_REGIONS["hand"]


def test_nothing_closes_in_on_a_firm_point_faster_than_its_distances_allow() -> None:
    rng = np.random.default_rng(3)
    tight = 0
    for _ in range(60):
        center, velocity = rng.normal(size=(6, 3)) * 0.1, rng.normal(size=(6, 3)) * 0.1
        radius = rng.uniform(0.01, 0.05, 6)
        firm, somebody = rng.normal(size=(40, 3)) * 0.15, rng.normal(size=(5, 3)) * 0.1
        clamp = Clamp(firm.astype(np.float32), somebody.astype(np.float32), 0.017, 0.002)
        expected = np.full(6, np.inf)
        for i in range(6):
            free = np.linalg.norm(somebody - center[i], axis=1).min() - radius[i] - 0.017
            for point in firm:
                away = np.linalg.norm(point - center[i])
                gap = away - radius[i] - 0.017
                closing = velocity[i] @ (point - center[i]) / away
                if gap > LOOKED or closing <= 0.0:
                    continue
                most = 0.002 + RISE * max(gap - GAP, free, 0.0)
                expected[i] = min(expected[i], most / closing)
        found = clamp.shares(center, velocity, radius)
        assert np.allclose(found, expected, rtol=1e-4)
        tight += int((found < 1.0).sum())
    assert tight > 20


def test_firm_is_what_is_declared_and_what_is_a_thing_and_near() -> None:
    cell = QuickCell()
    snapshot = cell.snapshot_at(0.0)
    region = Region("sphere", (0.1, 0.0, 0.0), make_pose(None, np.array([0.4, 0.2, 0.3])), 0.0)
    state, last = snapshot.state.copy(), snapshot.last_occupied.copy()
    declared, far, somebody, thing = (
        np.array(p)
        for p in ([0.4, 0.2, 0.41], [0.4, 0.2, 0.61], [0.4, 0.31, 0.31], [0.49, 0.2, 0.3])
    )
    for place in (declared, far, somebody):
        state[tuple(snapshot.grid.index(place[None])[0])] = OCCUPIED
    last[tuple(snapshot.grid.index(somebody[None])[0])] = 0.0  # was seen there: it may move
    things = np.array([thing, thing + 1.0], np.float32)
    found = firm_near(replace(snapshot, state=state, last_occupied=last, things=things), region)
    assert sorted(np.abs(found - declared).max(axis=1) < 0.011) == [False, True]
    assert sorted(np.abs(found - thing).max(axis=1) < 0.011) == [False, True]


def test_a_region_at_the_edge_of_the_map_and_beyond_has_what_is_in_the_map() -> None:
    snapshot = QuickCell().snapshot_at(0.0)
    for x in (1.19, 5.0, -5.0):
        region = Region("sphere", (0.1, 0.0, 0.0), make_pose(None, np.array([x, 0.0, 0.0])), 0.0)
        assert len(firm_near(snapshot, region)) == 0


def test_the_guard_says_what_makes_it_slow() -> None:
    robot = load_robot("ur5")
    gate = SeparationMonitor(robot, GuardConfig(), robot.limits.acceleration)
    gate.set_reaction(0.2, 0.0173)
    center, _ = gate.body.motion(robot.home, np.zeros(6))
    part, way = len(center) - 1, np.array([0.6, 0.0, -0.8])
    motion = np.linalg.pinv(gate.body.jacobian(robot.home, part)[:3]) @ (0.1 * way)
    hand = center[part] + (gate.body.radius[part] + 0.02) * way
    nobody = Hazards.at(np.empty((0, 3)), 0.0)
    firm = (hand + 0.05 * way)[None].astype(np.float32)
    for clamp in (Clamp(), Clamp(firm, hand[None].astype(np.float32), 0.0173, 0.002)):
        law = GentleSpeed("palm", Hazards.at(hand[None], 0.0173), 0.05, clamp=clamp)
        gate.contact = law
        view = gate.judge(robot.home, motion, nobody)
        said = law.words(view, gate.body, part)
        assert view.share[part] < 1.0
        assert ("something firm" in said) == bool(len(clamp.firm))
        assert not law.gentle(gate.body, robot.home, motion)[part]


@pytest.mark.parametrize("declared", [True, False])
def test_a_hand_on_something_firm_is_pressed_no_harder_than_was_granted(declared: bool) -> None:
    """It was pressed with 150 to 200 N of 30, as it still is on what nobody has declared."""
    start = np.array([0.49, 0.11, 0.28])  # of the pen's tip
    way = np.array([0.6, -0.2, 0.2]) / np.linalg.norm([0.6, -0.2, 0.2])
    center = start + 0.2 * way
    target = Target(lambda t: center, 0.05, HAND.mass, HAND.stiffness, 1e5)
    cell = TouchCell(target, seed=4)
    if declared:
        cell.declare_firm(center + 0.05 * way, way)
    toucher = Toucher(
        cell, "hand", 0.05, np.random.default_rng(0), noise=0.0002, limits=(0.1, 30.0, 5.0)
    )
    try:
        while cell.now < (18.0 if declared else 5.0) and not toucher.done:
            cell.tick(goal=toucher())
        force = max((c.force for c in cell.contacts), default=0.0)
    finally:
        cell.close()
    if declared:
        assert 1.0 < force <= 30.0
    else:
        assert force > 60.0
