"""Every broken file is told in lines that name file, key, what was found and what is expected."""

from pathlib import Path

import numpy as np
import pytest

from armsight.errors import WorkcellError
from armsight.workcell import load_workcell, parse_workcell
from armsight.workcell.problems import WorkcellFileError
from armsight.workcell.simulated import world_spec

HEAD = """
[cell]
name = "t"
[robot]
model = "ur5"
"""
LIMITS = """
joint_lower_deg = [40, -180, -180, -180, -180, -180]
joint_upper_deg = [50, 180, 180, 180, 180, 180]
"""
CAMERA = """
[[camera]]
name = "c"
model = "kinect_v2"
position = [1.5, 0.0, 1.0]
look_at = [0.0, 0.0, 0.5]
"""
SOLID = """
[[solid]]
name = "s"
size = [1.0, 1.0, 0.1]
position = [0.0, 0.0, -0.5]
"""


def problems(text: str) -> list[str]:
    with pytest.raises(WorkcellError) as caught:
        parse_workcell(text, "f.toml")
    lines = str(caught.value).splitlines()
    assert all(line.startswith("f.toml: ") for line in lines)
    return [line.removeprefix("f.toml: ") for line in lines]


def test_the_smallest_cell_is_good():
    cell = parse_workcell(HEAD)
    assert cell.name == "t"
    assert cell.robot.speed == 0.5


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # Structure.
        ("[robot]\nmodel = 'ur5'", ["cell: missing"]),
        (HEAD + "[gaurd]\nspeed = 1", ['gaurd: unknown key; did you mean "guard"? known: ']),
        (HEAD + "sped = 0.5", ['robot.sped: unknown key; did you mean "speed"? known: ']),
        (HEAD + "camera = 3", ["robot.camera: unknown key; "]),
        ("camera = 3\n" + HEAD, ["camera: found 3, expected a list"]),
        (
            HEAD + CAMERA.replace("[[camera]]", "[camera]"),
            ["camera: found a table, expected a list of tables; write [[camera]]"],
        ),
        ("camera = ['x']\n" + HEAD, ['camera[1]: found "x", expected a table']),
        # Types.
        (HEAD + "speed = 'fast'", ['robot.speed: found "fast", expected a number']),
        (HEAD + "speed = true", ["robot.speed: found true, expected a number"]),
        (HEAD + "speed = nan", ["robot.speed: found nan, expected a finite number"]),
        (HEAD + "speed = inf", ["robot.speed: found inf, expected "]),
        (HEAD + "speed = 50", ["robot.speed: found 50, expected at most 1"]),
        (HEAD + "speed = 0", ["robot.speed: found 0, expected above 0"]),
        (HEAD + "speed = 1979-05-27", ["robot.speed: found 1979-05-27, expected a number"]),
        (HEAD + "position = [0, nan, 0]", ["robot.position[2]: found nan, expected a finite"]),
        (HEAD + "position = [0, 0]", ["robot.position: found [0, 0], expected 3 values"]),
        (HEAD + "position = [0, 0, 0, 1]", ["robot.position: found [0, 0, 0, 1], expected 3"]),
        (HEAD + "position = 1", ["robot.position: found 1, expected a list"]),
        (HEAD + "home_deg = []", ["robot.home_deg: found [], expected 1 to 16 values"]),
        (HEAD + "connection = {host = [1]}", ["robot.connection.host: found [1], expected a str"]),
        ("[cell]\nname = 'a b'\n[robot]\nmodel = 'ur5'", ['cell.name: found "a b", expected a le']),
        # Unknown names, with the nearest.
        (
            HEAD.replace("ur5", "ur6"),
            ['robot.model: unknown robot "ur6"; did you mean "ur'],
        ),
        (
            HEAD + "tool = 'gripper2'",
            ['robot.tool: unknown tool "gripper2"; did you mean "gripper"'],
        ),
        (HEAD + "driver = 'rtde'", ['robot.driver: unknown driver "rtde"; known: simulated']),
        (
            HEAD + CAMERA.replace("kinect_v2", "kinectv2"),
            ['camera[1] "c".model: unknown camera "kinectv2"; did you mean "kinect_v'],
        ),
        (
            HEAD + "[[simulation.person]]\nname='p'\nposition=[1,0,0]\nscript='reachin'",
            ['simulation.person[1] "p".script: unknown script "reachin"; did you mean "reach_in"'],
        ),
        # Units that cannot be right.
        (
            HEAD + CAMERA.replace("[1.5, 0.0, 1.0]", "[40, 0, 1]"),
            ['camera[1] "c".position: found [40, 0, 1], expected metres, at most 10'],
        ),
        (
            HEAD + "[[held]]\nname='h'\nsize=[0.1, 0.1, 0.1]\nposition=[0, 0, 60]",
            ['held[1] "h".position: found [0, 0, 60], expected metres'],
        ),
        (
            HEAD + "[[held]]\nname='h'\nsize=[0.1, 0.1, 0.1]\nposition=[0, 0, 6]",
            ['held[1] "h".position: found [0, 0, 6], 6 m from the flange, expected at most 3 m'],
        ),
        (
            HEAD + "[[held]]\nname='h'\nsize=[100, 100, 60]\nposition=[0, 0, 0.1]",
            ['held[1] "h".size: found [100, 100, 60], expected metres'],
        ),
        (
            HEAD + "[board]\nposition=[0, 0, 60]\nrpy_deg=[3.14159, 0, 0]",
            ["board.position: found [0, 0, 60], expected metres", "looks like radians"],
        ),
        (
            HEAD + "[[simulation.target]]\nname='t'\nposition=[1000, 0, 100]",
            ['target[1] "t".position: found [1000, 0, 100], expected metres'],
        ),
        (
            HEAD + "[simulation.car]\nposition=[1000, 0, 800]\nyaw_deg=3.14159",
            ["simulation.car.position: found [1000, 0, 800]", "looks like radians"],
        ),
        (
            HEAD + "[[simulation.object]]\nname='o'\nkind='sphere'\nradius=0.1\n"
            "position=[1, 0, 0.1]\npath='loose'",
            ['object[1] "o".path: found "loose", which needs simulation.contact_pushes = true'],
        ),
        # What the cell's own limits of the joints leave.
        (
            HEAD + LIMITS + "home_deg=[90, -90, 90, 0, 0, 0]\n[patrol]\ngoals_deg="
            "{A=[45, -90, 90, 0, 0, 0], B=[-45, -90, 90, 0, 0, 0]}",
            [
                "robot.home_deg: joint shoulder_pan_joint: found 90, expected 40 to 50 [deg]",
                "patrol.goals_deg.B: joint shoulder_pan_joint: found -45, expected 40 to 50",
            ],
        ),
        (
            HEAD + CAMERA.replace("[1.5, 0.0, 1.0]", "[1500, 0, 1000]"),
            ["expected metres, at most 10 from the origin; looks like millimetres"],
        ),
        (
            HEAD + CAMERA.replace("[1.5, 0.0, 1.0]", "[6.5, 0, 1]"),
            ["6.58 m from the robot, expected at most 5.35 m: kinect_v2 sees 4.5 m far"],
        ),
        (HEAD + CAMERA + "latency_ms = 0.04", ["found 0.04: looks like seconds, expected milli"]),
        (HEAD + CAMERA + "rate_hz = 60", ["rate_hz: found 60, expected at most 30 [Hz]"]),
        (
            HEAD + "home_deg = [0, -1.5708, 1.5708, -1.5708, -1.5708, 0]",
            ["robot.home_deg: found [0, -1.5708, 1.5708, -1.5708, -1.5708, 0]: looks like radians"],
        ),
        (
            HEAD + "home_deg = [0, -5156, 90, -90, -90, 0]",
            ["joint shoulder_lift_joint: found -5156, expected -360 to 360 [deg]"],
        ),
        (
            HEAD + "joint_upper_deg = [3.14, 3.14, 3.14, 3.14, 3.14, 3.14]",
            ["robot.joint_upper_deg: found [3.14, 3.14, 3.14, 3.14, 3.14, 3.14]: looks like rad"],
        ),
        (HEAD + "rpy_deg = [3.14159, 0, 0]", ["robot.rpy_deg: found [3.14159, 0, 0]: looks like"]),
        (HEAD + "home_deg = [0, -90, 90]", ["found 3 values, expected 6: one a joint of ur5"]),
        (
            HEAD + SOLID.replace("[1.0, 1.0, 0.1]", "[1000, 1000, 100]"),
            ['solid[1] "s".size: found [1000, 1000, 100], expected metres, at most 20; looks like'],
        ),
        (HEAD + "[mapping]\nvoxel = 20", ["mapping.voxel: found 20, expected at most 0.1"]),
        (
            HEAD + "[simulation]\ncalibration_error_mm = 0.003",
            ["found 0.003: looks like metres, expected millimetres"],
        ),
        (
            HEAD
            + "joint_lower_deg = [-90,-90,-90,-90,-90,90]\njoint_upper_deg = [90,90,90,90,90,-90]",
            ["joint wrist_3_joint: found 90, expected below joint_upper_deg -90"],
        ),
        # One of several.
        (HEAD + CAMERA + "rpy_deg = [1, 2, 3]", ["found look_at and rpy_deg of look_at, rpy_deg"]),
        (HEAD + CAMERA.replace("look_at", "#"), ["found none of look_at, rpy_deg and quaternion"]),
        (
            HEAD + CAMERA.replace("look_at = [0.0, 0.0, 0.5]", "quaternion_xyzw = [0, 0, 0, 2]"),
            ["quaternion_xyzw has length 2, expected 1"],
        ),
        (HEAD + SOLID + "radius = 1.0", ["a box found size and radius, expected size"]),
        (HEAD + SOLID + "kind = 'sphere'", ["a sphere found size, expected radius"]),
        (
            HEAD + "[[simulation.person]]\nname='p'\nposition=[1,0,0]\nmotion='clip'",
            ['motion is "clip" and clip is missing'],
        ),
        (
            HEAD
            + "[[simulation.person]]\nname='p'\nposition=[1,0,0]\nmotion='clip'\nclip='no.npz'",
            ['simulation.person[1] "p".clip: found "no.npz", expected a file at '],
        ),
        (
            HEAD + "[[simulation.object]]\nname='o'\nradius=0.1\nkind='sphere'\nposition=[1,0,0]\n"
            "path='circle'",
            ['path is "circle" and center is missing'],
        ),
        (HEAD + "[mapping]\nlower = [0, 0, 0]", ["found one of lower and upper, expected both"]),
        (
            HEAD + "[mapping]\nlower = [0.0, 0.0, 1.0]\nupper = [1.0, 1.0, 0.0]",
            ["is not above lower"],
        ),
        (
            HEAD + "[mapping]\nlower = [1, 1, 1]\nupper = [2, 2, 2]",
            ["the robot's base [0, 0, 0] lies outside the mapped box"],
        ),
        (
            HEAD + "[mapping]\nlower = [-9, -9, -9]\nupper = [9, 9, 9]\nvoxel = 0.01",
            ["million voxels of the box, expected at most 20 million"],
        ),
        # Duplicates, goals, collisions.
        (HEAD + CAMERA + CAMERA, ['camera[2] "c".name: "c" is taken by camera[1]']),
        (
            HEAD + SOLID + "[[simulation.undeclared]]\nname='s'\nsize=[1.0,1,1]\nposition=[0,0,2]",
            ['simulation.undeclared[1] "s".name: "s" is taken by solid[1]'],
        ),
        (
            HEAD + SOLID + "[[simulation.arm]]\nname='s'\nmodel='panda'\nposition=[0,0,0.0]",
            ['simulation.arm[1] "s".name: "s" is taken by solid[1]'],
        ),
        (
            HEAD + "[[simulation.arm]]\nname='b'\nmodel='pandda'\nposition=[700,0,0.0]",
            ['simulation.arm[1] "b".model: ', '"panda"', 'simulation.arm[1] "b".position: '],
        ),
        (
            HEAD
            + "[[simulation.arm]]\nname='b'\nmodel='ur3'\nposition=[1,0,0]\njoints_deg=[0, 90]",
            ['simulation.arm[1] "b".joints_deg: found 2 values, expected 6'],
        ),
        (
            HEAD + "[patrol.goals_deg]\nA = [0, 0, 0, 0, 0, 0]",
            ["patrol.goals_deg: found 1 goal, expected none or at least 2"],
        ),
        (
            HEAD + "[patrol.goals_deg]\nA = [0, -90, 90, -90, -90, 0]\nB = [0, 0, 200, 0, 0, 0]",
            ["patrol.goals_deg.B: joint elbow_joint: found 200, expected -180 to 180 [deg]"],
        ),
        (
            HEAD
            + "home_deg = [0, -90, 90, -90, -90, 0]\n"
            + SOLID.replace("[0.0, 0.0, -0.5]", "[0.0, 0.0, 0.6]"),
            ["robot.home_deg: link ", 'inside solid "s", expected a free configuration'],
        ),
        (
            HEAD + "[patrol.goals_deg]\nA = [0, -90, 90, -90, -90, 0]\nB = [0, 60, 0, 0, 0, 0]",
            ["patrol.goals_deg.B: link ", "cm below the floor (z = 0), expected a free"],
        ),
    ],
)
def test_problems_name_key_found_and_expected(text, expected):
    told = "\n".join(problems(text))
    for words in expected:
        assert words in told


