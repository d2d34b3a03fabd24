"""The packaged cells, the file's poses in the base frame, drivers, and the generated reference."""

from pathlib import Path

import numpy as np
import pytest

from armsight.errors import WorkcellError
from armsight.geometry.pose import inverse, transform
from armsight.robots.sprung_tip import SprungTip
from armsight.workcell import (
    camera_info_of,
    load_workcell,
    open_cell,
    parse_workcell,
    robot_in,
    world_spec,
)
from armsight.workcell.document import renewed
from armsight.workcell.packaged import folder, packaged

ROOT = Path(__file__).resolve().parents[2]
INVERTED = """
[cell]
name = "t"
[robot]
model = "ur10"
position = [0.2, -0.1, 1.9]
rpy_deg = [180, 0, 90]
joint_upper_deg = [90, 360, 180, 360, 360, 360]
home_deg = [0, -20, -90, 20, 90, 0]
[[camera]]
name = "c"
model = "kinect_v2"
position = [1.5, 0.5, 1.0]
look_at = [0.0, 0.0, 0.5]
latency_ms = 25
phase_ms = 7
[[camera]]
name = "down"
model = "kinect_v1"
position = [0.5, 0.5, 2.5]
look_at = [0.5, 0.5, 0.0]
[[camera]]
name = "wrist"
model = "f200"
mounted_on = "flange"
position = [0.0, 0.05, 0.03]
rpy_deg = [0, 0, 0]
[[solid]]
name = "table"
size = [1.0, 2.0, 0.1]
position = [0.5, 0.0, 0.7]
[simulation]
stamp_jitter_ms = 2
calibration_error_mm = 3
calibration_error_deg = 0.5
[[simulation.person]]
name = "p"
position = [1.5, 0, 0]
yaw_deg = 180
"""


@pytest.mark.parametrize("name", packaged())
def test_packaged_cells_are_good_and_named_like_their_files(name):
    cell = load_workcell(packaged()[name])
    assert cell.name == name
    assert len(cell.goals) != 1
    assert cell.file == packaged()[name].resolve()
    assert parse_workcell(cell.text).model_dump() == cell.model_dump()


def test_the_blank_is_good_and_so_with_all_its_comments_opened():
    text = (folder() / "blank.toml").read_text()
    parse_workcell(text)
    opened = []
    for line in text.splitlines():
        bare = line.removeprefix("# ")
        is_toml = bare.startswith("[") or (" = " in bare and bare.split(" = ")[0].isidentifier())
        opened.append(bare if line.startswith("# ") and is_toml else line)
    opened = "\n".join(opened).replace("[robot]", "[robot]", 1)
    cell = parse_workcell(opened)
    assert cell.solid
    assert cell.goals
    assert cell.simulation.person


def test_world_becomes_base():
    cell = parse_workcell(INVERTED)
    T = cell.robot.T_world_base
    # Independent: [180, 0, 90] about fixed axes sends base x to world y, base z down.
    assert T[:3, 0] == pytest.approx([0, 1, 0], abs=1e-12)
    assert T[:3, 2] == pytest.approx([0, 0, -1], abs=1e-12)
    info = camera_info_of(cell, cell.camera[0])
    world = transform(T @ info.T_mount_camera, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    assert world[0] == pytest.approx([1.5, 0.5, 1.0])
    ahead = (world[1] - world[0]) @ (np.array([0, 0, 0.5]) - world[0])
    assert ahead == pytest.approx(np.linalg.norm([1.5, 0.5, 0.5]))
    assert info.mounted_on == "base"
    assert info.latency == 0.025
    assert info.rate == 15.0


def test_a_camera_may_look_straight_down():
    cell = parse_workcell(INVERTED)
    T = cell.camera[1].T_mount_camera
    assert T[:3, 2] == pytest.approx([0, 0, -1])
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def test_flange_cameras_stay_in_the_flange():
    cell = parse_workcell(INVERTED)
    info = camera_info_of(cell, cell.camera[2])
    assert info.mounted_on == "flange"
    assert info.T_mount_camera[:3, 3] == pytest.approx([0.0, 0.05, 0.03])


def test_robot_has_the_cells_home_and_narrower_limits():
    robot = robot_in(parse_workcell(INVERTED))
    assert np.rad2deg(robot.home) == pytest.approx([0, -20, -90, 20, 90, 0])
    assert np.rad2deg(robot.limits.upper)[:2] == pytest.approx([90, 360])
    assert np.rad2deg(robot.limits.lower)[0] == pytest.approx(-360)


def test_world_spec_carries_everything_in_si():
    spec = world_spec(parse_workcell(INVERTED))
    camera = spec.cameras[0]
    assert camera.pose_error == pytest.approx((0.003, np.deg2rad(0.5)))
    assert camera.stamp_jitter == pytest.approx(0.002)
    assert camera.phase == pytest.approx(0.007)
    assert camera.T_mount_camera_declared[:3, 3] == pytest.approx([1.5, 0.5, 1.0])
    assert spec.arm.start_delay == pytest.approx(0.06)
    assert spec.static[0].T_frame_solid[:3, 3] == pytest.approx([0.5, 0.0, 0.7])
    person = spec.people[0].T_world_person
    assert person[:3, 0] == pytest.approx([-1, 0, 0], abs=1e-12)


def test_ideal_cameras_when_errors_are_off():
    cell = parse_workcell(INVERTED.replace("[simulation]", "[simulation]\nsensor_errors = false"))
    spec = world_spec(cell)
    assert not spec.cameras[0].errors
    assert spec.cameras[0].info.depth.is_ideal


def test_open_cell_simulates(gl):
    cell = parse_workcell(INVERTED)
    with open_cell(cell, seed=1) as opened:
        assert opened.simulated
        assert [c.info.name for c in opened.cameras] == ["c", "down", "wrist"]
        T = inverse(opened.T_world_base)
        table = opened.static[0].T_frame_solid
        assert table[:3, 3] == pytest.approx(transform(T, np.array([[0.5, 0.0, 0.7]]))[0])
        opened.world.advance(0.2)
        assert opened.clock.now() == pytest.approx(0.2)
        assert opened.arm.read().position == pytest.approx(opened.robot.home, abs=1e-3)
    opened.close()  # again does no harm


def test_the_reference_is_current():
    page = (ROOT / "docs" / "workcell.md").read_text(encoding="utf-8")
    assert renewed(page) == page, "run: python -m armsight.workcell.document docs/workcell.md"


def test_every_key_of_the_reference_has_a_meaning():
    page = (ROOT / "docs" / "workcell.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    assert len(rows) > 60
    assert not [row for row in rows if row.rstrip("| ").endswith("|") or "value |" in row]


def test_a_tip_on_springs_is_the_tools_and_asks_for_a_force_sensor():
    plain = '[cell]\nname = "t"\n[robot]\nmodel = "ur10"\ntool = "pen"\n'
    tip = "[tip]\nspring_n_per_mm = 0.2\ntravel_mm = 30\nseat_n = 1\n"
    tool = robot_in(parse_workcell(plain + tip + "[wrench]\n")).tool
    assert tool.tip == SprungTip(200.0, 0.03, 1.0, 0.1)
    assert robot_in(parse_workcell(plain)).tool.tip is None
    with pytest.raises(WorkcellError, match=r"\[tip\] needs a \[wrench\]"):
        robot_in(parse_workcell(plain + tip))
