"""The cable: what its curve pulls with, beside a chain in MuJoCo and beside published forms."""

import numpy as np
import pytest

from armsight.geometry.pose import inverse, transform
from armsight.robots.cable import HungCable, SwingingCable
from armsight.simulation.cable import GRAVITY, CableChain, cable_points, cable_pull
from armsight.simulation.spec import CableSpec
from armsight.simulation.world import SimulatedWorld
from armsight.workcell import parse_workcell, robot_in, world_spec
from armsight.workcell.packaged import packaged

HANGER = (-0.3, 0.0, 2.0)


@pytest.mark.parametrize(
    ("end", "length", "within"),
    [((0.6, 0.05, 0.85), 1.9, 0.8), ((0.3, -0.3, 1.1), 1.6, 0.8)],
)
def test_the_curve_pulls_as_the_bending_chain_does(end, length, within):
    """Half a second of the processor each. A stiffer cable pulls otherwise: that is said."""
    limp = CableSpec(HANGER, length, bending=0.05)
    chain = CableChain(limp, np.array(end))
    hung = chain.settle(3.0)
    np.testing.assert_allclose(hung, cable_pull(limp, np.array(end)), atol=within)
    curve = cable_points(limp, np.array(end), 25)[:-1]
    assert np.linalg.norm(chain.joints - curve, axis=1).max() < 0.04


def test_a_curve_is_as_long_as_its_cable_and_carries_its_weight():
    """Both ends together hold the whole weight, and nothing pulls aside but they each other."""
    spec, end = CableSpec(HANGER, 1.9), np.array([0.6, 0.05, 0.85])
    points = cable_points(spec, end, 2000)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(1.9, rel=1e-4)
    np.testing.assert_allclose(points[[0, -1]], [end, HANGER], atol=1e-9)
    there = CableSpec(tuple(end), 1.9)
    both = cable_pull(spec, end) + cable_pull(there, np.array(HANGER))
    np.testing.assert_allclose(both, [0, 0, -GRAVITY * 2.26 * 1.9], atol=1e-6)


def test_straight_below_its_hanger_it_carries_half_of_what_hangs_below():
    spec = CableSpec((0.0, 0.0, 2.0), 1.6)
    np.testing.assert_allclose(
        cable_pull(spec, np.array([0.0, 0.0, 1.0])), [0, 0, -0.5 * GRAVITY * 2.26 * 0.6]
    )
    aside = cable_pull(spec, np.array([0.005, 0.0, 1.0]))
    assert aside[2] == pytest.approx(-0.5 * GRAVITY * 2.26 * 0.6, rel=0.01)


def test_a_cable_that_is_too_short_pulls_hard_towards_its_hanger():
    spec = CableSpec(HANGER, 1.0)
    end = np.array([0.6, 0.0, 0.85])
    pull = cable_pull(spec, end)
    assert np.linalg.norm(pull) > 100.0
    way = np.asarray(HANGER) - end
    assert pull @ way / (np.linalg.norm(pull) * np.linalg.norm(way)) > 0.99


@pytest.mark.parametrize("way", [(0.0, 0.5, 0.0), (-0.4, 0.0, 0.2)])
def test_a_cable_swings_as_the_chain_of_the_contact_physics_does(way):
    """Its end is led at up to 1 m/s and stops; its curve alone would be 20 cm away."""
    end, step = np.array([0.6, 0.05, 0.85]), 0.02
    chain = CableChain(CableSpec(HANGER, 1.9), end)
    chain.settle(1.0)
    rope = SwingingCable(HungCable(HANGER, 1.9))
    for k in range(100):
        rope.follow(end, step * k)
    assert (np.abs(rope.velocity) < 0.1).all()
    off, curved = [], []
    for k in range(60):
        s = np.clip(step * k + np.linspace(0.001, step, 20), 0.0, 1.0)
        s = s - np.sin(2.0 * np.pi * s) / (2.0 * np.pi)
        ends = end + np.outer(s, way)
        chain.follow(ends)
        rope.follow(ends[-1], 2.0 + step * k)
        off.append(apart(chain.joints, rope.place))
        curved.append(apart(chain.joints, cable_points(CableSpec(HANGER, 1.9), ends[-1], 25)))
    assert max(off) < 0.04
    assert max(curved) > 3.0 * max(off)


