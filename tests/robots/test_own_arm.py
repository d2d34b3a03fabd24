"""A user's own arm, from a folder or a URDF: its fit is made once, kept, and never out of date."""

from __future__ import annotations

import json
import logging
from dataclasses import replace

import numpy as np
import pytest

from armsight.cli import run
from armsight.errors import RobotError, WorkcellError
from armsight.robots import folder, load_arm, load_robot
from armsight.robots.fit_cache import cache_folder
from armsight.robots.kinematics import flange_pose
from armsight.robots.link_body import FitOptions
from armsight.workcell import load_workcell

LIMIT = '<limit lower="-2" upper="2.5" velocity="1.5" effort="10"/>'


def urdf(shape: str, limit: str = LIMIT, **links: str) -> str:
    """Three joints in a row, each link with one shape."""
    looks = f"<visual><geometry>{shape}</geometry></visual>"
    rows = [f'<robot name="mine"><link name="l0">{looks}</link>']
    for i, axis in enumerate(("0 0 1", "0 1 0", "0 1 0"), 1):
        rows.append(
            f'<joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="0 0 0.3"/><axis xyz="{axis}"/>{limit}</joint>'
            f'<link name="l{i}">{looks}{links.get(f"l{i}", "")}</link>'
        )
    return "".join(rows) + "</robot>"


SPHERES = urdf('<sphere radius="0.05"/>').replace("visual", "collision")
"""An arm that brings its own spheres: nothing is fitted."""
ROD = urdf('<cylinder radius="0.03" length="0.2"/>')


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    rough = FitOptions(rounds=1, configurations=8, completions=2, voxel=0.006, spacing=0.01)
    rough = replace(rough, check_spacing=0.004, most_axes=100, most_points=300, most_around=300)
    monkeypatch.setattr(folder, "QUICK", rough)


def cell(tmp_path, model: str) -> None:
    text = f'[cell]\nname = "own"\n[robot]\nmodel = "{model}"\n'
    (tmp_path / "cell.toml").write_text(text)


def test_a_urdf_is_fitted_once_and_kept(tmp_path, caplog):
    path = tmp_path / "rod.urdf"
    path.write_text(ROD)
    caplog.set_level(logging.INFO, "armsight")
    robot = load_robot(str(path))
    assert (robot.name, robot.n, robot.reach) == ("rod", 3, pytest.approx(0.3))
    assert "Fitting shapes to" in caplog.text
    assert "spheres: cover 100.00 %" in caplog.text
    # The far end of the last rod is covered.
    ends = np.array([[0.03, 0.0, 0.0999], [0.0, -0.03, -0.0999]])
    mine = robot.spheres.link == 3
    gaps = np.linalg.norm(ends[:, None] - robot.spheres.center[mine], axis=2)
    assert np.all((gaps - robot.spheres.radius[mine]).min(axis=1) <= 0.0)

    assert len(list(cache_folder().glob("*.json"))) == 1
    caplog.clear()
    again = load_arm(path)
    assert "Fitting" not in caplog.text
    np.testing.assert_array_equal(again.spheres.radius, np.round(robot.spheres.radius, 5))
    # Damage in the cache is no error: the fit is made again.
    (kept,) = cache_folder().glob("*.json")
    kept.write_text(kept.read_text()[:100])
    load_arm(path)
    assert "Fitting" in caplog.text


def test_nothing_that_is_seen_is_left_without_spheres(tmp_path):
    """One sphere at the tip of an arm that is drawn whole: it had no others."""
    path = tmp_path / "arm.urdf"
    ball = '<collision><geometry><sphere radius="0.02"/></geometry></collision>'
    rod = '<cylinder radius="0.03" length="0.2"/>'
    path.write_text(urdf(rod, l3=ball))
    assert set(load_arm(path).spheres.link) == {0, 1, 2, 3}


def test_what_is_fixed_to_a_link_and_has_collision_geometry_alone_is_covered(tmp_path):
    path = tmp_path / "arm.urdf"
    block = '<collision><geometry><box size="0.04 0.04 0.04"/></geometry></collision>'
    held = (
        '<joint name="bolt" type="fixed"><parent link="l3"/><child link="hand"/>'
        f'<origin xyz="0 0 0.25"/></joint><link name="hand">{block}</link></robot>'
    )
    path.write_text(ROD.replace("</robot>", held))
    spheres = load_arm(path).spheres
    mine = spheres.link == 3
    corner = np.array([0.019, 0.019, 0.269])
    gaps = np.linalg.norm(spheres.center[mine] - corner, axis=1) - spheres.radius[mine]
    assert gaps.min() <= 0.0


