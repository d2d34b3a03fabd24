"""Reading URDF files: folding, branches, and every kind of broken file."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from armsight.errors import RobotError
from armsight.geometry.pose import from_rpy, inverse
from armsight.robots import load_urdf
from armsight.robots.chain import fold_chain
from armsight.robots.kinematics import flange_pose, link_poses
from armsight.robots.meshes import read_mesh
from armsight.robots.urdf import read_urdf

from .oracle import body_pose, mujoco_model

LIMIT = '<limit lower="-1" upper="2" velocity="1.5" effort="10"/>'
INERTIAL = (
    '<inertial><origin xyz="{0} 0 0.1" rpy="0 0.2 0"/><mass value="{1}"/>'
    '<inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0" izz="0.04"/></inertial>'
)
SPHERE = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'

TWO_JOINTS = f"""<robot name="two">
  <link name="world"/>
  <joint name="mount" type="fixed"><parent link="world"/><child link="base"/>
    <origin xyz="0 0 0.5" rpy="0 0 1"/></joint>
  <link name="base">{SPHERE}{INERTIAL.format(0, 2)}</link>
  <joint name="a" type="revolute"><parent link="base"/><child link="one"/>
    <origin xyz="0 0.1 0.2" rpy="0.3 0 0"/><axis xyz="0 0 2"/>{LIMIT}</joint>
  <link name="one">{SPHERE}{INERTIAL.format(0.1, 1)}</link>
  <joint name="bracket" type="fixed"><parent link="one"/><child link="plate"/>
    <origin xyz="0.2 0 0" rpy="0 0 0.5"/></joint>
  <link name="plate">{SPHERE}{INERTIAL.format(0, 3)}</link>
  <joint name="b" type="continuous"><parent link="plate"/><child link="hand"/>
    <origin xyz="0.1 0 0.1" rpy="0 1.2 0"/><axis xyz="0 1 1"/>
    <limit velocity="2" effort="1"/></joint>
  <link name="hand">{SPHERE}{INERTIAL.format(0, 0.5)}</link>
  <joint name="tip" type="fixed"><parent link="hand"/><child link="tool0"/>
    <origin xyz="0 0 0.3" rpy="0.1 0.2 0.3"/></joint>
  <link name="tool0"/>
</robot>"""


def write(tmp_path, text):
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    return path


def test_fixed_joints_are_folded(tmp_path):
    path = write(tmp_path, TWO_JOINTS)
    robot = load_urdf(path, base="base")
    assert robot.name == "two"
    assert robot.joint_names == ("a", "b")
    assert robot.link_names == ("base", "one", "hand")
    np.testing.assert_allclose(robot.limits.lower, [-1, -2 * np.pi])
    np.testing.assert_allclose(robot.limits.upper, [2, 2 * np.pi])
    np.testing.assert_allclose(robot.home, 0)
    assert list(np.bincount(robot.spheres.link)) == [1, 2, 1]  # the plate rides on link one

    model = mujoco_model(path)
    data = mujoco.MjData(model)
    for q in np.random.default_rng(0).uniform(-1, 2, (20, 2)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        T_base = inverse(body_pose(model, data, "base"))
        poses = link_poses(robot, q)
        for link, pose in zip(robot.link_names, poses):
            np.testing.assert_allclose(pose, T_base @ body_pose(model, data, link), atol=1e-9)
        np.testing.assert_allclose(
            flange_pose(robot, q), T_base @ body_pose(model, data, "tool0"), atol=1e-9
        )


def test_folded_inertia_moves_like_the_parts(tmp_path):
    """Kinetic energy of the folded link against MuJoCo's, which keeps the parts."""
    path = write(tmp_path, TWO_JOINTS)
    robot = load_urdf(path, base="base")
    np.testing.assert_allclose(robot.link_mass, [2, 4, 0.5])
    model = mujoco_model(path)
    data = mujoco.MjData(model)
    q, qd = np.array([0.4, -0.3]), np.array([1.3, -0.7])
    data.qpos[:], data.qvel[:] = q, qd
    mujoco.mj_forward(model, data)
    mass = np.zeros((2, 2))
    mujoco.mj_fullM(model, data, mass)
    expected = 0.5 * qd @ mass @ qd

    poses = link_poses(robot, q)
    energy = 0.0
    step = 1e-6
    ahead, behind = link_poses(robot, q + step * qd), link_poses(robot, q - step * qd)
    for i in (1, 2):
        com = np.append(robot.link_com[i], 1.0)
        v = ((ahead[i] - behind[i]) @ com)[:3] / (2 * step)
        W = (ahead[i] - behind[i])[:3, :3] / (2 * step) @ poses[i][:3, :3].T
        w = np.array([W[2, 1], W[0, 2], W[1, 0]])
        tensor = poses[i][:3, :3] @ robot.link_inertia[i] @ poses[i][:3, :3].T
        energy += 0.5 * robot.link_mass[i] * v @ v + 0.5 * w @ tensor @ w
    assert energy == pytest.approx(expected, rel=1e-6)