def apart(points, line):
    """How far (n, 3) points are from a line of pieces at most [m]."""
    a, d = line[:-1], np.diff(line, axis=0)
    s = np.clip(((points[:, None] - a) * d).sum(axis=2) / (d * d).sum(axis=1), 0.0, 1.0)
    gaps = np.linalg.norm(points[:, None] - a - s[..., None] * d, axis=2)
    return gaps.min(axis=1).max()


def test_a_swinging_cable_keeps_its_length_and_comes_to_rest_on_its_curve():
    """A limp one; the steps keep its length to a millimetre whatever its end does."""
    cable = HungCable(HANGER, 1.9, bending=0.0)
    rope, end = SwingingCable(cable), np.array([0.6, 0.05, 0.85])
    rope.follow(end, 0.0)
    rng = np.random.default_rng(1)
    for k in range(1, 60):
        end = end + rng.uniform(-0.02, 0.02, 3)
        rope.follow(end, 0.03 * k)
        pieces = np.linalg.norm(np.diff(rope.place, axis=0), axis=1)
        np.testing.assert_allclose(pieces, 1.9 / 16, atol=1e-3)
        np.testing.assert_allclose(rope.place[[0, -1]], [end, HANGER], atol=1e-6)
    still = SwingingCable(HungCable(HANGER, 1.9, bending=0.01))
    for k in range(100):
        still.follow(end, 0.1 * k)
    assert apart(still.place, cable.still(end, 200)) < 0.01


def test_the_cable_of_a_cell_hangs_from_where_its_file_says_and_is_seen():
    text = packaged()["ur10_charging"].read_text("utf-8")
    hung = "cable_n = 10\nhanger = [0.1, -0.7, 2.1]\ncable_m = 2.1\ncable_mm = 40\n"
    cell = parse_workcell(text.replace("cable_n = 15\n", hung))
    cable = robot_in(cell).tool.cable
    assert cable.radius == pytest.approx(0.02)
    np.testing.assert_allclose(cable.hanger, [0.1, -0.7, 1.7], atol=1e-9)  # the base is 0.4 m up
    assert robot_in(parse_workcell(text)).tool.cable is None
    with SimulatedWorld(world_spec(cell), seed=2) as world:
        world.advance(0.3)
        points = world.plugged.cable_points
        np.testing.assert_allclose(points[0], world.plugged.cable_end, atol=2e-3)
        np.testing.assert_allclose(points[-1], [0.1, -0.7, 2.1], atol=1e-9)
        drawn = [m for m in world.movers() if m.name.startswith("cable/")]
        for k, piece in enumerate(drawn):
            ends = piece.T_world_solid[:3, 3] + np.outer(
                [-0.5, 0.5], piece.solid.size[1] * piece.T_world_solid[:3, 2]
            )
            np.testing.assert_allclose(ends, points[k : k + 2], atol=2e-3)
        left = world.cameras[0]
        while (frame := left.read()) is not None:
            depth, info = frame.depth, left.info
        middle = inverse(info.T_mount_camera) @ inverse(cell.robot.T_world_base)
        at = transform(middle, points[8:9])
        u, v = info.depth.project(at)[0]
        near = depth[round(v) - 3 : round(v) + 4, round(u) - 3 : round(u) + 4]
        assert np.nanmin(near) == pytest.approx(at[0, 2] - 0.02, abs=0.08)


def test_a_led_cable_hangs_as_at_first_after_a_reset():
    def led(world, seconds):
        places = []
        while world.clock.now() < seconds - 1e-9:
            world.arm.command_velocity(np.array([0.8, -0.4, 0.0, 0.0, 0.0, 0.0]))
            world.advance(world.clock.now() + 0.01)
            places.append(world.plugged.cable_points)
        return np.array(places)

    text = packaged()["ur10_charging"].read_text("utf-8")
    hung = "cable_n = 10\nhanger = [0.1, -0.7, 2.1]\ncable_m = 2.1\ncable_mm = 40\n"
    cell = parse_workcell(text.replace("cable_n = 15\n", hung))
    with SimulatedWorld(world_spec(cell), seed=2) as world:
        first = led(world, 0.3)
        assert np.abs(first[-1] - first[5]).max() > 0.05  # it was led
        world.reset()
        assert np.array_equal(led(world, 0.3), first)
