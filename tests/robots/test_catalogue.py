"""The catalogue against the makers' published lengths and SYSTEM.md's table."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from armsight.errors import RobotError
from armsight.geometry.pose import from_rpy, make_pose
from armsight.robots import ROBOT_NAMES, load_robot, robot_sheet
from armsight.robots.catalogue import DATA
from armsight.robots.folder import load_arm
from armsight.robots.kinematics import flange_pose, link_poses, sphere_centers
from armsight.robots.meshes import read_mesh

# Universal Robots, "DH parameters for calculations of kinematics and dynamics": d1 a2 a3 d4 d5 d6.
UR_LENGTHS = {
    "ur3": (0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
    "ur5": (0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    "ur10": (0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
    "ur3e": (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    "ur5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur10e": (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "ur16e": (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
}


def dh(a, d, alpha, theta):
    """Classic Denavit-Hartenberg."""
    return from_rpy([0, 0, theta], [0, 0, d]) @ make_pose(None, [a, 0, 0]) @ from_rpy([alpha, 0, 0])


def modified_dh(a, d, alpha, theta):
    """Craig's convention: the turn about x comes first."""
    return from_rpy([alpha, 0, 0]) @ make_pose(None, [a, 0, 0]) @ from_rpy([0, 0, theta], [0, 0, d])


def chain(step, rows, q):
    T = np.eye(4)
    for row, angle in zip(rows, q):
        T = T @ step(*row, angle)
    return T


@pytest.mark.parametrize("name", UR_LENGTHS)
def test_universal_robots_follow_the_makers_dh_table(name):
    """The maker's base is turned by 180 deg about z against REP-103's base_link."""
    robot = load_robot(name)
    d1, a2, a3, d4, d5, d6 = UR_LENGTHS[name]
    quarter = np.pi / 2
    rows = [
        (0, d1, quarter),
        (a2, 0, 0),
        (a3, 0, 0),
        (0, d4, quarter),
        (0, d5, -quarter),
        (0, d6, 0),
    ]
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (20, 6)):
        expected = from_rpy([0, 0, np.pi]) @ chain(dh, rows, q)
        np.testing.assert_allclose(flange_pose(robot, q), expected, atol=1e-9)


@pytest.mark.parametrize("name", ["panda", "fr3"])
def test_franka_follows_the_makers_dh_table(name):
    """Franka Control Interface documentation, Denavit-Hartenberg parameters (Craig)."""
    robot = load_robot(name)
    h = np.pi / 2
    rows = [
        (0, 0.333, 0),
        (0, 0, -h),
        (0, 0.316, h),
        (0.0825, 0, h),
        (-0.0825, 0.384, -h),
        (0, 0, h),
        (0.088, 0, h),
    ]
    for q in np.random.default_rng(1).uniform(robot.limits.lower, robot.limits.upper, (20, 7)):
        expected = chain(modified_dh, rows, q) @ make_pose(None, [0, 0, 0.107])
        np.testing.assert_allclose(flange_pose(robot, q), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "shoulder", "elbow"), [("iiwa", 0.34, 0.4), ("iiwa14", 0.36, 0.42)]
)
def test_iiwas_have_the_makers_lengths(name, shoulder, elbow):
    """Data sheets: 340, 400, 400, 126 mm (7 R800) and 360, 420, 400, 126 mm (14 R820)."""
    robot = load_robot(name)
    h = np.pi / 2
    rows = [
        (0, shoulder, -h),
        (0, 0, h),
        (0, elbow, h),
        (0, 0, -h),
        (0, 0.4, -h),
        (0, 0, h),
        (0, 0.126, 0),
    ]
    for q in np.random.default_rng(2).uniform(robot.limits.lower, robot.limits.upper, (20, 7)):
        np.testing.assert_allclose(flange_pose(robot, q), chain(dh, rows, q), atol=2e-6)


@pytest.mark.parametrize(
    ("name", "n", "reach", "payload", "speed_deg"),
    [
        ("ur3", 6, 0.5, 3, (180, 360)),
        ("ur5", 6, 0.85, 5, (180, 180)),
        ("ur10", 6, 1.3, 10, (120, 180)),
        ("ur3e", 6, 0.5, 3, (180, 360)),
        ("ur5e", 6, 0.85, 5, (180, 180)),
        ("ur10e", 6, 1.3, 12.5, (120, 180)),
        ("ur16e", 6, 0.9, 16, (120, 180)),
        ("iiwa", 7, 0.8, 7, (98, 180)),
        ("iiwa14", 7, 0.82, 14, (75, 135)),
        ("panda", 7, 0.855, 3, (150, 180)),
        ("fr3", 7, 0.855, 3, (150, 301)),
    ],
)
def test_data_sheets(name, n, reach, payload, speed_deg):
    robot, sheet = load_robot(name), robot_sheet(name)
    assert (robot.n, robot.reach, sheet.payload) == (n, reach, payload)
    accurate = {"ur3e": 3e-5, "ur5e": 3e-5, "ur10e": 5e-5, "ur16e": 5e-5}
    assert sheet.repeatability == accurate.get(name, 1e-4)
    speed = np.rad2deg(robot.limits.velocity)
    if name == "panda":
        # The sheet's 150 and 180 deg/s are the drives'; who controls from outside gets less.
        np.testing.assert_allclose(robot.limits.velocity, [2.175] * 4 + [2.61] * 3)
        assert speed.max() <= speed_deg[1]
    else:
        assert (round(speed.min()), round(speed.max())) == speed_deg
    assert sheet.license in {"BSD-3-Clause", "Apache-2.0", "MIT"}
    assert (DATA / name / "LICENSE").stat().st_size > 300


