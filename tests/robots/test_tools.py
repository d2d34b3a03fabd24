"""Tools: shapes against meshes, tips, mounting on the flange."""

from __future__ import annotations

import json

import numpy as np
import pytest

from armsight.errors import RobotError
from armsight.geometry.pose import exp, transform
from armsight.robots import TOOL_NAMES, load_robot, load_tool
from armsight.robots.kinematics import flange_pose, sphere_centers, tcp_pose
from armsight.robots.meshes import join_triangles, read_mesh
from armsight.robots.solids import sample_surface
from armsight.robots.tools import SPHERE_TOOL, TOOLS_DATA, load_tool_folder, tool_sheet

from .test_shapes import plain_gap


@pytest.mark.parametrize("name", TOOL_NAMES)
def test_shapes_cover_the_meshes(name):
    tool, sheet = load_tool(name), tool_sheet(name)
    points = sample_surface(join_triangles([read_mesh(m) for m in tool.meshes]), 0.002)
    s, c = tool.spheres, tool.capsules
    assert plain_gap(points, s.center, s.center, s.radius).max() <= 0.0005
    assert plain_gap(points, c.start, c.end, c.radius).max() <= 0.0005
    assert sheet.sphere_fit.coverage == sheet.capsule_fit.coverage == 1.0
    assert sheet.license in {"Apache-2.0"}
    assert 0.1 < tool.mass < 5
    assert np.linalg.norm(tool.center_of_mass) < 0.2


@pytest.mark.parametrize("name", TOOL_NAMES)
def test_tool_sits_on_the_flange_and_its_tip_is_ahead(name):
    tool = load_tool(name)
    points = np.concatenate([read_mesh(m)[0] for m in tool.meshes])
    assert -0.03 <= points[:, 2].min() <= 0.001  # the Panda's hand wraps its flange
    T = tool.T_flange_tcp
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-8)
    np.testing.assert_allclose(T[:3, 2], [0, 0, 1], atol=1e-8)
    assert 0.03 < T[2, 3] <= 0.25
    beyond = 0.0751 if name == SPHERE_TOOL else 0.025  # the marker's tip is its middle
    assert points[:, 2].max() - T[2, 3] < beyond


def test_calibration_board_shows_t1s_pattern():
    """7x5 squares of 30 mm, the first corner hollow, centred on the tip, facing outward."""
    tool = load_tool("calibration_board")
    dark = next(m for m in tool.meshes if max(m.color) < 0.1)
    vertices, _ = read_mesh(dark)
    at_tip = transform(np.linalg.inv(tool.T_flange_tcp), vertices)
    np.testing.assert_allclose(at_tip[:, :2].min(0), [-0.105, -0.075], atol=1e-5)
    np.testing.assert_allclose(at_tip[:, :2].max(0), [0.105, 0.075], atol=1e-5)
    assert abs(at_tip[:, 2]).max() < 0.001
    hollow = (np.abs(at_tip[:, 0] + 0.09) < 0.014) & (np.abs(at_tip[:, 1] - 0.06) < 0.014)
    opposite = (np.abs(at_tip[:, 0] - 0.09) < 0.014) & (np.abs(at_tip[:, 1] + 0.06) < 0.014)
    assert hollow.any()
    assert not opposite.any()


@pytest.mark.parametrize("name", TOOL_NAMES)
def test_carrying_a_tool(name):
    arm, tool = load_robot("ur5"), load_tool(name)
    robot = arm.with_tool(tool)
    q = np.random.default_rng(0).uniform(-2, 2, 6)
    np.testing.assert_allclose(tcp_pose(robot, q), flange_pose(arm, q) @ tool.T_flange_tcp)
    np.testing.assert_array_equal(tcp_pose(arm, q), flange_pose(arm, q))
    own = len(arm.spheres.radius)
    np.testing.assert_allclose(
        sphere_centers(robot, q)[own:],
        transform(flange_pose(arm, q), tool.spheres.center),
        atol=1e-9,
    )
    assert set(map(tuple, robot.self_pairs)) >= set(map(tuple, arm.self_pairs))
    assert (2, 6) in set(map(tuple, robot.self_pairs))
    with pytest.raises(ValueError, match="already carries"):
        robot.with_tool(tool)


@pytest.mark.parametrize("name", TOOL_NAMES)
def test_a_tool_that_is_mounted_elsewhere(name):
    """Moved in the flange's frame, all of it hangs where the product of the poses says."""
    arm, tool = load_robot("ur5"), load_tool(name)
    T = exp(np.array([0.01, -0.02, 0.005, 0.05, -0.1, 0.02]))
    moved = tool.moved(T)
    robot = arm.with_tool(moved)
    q, own = arm.home, len(arm.spheres.radius)
    flange = flange_pose(arm, q) @ T
    expected = transform(flange, tool.spheres.center)
    np.testing.assert_allclose(sphere_centers(robot, q)[own:], expected, atol=1e-9)
    np.testing.assert_allclose(tcp_pose(robot, q), flange @ tool.T_flange_tcp, atol=1e-12)
    for old, new in (
        (tool.capsules.start, moved.capsules.start),
        (tool.capsules.end, moved.capsules.end),
    ):
        np.testing.assert_allclose(new, transform(T, old), atol=1e-12)
    np.testing.assert_allclose(moved.meshes[0].T_link_mesh, T @ tool.meshes[0].T_link_mesh)
    bare = robot.without_tool()
    assert bare.tool is None
    for a, b in ((bare.spheres, arm.spheres), (bare.capsules, arm.capsules)):
        np.testing.assert_array_equal(a.radius, b.radius)
    np.testing.assert_array_equal(bare.self_pairs, arm.self_pairs)
    assert arm.without_tool() is arm


def test_unknown_and_broken_tools_are_named(tmp_path):
    with pytest.raises(RobotError, match=r'unknown tool "griper".*did you mean "gripper"'):
        load_tool("griper")
    with pytest.raises(RobotError, match=r"tool.json: cannot be read"):
        load_tool_folder(tmp_path)
    path = tmp_path / "tool.json"
    for text, message in (
        ("{", "is not JSON"),
        ("[]", "is broken"),
        ("{}", "is missing"),
    ):
        path.write_text(text)
        with pytest.raises(RobotError, match=message):
            load_tool_folder(tmp_path)
    data = json.loads((TOOLS_DATA / "pen" / "tool.json").read_text())
    path.write_text(json.dumps(data))
    with pytest.raises(RobotError, match=r"mesh .*pen_0.obj is missing"):
        load_tool_folder(tmp_path)
    data["T_flange_tcp"] = [1, 2]
    path.write_text(json.dumps(data))
    with pytest.raises(RobotError, match="is broken"):
        load_tool_folder(tmp_path)