def test_a_goal_below_the_floor_is_free_where_there_is_none_or_the_arm_stands_higher():
    goals = "[patrol.goals_deg]\nA = [0, -90, 90, -90, -90, 0]\nB = [0, 60, 0, 0, 0, 0]\n"
    assert problems(HEAD + goals)
    parse_workcell(HEAD + goals + "[simulation]\nfloor = false\n")
    parse_workcell(HEAD + "position = [0.0, 0.0, 1.2]\n" + goals)


def test_all_problems_come_at_once_one_line_each():
    text = (
        HEAD
        + "speed = 50\nsped = 1\nhome_deg = [0, 1.57, 0, 0, 0, 0]\n"
        + CAMERA.replace("[1.5, 0.0, 1.0]", "[40, 0, 1]")
        + CAMERA
    )
    told = problems(text)
    assert len(told) == 4 or len(told) == 5
    joined = "\n".join(told)
    for words in ("robot.speed", "robot.sped", "camera[1]", "camera[2]"):
        assert words in joined


def test_the_error_carries_its_problems():
    with pytest.raises(WorkcellFileError) as caught:
        parse_workcell(HEAD + "speed = 50\nacceleration = 0", "f.toml")
    assert [p.where for p in caught.value.problems] == ["robot.speed", "robot.acceleration"]
    assert caught.value.file == "f.toml"


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", "empty, expected a workcell"),
        (b" \n\t\n", "empty, expected a workcell"),
        (b"\xef\xbb\xbf", "empty, expected a workcell"),
        (b"[cell\n", "not valid TOML: "),
        (b"a = 1\na = 2\n", "not valid TOML: "),
        (b"a = " + b"1" * 5000, "not valid TOML: "),
        (b"[camera]\n[camera]\n", "; write [[camera]] for each of several"),
        (b"\xff\xfe[\x00c\x00", "not UTF-8 text (byte 0)"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "not UTF-8 text (byte 0)"),
        (b"x = " + b"[" * 100_000, "nested too deeply"),
        (b"# " + b"x" * 1_000_001, "1.0 MB large, expected a workcell file of at most 1 MB"),
    ],
)
def test_broken_files(tmp_path: Path, data: bytes, expected: str):
    file = tmp_path / "cell.toml"
    file.write_bytes(data)
    with pytest.raises(WorkcellError) as caught:
        load_workcell(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_and_folder(tmp_path: Path):
    with pytest.raises(WorkcellError, match="no such file; 'armsight new "):
        load_workcell(tmp_path / "no.toml")
    with pytest.raises(WorkcellError, match="is a folder, expected a workcell file"):
        load_workcell(tmp_path)
    recording = tmp_path / "monday.mcap"
    recording.write_bytes(bytes(2_000_000))
    with pytest.raises(WorkcellError, match=r"a recording; 'armsight replay .*monday.mcap' plays"):
        load_workcell(recording)
    file = tmp_path / "a"
    file.write_text("x")
    with pytest.raises(WorkcellError, match="cannot be read: Not a directory"):
        load_workcell(file / "b.toml")


def test_messages_of_a_typical_broken_file_are_kept():
    """A snapshot: change it knowingly."""
    text = """
[cell]
name = "pinned"
[robot]
model = "ur55"
speed = "half"
[[camera]]
name = "north"
model = "kinect_v2"
positon = [1.5, 0, 1]
look_at = [0, 0, 0]
"""
    assert problems(text) == [
        'robot.speed: found "half", expected a number (Share of the joints\' speed limits that may '
        "be used)",
        'camera[1] "north".position: missing (Origin of the depth (or left) lens, in world '
        "or in the flange's frame [m])",
        'camera[1] "north".positon: unknown key; did you mean "position"? known: name, model, '
        "driver, mounted_on, position, look_at, rpy_deg, quaternion_xyzw, rate_hz, latency_ms, "
        "connection, phase_ms, guard",
    ]


def test_a_simulated_arm_does_not_begin_outside_of_its_cells_limits():
    """Its home is the arm's own where the file states none; a real arm begins where it stands."""
    with pytest.raises(WorkcellError, match=r"robot.home_deg: the arm's own home, .* outside"):
        world_spec(parse_workcell(HEAD + LIMITS))
    at_home = "home_deg = [45, -90, 90, 0, 0, 0]\n"
    assert world_spec(parse_workcell(HEAD + LIMITS + at_home)).arm.home[0] == np.deg2rad(45)


def test_only_what_the_cell_is_told_of_may_be_declared_coarsely():
    """What is held is the arm, and what moves or nobody was told of explains no return."""
    (solid,) = parse_workcell(HEAD + SOLID + "coarse = 0.03\n").solid
    assert solid.solid.coarse == 0.03
    assert parse_workcell(HEAD + SOLID).solid[0].solid.coarse == 0.0
    for wrong, says in (("-0.01", "expected"), ("0.6", "expected"), ("'a bit'", "expected")):
        (line,) = problems(HEAD + SOLID + f"coarse = {wrong}\n")
        assert line.startswith('solid[1] "s".coarse: ')
        assert says in line
    held = "[[held]]\nname='h'\nsize=[0.1, 0.1, 0.1]\nposition=[0, 0, 0.1]\ncoarse=0.01"
    loose = SOLID.replace("[[solid]]", "[[simulation.undeclared]]") + "coarse = 0.01\n"
    for text in (HEAD + held, HEAD + loose):
        assert "coarse: unknown key" in problems(text)[0]