def test_joint_ranges():
    for name in ("ur3", "ur5", "ur10"):
        limits = load_robot(name).limits
        # +-360 deg, but the elbow: the arm itself stops it at half a turn (ur_description).
        expected = np.full(6, 360.0)
        expected[2] = 180.0
        np.testing.assert_allclose(np.rad2deg(limits.upper), expected)
        np.testing.assert_array_equal(limits.lower, -limits.upper)
    iiwa = load_robot("iiwa").limits
    np.testing.assert_allclose(np.rad2deg(iiwa.upper), [170, 120, 170, 120, 170, 120, 175])
    np.testing.assert_allclose(np.rad2deg(iiwa.velocity), [98, 98, 100, 130, 140, 180, 180])
    panda = load_robot("panda").limits
    np.testing.assert_allclose(
        panda.lower, [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
    )
    np.testing.assert_allclose(
        panda.upper, [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
    )
    np.testing.assert_allclose(panda.acceleration, [15, 7.5, 10, 12.5, 15, 20, 20])


def test_ur5_brakes_no_harder_than_its_published_stops():
    """CB3 manual: base 244 ms, shoulder 530 ms, elbow 164 ms from 183 deg/s, stretched, loaded."""
    limits = load_robot("ur5").limits
    assert np.all(limits.acceleration[:3] <= np.deg2rad(183) / [0.244, 0.530, 0.164])


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_arm_is_whole(name):
    robot = load_robot(name)
    assert robot is load_robot(name)
    assert np.all(robot.limits.lower < robot.limits.upper)
    assert np.all((robot.home > robot.limits.lower) & (robot.home < robot.limits.upper))
    assert np.all(robot.limits.effort > 0)
    assert np.all(robot.link_mass > 0)
    for inertia in robot.link_inertia:
        values = np.linalg.eigvalsh(inertia)
        assert values[0] > 0
        assert values[2] <= values[0] + values[1] + 1e-12  # what a real body obeys
    assert {mesh.link for mesh in robot.meshes} == set(range(robot.n + 1))
    for mesh in robot.meshes:
        assert mesh.path.is_file()
        np.testing.assert_array_equal(mesh.T_link_mesh, np.eye(4))
        assert mesh.scale == (1.0, 1.0, 1.0)
        assert all(0.0 <= c <= 1.0 for c in mesh.color)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_base_looks_forward_and_home_points_down(name):
    """REP-103: leaning the second joint forward brings the arm towards +x, home over +x."""
    robot = load_robot(name)
    home = flange_pose(robot, robot.home)
    assert home[0, 3] > 0.2
    np.testing.assert_allclose(home[:3, 2], [0, 0, -1], atol=1e-6)
    centers = sphere_centers(robot, robot.home)
    assert centers[robot.spheres.link > 1, 2].min() > 0.05


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_flange_is_where_the_last_link_ends(name):
    """Its z points outward: nothing of the arm lies more than a bolt's head beyond it."""
    robot = load_robot(name)
    R, t = robot.T_last_flange[:3, :3], robot.T_last_flange[:3, 3]
    last = [read_mesh(m)[0] for m in robot.meshes if m.link == robot.n]
    ahead = (np.concatenate(last) - t) @ R[:, 2]
    assert -0.003 < ahead.max() < 0.003
    assert ahead.min() < -0.02
    assert link_poses(robot, robot.home).shape == (robot.n + 1, 4, 4)


def test_unknown_robot_names_the_nearest():
    with pytest.raises(RobotError, match=r'unknown robot "UR-5".*ur3, ur5.*did you mean "ur5"'):
        load_robot("UR-5")
    with pytest.raises(RobotError, match=r"known: ur3, .*panda, .*; one of your own is a path"):
        robot_sheet("kuka")


def test_broken_folders_are_named(tmp_path):
    for name in ("robot.urdf", "robot.toml", "shapes.json"):
        (tmp_path / name).write_bytes((DATA / "ur5" / name).read_bytes())
    (tmp_path / "meshes").symlink_to(DATA / "ur5" / "meshes")
    assert load_arm(tmp_path).n == 6

    shapes = json.loads((tmp_path / "shapes.json").read_text())
    shapes["spheres"]["elbow"] = [[0, 0, 0, 0.1]]
    (tmp_path / "shapes.json").write_text(json.dumps(shapes))
    with pytest.raises(RobotError, match=r"shapes.json: 'elbow' is missing or not a link"):
        load_arm(tmp_path)
    (tmp_path / "shapes.json").write_text("{")
    with pytest.raises(RobotError, match=r"shapes.json: is broken"):
        load_arm(tmp_path)

    (tmp_path / "robot.toml").write_text("title =")
    with pytest.raises(RobotError, match=r"robot.toml: is not TOML"):
        load_arm(tmp_path)
    (tmp_path / "robot.toml").write_text('flang = "tool0"')
    with pytest.raises(RobotError, match=r'robot.toml: unknown key "flang"; did you mean "flange"'):
        load_arm(tmp_path)
    (tmp_path / "robot.toml").write_text("home = [0, -90, 90, 0, 0, 0]")
    shutil.copy(DATA / "ur5" / "shapes.json", tmp_path)
    with pytest.raises(RobotError, match=r"home: joint shoulder_lift_joint at -90 rad is not in"):
        load_arm(tmp_path)
    (tmp_path / "robot.toml").write_text('[limits]\nacceleration = "fast"')
    with pytest.raises(RobotError, match=r"limits.acceleration must be finite"):
        load_arm(tmp_path)
