"""What is held belongs to the arm's body: its spheres, its weight, its contacts, its pictures."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.motion.scenes import make_snapshot

from armsight.errors import ArmsightError
from armsight.geometry.pose import from_rpy, make_pose
from armsight.geometry.shapes import Solid
from armsight.mapping.self_filter import body_fields
from armsight.motion.collision import CollisionModel
from armsight.motion.nearest import MovingBody
from armsight.robots import load_robot, load_tool
from armsight.robots.held import COARSER, FINEST, MOST, holding, spheres_of
from armsight.robots.kinematics import flange_pose, sphere_centers
from armsight.simulation.spec import ArmSpec, WorldSpec
from armsight.simulation.world import SimulatedWorld
from armsight.workcell import robot_in
from armsight.workcell.load import parse_workcell
from armsight.workcell.packaged import packaged

LENGTH = st.floats(0.005, 0.6)


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(["box", "cylinder", "sphere"]),
    st.tuples(LENGTH, LENGTH, LENGTH),
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
)
def test_the_spheres_of_a_solid_hold_all_of_it_and_not_much_more(kind, size, turn):
    solid = Solid("it", kind, size, from_rpy(turn, (0.1, -0.2, 0.3)))
    center, radius = spheres_of(solid)
    assert len(radius) <= MOST
    rng = np.random.default_rng(0)
    reach = np.linalg.norm(size)
    points = solid.T_frame_solid[:3, 3] + rng.uniform(-reach, reach, (3000, 3))
    gap = np.min(np.linalg.norm(points[:, None] - center, axis=2) - radius, axis=1)
    inside = solid.distance(points)
    assert (gap[inside <= 0.0] <= 1e-9).all()
    if kind == "sphere":
        return
    extent = np.array(size if kind == "box" else (2 * size[0], 2 * size[0], size[1]))
    edges = np.geomspace(FINEST, 1.2, 200)
    fits = [edge for edge in edges if np.prod(extent / edge + 1.0) <= MOST]
    # Some grid of that edge has few enough cells; the one that is taken is a step coarser at most.
    assert (inside[gap <= 0.0] <= np.sqrt(3.0) * COARSER * fits[0] + 1e-9).all()


BOARD = Solid("board", "box", (0.5, 0.3, 0.02), make_pose(None, (0.0, 0.0, 0.15)))


def test_a_board_that_is_held_weighs_and_is_kept_clear_of_things():
    bare = load_robot("ur5").with_tool(load_tool("pen"))
    tool = holding(load_tool("pen"), [BOARD], [2.0])
    robot = load_robot("ur5").with_tool(tool)
    pen = load_tool("pen")
    assert tool.mass == pen.mass + 2.0
    expected = (pen.mass * pen.center_of_mass + 2.0 * np.array([0, 0, 0.15])) / tool.mass
    assert tool.center_of_mass == pytest.approx(expected)
    corner = flange_pose(robot, robot.home) @ np.array([0.24, 0.14, 0.15, 1.0])
    pole = Solid("pole", "sphere", (0.02, 0.0, 0.0), make_pose(None, corner[:3]))
    seen = make_snapshot([pole], counts_unknown=False)
    assert CollisionModel(bare).valid(bare.home, seen)
    assert not CollisionModel(robot).valid(robot.home, seen)
    body = MovingBody(robot, robot.limits.acceleration)
    center, _ = body.motion(robot.home, np.zeros(6))
    away = np.linalg.norm(center - corner[:3], axis=1) - body.radius
    assert away.min() < 0.0, "the guard protects people from it, too"
    assert len(robot.without_tool().spheres.radius) == len(load_robot("ur5").spheres.radius)
    moved = tool.moved(make_pose(None, (0.0, 0.1, 0.0)))
    assert moved.held[0].T_frame_solid[:3, 3] == pytest.approx([0.0, 0.1, 0.15])


def test_a_hand_without_a_tool_may_hold_something():
    robot = load_robot("ur5").with_tool(holding(None, [BOARD]))
    center = sphere_centers(robot, robot.home)
    assert len(center) > len(load_robot("ur5").spheres.radius)
    fields = body_fields(robot, from_meshes=False)
    assert fields.link[-1] == robot.n
    assert len(fields.link) == len(body_fields(load_robot("ur5"), from_meshes=False).link) + 1


def test_the_simulated_arm_touches_with_what_it_holds():
    robot = load_robot("ur5").with_tool(holding(None, [BOARD]))
    corner = flange_pose(robot, robot.home) @ np.array([0.24, 0.14, 0.15, 1.0])
    ball = Solid("ball", "sphere", (0.02, 0.0, 0.0), make_pose(None, corner[:3]))
    for held, touched in ((robot, True), (load_robot("ur5"), False)):
        spec = WorldSpec(ArmSpec(held, np.eye(4), held.home), undeclared=(ball,), floor=False)
        with SimulatedWorld(spec) as world:
            world.advance(0.05)
            assert bool(world.truth.contacts) == touched
            assert {c.link for c in world.truth.contacts} <= {6}


def test_a_cells_file_says_what_is_held():
    text = packaged()["ur5_four_cameras"].read_text("utf-8")
    held = '[[held]]\nname = "board"\nsize = [0.5, 0.3, 0.02]\nposition = [0, 0, 0.15]\n'
    cell = parse_workcell(text.replace("[[camera]]", held + "mass_kg = 2.0\n[[camera]]", 1))
    tool = robot_in(cell).tool
    assert tool is not None
    assert tool.mass == 2.0
    assert tool.held[0].size == (0.5, 0.3, 0.02)
    assert robot_in(parse_workcell(text)).tool is None
    with pytest.raises(ArmsightError, match="mass_kg"):
        parse_workcell(text.replace("[[camera]]", held + "mass_kg = -2.0\n[[camera]]", 1))