@pytest.mark.parametrize("bad", ["NaN", "-0.05", "0.05, 0.05"])
def test_shapes_that_cannot_be_are_refused(tmp_path, bad):
    path = tmp_path / "arm.urdf"
    path.write_text(SPHERES)
    assert run(["robots", "fit", str(path)]) == 0
    shapes = tmp_path / "arm.shapes.json"
    shapes.write_text(shapes.read_text().replace("0.05]", f"{bad}]"))
    with pytest.raises(RobotError, match=r"arm.shapes.json: is broken"):
        load_arm(path)


def test_a_changed_urdf_is_another_arm(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(SPHERES)
    first = load_robot(str(path))
    assert load_robot(str(path)) is first
    path.write_text(SPHERES.replace('"0 0 0.3"', '"0 0 0.4"'))
    second = load_robot(str(path))
    assert flange_pose(first, np.zeros(3))[2, 3] == pytest.approx(0.9)
    assert flange_pose(second, np.zeros(3))[2, 3] == pytest.approx(1.2)


def test_the_command_writes_what_a_cell_reads(tmp_path, capsys):
    path = tmp_path / "arm.urdf"
    path.write_text(SPHERES)
    assert run(["robots", "fit", str(path)]) == 0
    out = capsys.readouterr().out
    assert "arm: 3 joints" in out
    assert "no <inertial> for l0, l1, l2, l3" in out
    data = json.loads((tmp_path / "arm.shapes.json").read_text())
    assert len(data["spheres"]["l3"]) == 1
    cell(tmp_path, "./arm.urdf")
    workcell = load_workcell(tmp_path / "cell.toml")
    assert workcell.robot.model == str(tmp_path / "arm.urdf")
    assert run(["check", str(tmp_path / "cell.toml")]) == 0

    path.write_text(SPHERES.replace('radius="0.05"', 'radius="0.06"'))
    with pytest.raises(WorkcellError, match=r"was fitted to other files .*armsight robots fit"):
        load_workcell(tmp_path / "cell.toml")


def test_a_folder_says_what_a_urdf_cannot(tmp_path):
    place = tmp_path / "arm"
    place.mkdir()
    (place / "robot.urdf").write_text(SPHERES)
    (place / "robot.toml").write_text(
        'flange = "l2"\nhome = [0.1, 0.2]\nreach = 0.5\n[limits]\nacceleration = [3, 4]\n'
        "jerk = 50\n[held]\nj3 = 0.5\n"
    )
    robot = load_arm(place)
    assert (robot.name, robot.n, robot.reach) == ("arm", 2, 0.5)
    np.testing.assert_array_equal(robot.home, [0.1, 0.2])
    np.testing.assert_array_equal(robot.limits.acceleration, [3.0, 4.0])
    np.testing.assert_array_equal(robot.limits.jerk, [50.0, 50.0])
    assert flange_pose(robot, np.zeros(2))[2, 3] == pytest.approx(0.6)
    cell(tmp_path, "arm/")
    assert load_workcell(tmp_path / "cell.toml").robot.model.endswith("arm")


def test_a_fast_or_unsaid_speed_can_be_said_in_the_sheet(tmp_path):
    # A small industrial arm's last joint, 1400 deg/s, is taken as it is.
    path = tmp_path / "arm.urdf"
    path.write_text(SPHERES.replace('velocity="1.5"', 'velocity="24.5"'))
    assert load_arm(path).limits.velocity.tolist() == [24.5] * 3
    # Exporters write 0, and people 1000, where nobody knows.
    for said in ("0", "1000"):
        path.write_text(SPHERES.replace('velocity="1.5"', f'velocity="{said}"'))
        with pytest.raises(RobotError, match=r"\[limits\] velocity = "):
            load_arm(path)
    (tmp_path / "arm.toml").write_text("[limits]\nvelocity = [3.1, 3.1, 45]\n")
    assert load_arm(path).limits.velocity.tolist() == [3.1, 3.1, 45.0]


def test_a_joint_without_end_is_turned_where_links_are_found_that_meet(tmp_path):
    # l3, bent up beside l1, meets it only where j2 is turned by half.
    bend = '<origin xyz="0.2 0 0"/><axis xyz="0 0 1"/><limit velocity="1" effort="1"/>'
    text = SPHERES.replace('<origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>' + LIMIT, bend)
    text = text.replace('name="j2" type="revolute"', 'name="j2" type="continuous"')
    text = text.replace('name="j3" type="revolute"', 'name="j3" type="continuous"')
    (tmp_path / "arm.urdf").write_text(text)
    robot = load_arm(tmp_path / "arm.urdf")
    assert np.isfinite(robot.limits.lower).all()
    assert [1, 3] in robot.self_pairs.tolist()


@pytest.mark.parametrize(
    ("corner", "said"), [(100, 'link "l0": its shapes are 100 m long'), (1e-4, "0.1 mm long")]
)
def test_lengths_in_millimetres_are_told(tmp_path, corner, said):
    corners = f"v 0 0 0\nv {corner} 0 0\nv 0 {corner} 0\nv 0 0 {corner}\n"
    (tmp_path / "l.obj").write_text(corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    path = tmp_path / "arm.urdf"
    path.write_text(urdf('<mesh filename="l.obj"/>'))
    with pytest.raises(RobotError, match=f"arm.urdf: .*{said}; lengths are in metres"):
        load_arm(path)


MESH = '<mesh filename="package://their_arm/meshes/link.stl"/>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (urdf('<sphere radius="0.1"/>', ""), 'joint "j1": has no <limit>'),
        (SPHERES.replace("l3", "l1"), "appears twice"),
        (
            SPHERES.replace('<child link="l1"/>', '<child link="l0"/>'),
            "is its own ancestor: the joints form a loop|has 2 roots",
        ),
        (
            '<robot name="bare">' + SPHERES.split(">", 1)[1].replace("collision", "x"),
            "bare.urdf: the robot has no geometry to fit spheres to",
        ),
        (urdf(MESH), r"mesh .*their_arm/meshes/link.stl is missing; .*\[packages\]"),
        (
            '<!DOCTYPE robot [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><robot>&b;</robot>',
            "document type declaration is not allowed",
        ),
        (SPHERES[:-20], "is not well-formed XML"),
        (urdf('<mesh filename="link.step"/>'), "link.step is missing"),
    ],
)
def test_a_bad_urdf_is_one_line_of_the_cell(tmp_path, text, said):
    (tmp_path / "bare.urdf").write_text(text)
    cell(tmp_path, "./bare.urdf")
    with pytest.raises(WorkcellError, match=f"robot.model: .*({said})") as caught:
        load_workcell(tmp_path / "cell.toml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("model", "said"),
    [
        ("./gone.urdf", r"gone.urdf: no such folder or URDF; the path is relative to the cell"),
        ("empty/", r"no robot.urdf in this folder \(URDFs: none\)"),
        ("./arm.urdf.xacro", r"is no folder and no .urdf file; expand it first: xacro"),
        ("ur55", r'unknown robot "ur55"; did you mean "ur5"'),
    ],
)
def test_what_is_not_there_is_named(tmp_path, model, said):
    (tmp_path / "empty").mkdir()
    (tmp_path / "arm.urdf.xacro").write_text("<robot/>")
    cell(tmp_path, model)
    with pytest.raises(WorkcellError, match=f"robot.model: .*{said}"):
        load_workcell(tmp_path / "cell.toml")