def test_base_defaults_to_the_root_and_flange_to_the_name(tmp_path):
    path = write(tmp_path, TWO_JOINTS)
    whole = fold_chain(read_urdf(path))
    assert (whole.links[0].name, whole.flange) == ("world", "tool0")
    chosen = fold_chain(read_urdf(path), flange="hand")
    np.testing.assert_allclose(chosen.T_last_flange, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(
        whole.links[1].T_parent_joint,
        from_rpy([0, 0, 1], [0, 0, 0.5]) @ from_rpy([0.3, 0, 0], [0, 0.1, 0.2]),
        atol=1e-12,
    )


FINGERS = TWO_JOINTS.replace(
    "</robot>",
    f"""<joint name="finger" type="prismatic"><parent link="hand"/><child link="nail"/>
      <origin xyz="0 0 0.1"/><axis xyz="1 0 0"/>{LIMIT}</joint>
      <link name="nail">{SPHERE}</link></robot>""",
)


def test_fingers_are_held(tmp_path):
    path = write(tmp_path, FINGERS)
    with pytest.raises(RobotError, match=r'joint "finger" is prismatic.*flange = '):
        load_urdf(path)
    shut = load_urdf(path, flange="tool0")
    open_ = load_urdf(path, flange="tool0", held={"finger": 0.04})
    np.testing.assert_allclose(shut.spheres.center[-1], [0, 0, 0.1])
    np.testing.assert_allclose(open_.spheres.center[-1], [0.04, 0, 0.1])
    with pytest.raises(RobotError, match='held joint "thumb" is not a moving joint'):
        load_urdf(path, flange="tool0", held={"thumb": 0.1})


def test_what_mimics_a_held_joint_goes_with_it(tmp_path):
    other = f"""<joint name="thumb" type="prismatic"><parent link="hand"/><child link="pad"/>
      <axis xyz="1 0 0"/><mimic joint="finger" multiplier="-2" offset="0.01"/></joint>
      <link name="pad">{SPHERE}</link></robot>"""
    path = write(tmp_path, FINGERS.replace("</robot>", other))
    pad = load_urdf(path, flange="tool0", held={"finger": 0.04}).spheres.center[-1]
    np.testing.assert_allclose(pad, [-0.07, 0, 0])
    pad = load_urdf(path, flange="tool0", held={"thumb": 0.5}).spheres.center[-1]
    np.testing.assert_allclose(pad, [0.5, 0, 0])


def test_what_carries_the_arm_is_held(tmp_path):
    # A mobile base on the plane, with a wheel, and a lift; values and macros of xacro do no harm.
    carried = f"""<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro">
      <xacro:property name="r" value="1"/><xacro:macro name="m"><link name="no"/></xacro:macro>
      <link name="odom"/><link name="car"/><link name="wheel">{SPHERE}</link>
      <joint name="drive" type="planar"><parent link="odom"/><child link="car"/></joint>
      <joint name="roll" type="continuous"><parent link="car"/><child link="wheel"/></joint>
      <joint name="lift" type="prismatic"><parent link="car"/><child link="world"/>
        <axis xyz="0 0 1"/>{LIMIT}</joint>"""
    path = write(tmp_path, carried + TWO_JOINTS.split(">", 1)[1])
    with pytest.raises(RobotError, match=r'joint "drive" is planar.*base = '):
        load_urdf(path, flange="hand")
    alone = load_urdf(write(tmp_path, TWO_JOINTS), flange="hand")
    path = write(tmp_path, carried + TWO_JOINTS.split(">", 1)[1])
    for lift in (0.0, 0.3):
        robot = load_urdf(path, base="world", flange="hand", held={"lift": lift})
        assert robot.joint_names == ("a", "b")
        np.testing.assert_allclose(robot.T_link_joint, alone.T_link_joint, atol=1e-12)
        wheel = robot.spheres.center[robot.spheres.link == 0]
        assert np.abs(wheel - [0, 0, -lift]).max(axis=1).min() < 1e-12


def test_wrists_of_more_than_a_turn_are_taken(tmp_path):
    path = write(tmp_path, broken('lower="-1" upper="2"', 'lower="-7.9412" upper="12.57"'))
    limits = load_urdf(path).limits
    assert (limits.lower[0], limits.upper[0]) == (-7.9412, 12.57)


def test_two_arms_must_be_told_apart(tmp_path):
    second = f"""<joint name="c" type="revolute"><parent link="base"/><child link="other"/>
      <axis xyz="0 0 1"/>{LIMIT}</joint><link name="other">{SPHERE}</link></robot>"""
    path = write(tmp_path, TWO_JOINTS.replace("</robot>", second))
    with pytest.raises(RobotError, match=r'joint "c" is not on the way to "hand"; .*flange = '):
        load_urdf(path)
    assert load_urdf(path, flange="tool0").joint_names == ("a", "b")
    assert load_urdf(path, flange="other").joint_names == ("c",)


def test_quarter_turns_in_few_digits_are_made_exact(tmp_path):
    path = write(tmp_path, TWO_JOINTS.replace('rpy="0.3 0 0"', 'rpy="1.5707963268 0 0"'))
    T = fold_chain(read_urdf(path), base="base").links[1].T_parent_joint
    np.testing.assert_allclose(T[:3, :3], [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)


def broken(old, new):
    assert old in TWO_JOINTS
    return TWO_JOINTS.replace(old, new)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"not well-formed XML \(no element found: line 1"),
        ("<robot><link name='a'></robot>", r"not well-formed XML \(mismatched tag: line 1"),
        ("\x00\x01binary", "not well-formed XML"),
        ("<sdf/>", "outermost element is <sdf>, expected <robot>"),
        ("<robot name='x'/>", "has no <link>"),
        ("<robot name='x'><link name='a'/></robot>", "has no moving joint"),
        (
            '<!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]><robot>&e;</robot>',
            "document type declaration is not allowed",
        ),
        (broken('<link name="hand">', '<link name="one">'), 'link "one": appears twice'),
        (broken('child link="hand"', 'child link="hnad"'), 'child link "hnad" is unknown'),
        (broken('<parent link="base"/>', ""), 'joint "a": has no <parent'),
        (
            broken(
                '<parent link="plate"/><child link="hand"/>',
                '<parent link="base"/><child link="one"/>',
            ),
            'link "one": has two parent joints, "a" and "b"',
        ),
        (
            broken(
                '<parent link="world"/><child link="base"/>',
                '<parent link="tool0"/><child link="base"/>',
            ),
            "is its own ancestor: the joints form a loop",
        ),
        (
            broken('<link name="world"/>', '<link name="world"/><link name="island"/>'),
            "has 2 roots",
        ),
        (broken('type="revolute"', 'type="screw"'), 'type "screw" is not supported'),
        (broken('type="revolute"', 'type="floating"'), 'joint "a" is floating, .*base = '),
        (
            broken(LIMIT, LIMIT + '<mimic joint="b"/>'),
            'joint "a" mimics "b"; each joint of an arm here moves by itself',
        ),
        (broken(LIMIT, LIMIT + "<mimic/>"), 'joint "a" <mimic>: has no joint='),
        (broken('xyz="0 0.1 0.2"', 'xyz="0 100 200"'), '<origin>: 224 m from "base"; lengths are'),
        (broken('<link name="world"/>', "<xacro:property name='r'/>"), "expanded first: xacro IN"),
        (
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm prefix=""/></robot>',
            "<xacro:arm> was not expanded; ",
        ),
        (broken('type="revolute"', 'type="prismatic"'), 'joint "a" is prismatic'),
        (broken('<axis xyz="0 0 2"/>', '<axis xyz="0 0 0"/>'), 'joint "a" <axis>: has no length'),
        (broken('<axis xyz="0 0 2"/>', '<axis xyz="0 0"/>'), 'xyz="0 0" is not 3 finite'),
        (broken('rpy="0.3 0 0"', 'rpy="0.3 x 0"'), r'joint "a" <origin>: rpy="0.3 x 0" is not 3'),
        (broken('rpy="0.3 0 0"', 'rpy="nan 0 0"'), "is not 3 finite number"),
        (broken(LIMIT, ""), 'joint "a": has no <limit>'),
        (broken('lower="-1"', 'lower="3"'), "lower 3 is not below upper 2"),
        (broken('upper="2"', 'upper="170"'), "limits are in radians"),
        (broken('velocity="1.5"', 'velocity="0"'), 'needs velocity="..." above 0'),
        (
            broken('velocity="1.5"', 'velocity="180"'),
            r'joint "a" <limit>: velocity 180 rad/s is faster than any arm.*would be 3.14 rad/s',
        ),
        (broken('velocity="2" ', ""), 'joint "b": <limit> needs velocity'),
        (broken('radius="0.05"', 'radius="-1"'), 'link "base" <collision>: radius'),
        (broken('<sphere radius="0.05"/>', ""), "has no <geometry> with a shape"),
        (broken('<sphere radius="0.05"/>', "<cone/>"), "shape <cone> is not known"),
        (broken('<mass value="1"/>', '<mass value="-1"/>'), "mass -1 kg is negative"),
        (broken('<mass value="1"/>', ""), "has no <mass"),
        (broken('name="hand"', ""), "<link>: has no name"),
        (
            broken('<sphere radius="0.05"/>', '<mesh filename="http://x/y.stl"/>'),
            'mesh "http://x/y.stl" is not a file',
        ),
    ],
)
def test_broken_files_are_told_apart(tmp_path, text, message):
    path = write(tmp_path, text)
    with pytest.raises(RobotError, match=message) as caught:
        load_urdf(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_files_are_named(tmp_path):
    with pytest.raises(RobotError, match=r"none.urdf: cannot be read \(No such file"):
        load_urdf(tmp_path / "none.urdf")
    mesh = '<visual><geometry><mesh filename="package://arm/meshes/hand.stl"/></geometry></visual>'
    path = write(tmp_path, TWO_JOINTS.replace('<link name="hand">', f'<link name="hand">{mesh}'))
    with pytest.raises(
        RobotError, match=r'link "hand" <visual>: mesh .*meshes/hand.stl is missing'
    ):
        load_urdf(path)
    assert load_urdf(path, meshes=False).n == 2

    folder = tmp_path / "elsewhere" / "meshes"
    folder.mkdir(parents=True)
    (folder / "hand.stl").write_text("solid empty\nendsolid empty\n")
    robot = load_urdf(path, packages={"arm": tmp_path / "elsewhere"})
    with pytest.raises(RobotError, match=r"hand.stl (holds no triangles|cannot be read)"):
        read_mesh(robot.meshes[0])


def test_unknown_links_are_listed(tmp_path):
    path = write(tmp_path, TWO_JOINTS)
    with pytest.raises(RobotError, match='flange link "gripper" is unknown; known: world, base'):
        load_urdf(path, flange="gripper")
    with pytest.raises(RobotError, match="has no moving joint behind its base"):
        load_urdf(path, base="hand")
    with pytest.raises(RobotError, match="acceleration: 3 values were given for 2 joints"):
        load_urdf(path, base="base", acceleration=np.ones(3))
    with pytest.raises(RobotError, match="jerk: every value must be above 0"):
        load_urdf(path, base="base", jerk=0.0)


def test_arm_without_spheres_is_fitted(tmp_path):
    """Boxes and cylinders, no meshes: everything is covered, neighbours are not paired."""
    box = '<visual><geometry><box size="0.06 0.05 0.08"/></geometry></visual>'
    rod = '<collision><geometry><cylinder radius="0.03" length="0.1"/></geometry></collision>'
    text = TWO_JOINTS.replace(SPHERE, box, 2).replace(SPHERE, rod)
    robot = load_urdf(write(tmp_path, text), base="base")
    assert set(robot.spheres.link) == set(robot.capsules.link) == {0, 1, 2}
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    mine = robot.spheres.link == 0
    gaps = np.linalg.norm(
        (corners * [0.03, 0.025, 0.04])[:, None] - robot.spheres.center[mine], axis=2
    )
    assert (gaps - robot.spheres.radius[mine]).min(axis=1).max() <= 0.0005


def test_motion_bench_makers_ur5_keeps_its_spheres(shared_data):
    path = shared_data / "motion" / "motionbenchmaker" / "ur5_spherized.urdf"
    robot = load_urdf(path, base="base_link", flange="tool0", meshes=False)
    arm = np.bincount(robot.spheres.link, minlength=7)
    assert robot.n == 6
    assert arm.sum() == path.read_text().count("<sphere")
    assert np.ptp(robot.spheres.radius) > 0.01
