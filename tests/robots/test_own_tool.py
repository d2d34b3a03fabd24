"""A tool of the user's own, from a folder to a robot in a cell."""

import numpy as np
import pytest
import trimesh

from armsight.errors import RobotError
from armsight.geometry.pose import from_rpy
from armsight.robots import load_robot, load_tool
from armsight.robots.meshes import read_mesh
from armsight.workcell import parse_workcell
from armsight.workcell.problems import WorkcellFileError

SHEET = """
tip = [0, 0, 0.15]
tip_rpy_deg = [0, 0, 90]
mass = 0.8
center_of_mass = [0, 0.01, 0.05]
{body}
"""
BOX = """
[[box]]
size = [0.06, 0.10, 0.08]
position = [0, 0, 0.04]

[[cylinder]]
radius = 0.01
length = 0.07
position = [0, 0, 0.115]
color = [1, 0, 0]
"""


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def folder_of(tmp_path, body, name="my_gripper"):
    folder = tmp_path / name
    folder.mkdir(exist_ok=True)
    (folder / "tool.toml").write_text(SHEET.format(body=body))
    return folder


def test_a_tool_of_primitives(tmp_path):
    tool = load_tool(str(folder_of(tmp_path, BOX)))
    assert tool.name == "my_gripper"
    assert tool.mass == 0.8
    np.testing.assert_allclose(
        tool.T_flange_tcp, from_rpy([0, 0, np.pi / 2], [0, 0, 0.15]), atol=1e-12
    )
    # Every point of the box and of the rod is inside a sphere; none stands far out.
    rng = np.random.default_rng(0)
    inside = rng.uniform([-0.03, -0.05, 0.0], [0.03, 0.05, 0.08], (500, 3))
    rod = rng.uniform([-0.007, -0.007, 0.08], [0.007, 0.007, 0.15], (200, 3))
    for points in (inside, rod):
        away = np.linalg.norm(points[:, None] - tool.spheres.center, axis=2) - tool.spheres.radius
        assert (away.min(1) <= 0.0).all()
    top = (tool.spheres.center[:, 2] + tool.spheres.radius).max()
    assert 0.15 <= top < 0.18
    vertices, _ = read_mesh(tool.meshes[1])
    assert vertices[:, 2].max() == pytest.approx(0.15)
    assert tool.meshes[1].color == (1, 0, 0)
    robot = load_robot("ur5").with_tool(tool)
    assert len(robot.spheres.radius) == len(load_robot("ur5").spheres.radius) + len(
        tool.spheres.radius
    )


def test_a_mesh_in_millimetres(tmp_path):
    body = '[[mesh]]\nfile = "hand.stl"\nscale = {}\nposition = [0, 0, 0.05]'
    folder = folder_of(tmp_path, body.format(0.001))
    trimesh.creation.box((60, 40, 100)).export(folder / "hand.stl")
    tool = load_tool(str(folder))
    vertices, _ = read_mesh(tool.meshes[0])
    np.testing.assert_allclose(vertices.max(0), [0.03, 0.02, 0.10], atol=1e-6)
    with pytest.raises(RobotError, match=r"hand\.stl reaches .* scale = 0\.001"):
        load_tool(str(folder_of(tmp_path, body.format(1.0))))


def test_a_changed_file_is_made_anew_and_nothing_else(tmp_path, cache):
    folder = folder_of(tmp_path, BOX)
    first = load_tool(str(folder))
    assert load_tool(str(folder)) is first
    made = list(cache.rglob("tool.json"))
    assert len(made) == 1
    folder_of(tmp_path, BOX.replace("0.06, 0.10", "0.08, 0.10"))
    second = load_tool(str(folder))
    assert len(list(cache.rglob("tool.json"))) == 2
    assert read_mesh(second.meshes[0])[0][:, 0].max() == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("", "no body"),
        ("[[box]]\nsize = [0.1, 0.1]", "box.0.size"),
        ("[[box]]\nsize = [0.1, 0.1, -1]", "box.0.size.2"),
        ("[[box]]\nsise = [0.1, 0.1, 0.1]", "box.0"),
        ('[[mesh]]\nfile = "none.stl"', r"none\.stl is missing"),
        ("[[sphere]]\nradius = 0.05\nposition = [0, 0, 3]", "reaches 3.05 m"),
        ("[[sphere]]\nradius = nan", "radius"),
        ("[[sphere]", "is not TOML"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, body, message):
    with pytest.raises(RobotError, match=message) as error:
        load_tool(str(folder_of(tmp_path, body)))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("key", ["tip = [0, 0, 0.15]", "center_of_mass = [0, 0.01, 0.05]"])
def test_a_place_in_millimetres_is_told(tmp_path, key):
    folder = folder_of(tmp_path, BOX)
    name = key.split(" =")[0]
    sheet = (folder / "tool.toml").read_text().replace(key, f"{name} = [0, 0, 150]")
    (folder / "tool.toml").write_text(sheet)
    with pytest.raises(RobotError, match=rf"tool.toml: {name} is 150 m from the flange"):
        load_tool(str(folder))


def test_in_a_cell_by_a_path_beside_its_file(tmp_path):
    folder_of(tmp_path, BOX)
    text = '[cell]\nname = "c"\n[robot]\nmodel = "ur5"\ntool = "./my_gripper"\n'
    cell = parse_workcell(text, "cell.toml", tmp_path)
    assert cell.robot.tool == str(tmp_path / "my_gripper")
    with pytest.raises(WorkcellFileError, match="no such folder"):
        parse_workcell(text.replace("my_gripper", "other"), "cell.toml", tmp_path)
    with pytest.raises(WorkcellFileError, match="unknown tool"):
        parse_workcell(text.replace("./my_gripper", "my_gripper"), "cell.toml", tmp_path)