def test_meshes_of_other_kinds_and_hostile_ones_are_refused(tmp_path):
    from armsight.robots.meshes import read_mesh_file

    (tmp_path / "a.step").write_text("ISO-10303-21;")
    with pytest.raises(RobotError, match=r"a.step: .step files are not read; expected one of .obj"):
        read_mesh_file(tmp_path / "a.step")
    (tmp_path / "a.dae").write_text('<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><a/>')
    with pytest.raises(RobotError, match="document type declaration is not allowed"):
        read_mesh_file(tmp_path / "a.dae")
    (tmp_path / "a.stl").write_bytes(b"\0" * 80 + (2**31).to_bytes(4, "little") + b"\0" * 50)
    with pytest.raises(RobotError, match=r"a.stl (cannot be read|holds no triangles)"):
        read_mesh_file(tmp_path / "a.stl")


def test_a_mesh_that_is_saved_anew_is_read_anew(tmp_path):
    from armsight.robots.meshes import read_mesh_file

    file = tmp_path / "link.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    first, _ = read_mesh_file(file)
    assert read_mesh_file(file)[0] is first
    file.write_text("v 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    again, faces = read_mesh_file(file)
    assert again.max() == 2.0
    assert len(faces) == 2
    with pytest.raises(ValueError, match="read-only"):
        again[0] = 1.0
