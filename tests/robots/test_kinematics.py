"""Kinematics against MuJoCo on the same file, against numpy twins, and by finite differences."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armsight.geometry.pose import from_rpy, inverse, make_pose, transform
from armsight.robots import ROBOT_NAMES, load_robot, load_tool, robot_sheet
from armsight.robots.kernels import carried_points, chain_poses_into, compose, joint_screws
from armsight.robots.kinematics import (
    flange_jacobian,
    flange_pose,
    link_poses,
    path_sphere_centers,
    point_jacobian,
    sphere_centers,
    tcp_jacobian,
    tcp_pose,
)

from .oracle import body_pose, mujoco_model, robot_path


def random_joints(robot, rng, count=1):
    return rng.uniform(robot.limits.lower, robot.limits.upper, (count, robot.n))


def plain_poses(robot, q):
    """The numpy twin of the kernel."""
    poses = [np.eye(4)]
    for i in range(robot.n):
        turn = make_pose(Rotation.from_rotvec(q[i] * robot.axis[i]).as_matrix())
        poses.append(poses[-1] @ robot.T_link_joint[i] @ turn)
    return np.stack(poses)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_links_and_flange_lie_where_mujoco_puts_them(name):
    robot = load_robot(name)
    model = mujoco_model(robot_path(name))
    data = mujoco.MjData(model)
    assert model.nq == robot.n
    order = [model.joint(j).qposadr[0] for j in robot.joint_names]
    for q in random_joints(robot, np.random.default_rng(0), 200):
        data.qpos[order] = q
        mujoco.mj_kinematics(model, data)
        ours = link_poses(robot, q)
        for link, pose in zip(robot.link_names, ours):
            np.testing.assert_allclose(pose, body_pose(model, data, link), atol=1e-9)
        flange = body_pose(model, data, robot_sheet(name).flange)
        np.testing.assert_allclose(flange_pose(robot, q), flange, atol=1e-9)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_kernel_agrees_with_its_numpy_twin(name):
    robot = load_robot(name)
    out = np.empty((robot.n + 1, 4, 4))
    for q in random_joints(robot, np.random.default_rng(1), 50):
        expected = plain_poses(robot, q)
        np.testing.assert_allclose(link_poses(robot, q), expected, atol=1e-12)
        chain_poses_into(q, robot.T_link_joint, robot.axis, out)
        np.testing.assert_array_equal(out, link_poses(robot, q))
        np.testing.assert_allclose(np.linalg.det(out[:, :3, :3]), 1.0, atol=1e-12)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_jacobians_are_the_derivatives(name):
    robot = load_robot(name).with_tool(load_tool("pen"))
    rng = np.random.default_rng(2)
    step = 1e-6
    for q in random_joints(robot, rng, 10):
        link = int(rng.integers(0, robot.n + 1))
        local = rng.uniform(-0.3, 0.3, 3)
        point = transform(link_poses(robot, q)[link], local[None])[0]
        flange, tip = flange_jacobian(robot, q), tcp_jacobian(robot, q)
        linear = point_jacobian(robot, q, link, point)
        for i in range(robot.n):
            d = np.zeros(robot.n)
            d[i] = step
            for pose, J in ((flange_pose, flange), (tcp_pose, tip)):
                before, after = pose(robot, q - d), pose(robot, q + d)
                moved = (after[:3, 3] - before[:3, 3]) / (2 * step)
                turn = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec()
                np.testing.assert_allclose(J[:3, i], moved, atol=1e-7)
                np.testing.assert_allclose(J[3:, i], turn / (2 * step), atol=1e-7)
            ends = [transform(link_poses(robot, q + s * d)[link], local[None])[0] for s in (-1, 1)]
            np.testing.assert_allclose(linear[:, i], (ends[1] - ends[0]) / (2 * step), atol=1e-7)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_turning_a_joint_alone_is_a_turn_about_its_screw(name):
    robot = load_robot(name)
    rng = np.random.default_rng(3)
    q = random_joints(robot, rng)[0]
    screws = joint_screws(link_poses(robot, q), robot.axis)
    for i in range(robot.n):
        turned = q.copy()
        turned[i] += 0.7
        R = Rotation.from_rotvec(0.7 * screws[i, :3]).as_matrix()
        T = make_pose(R, screws[i, 3:] - R @ screws[i, 3:])
        np.testing.assert_allclose(T @ flange_pose(robot, q), flange_pose(robot, turned), atol=1e-9)


def test_spheres_ride_on_their_links_along_a_path():
    robot = load_robot("ur5").with_tool(load_tool("gripper"))
    path = random_joints(robot, np.random.default_rng(4), 20)
    along = path_sphere_centers(robot, path)
    assert along.shape == (20, len(robot.spheres.radius), 3)
    for q, centers in zip(path, along):
        np.testing.assert_array_equal(centers, sphere_centers(robot, q))
        poses = plain_poses(robot, q)
        expected = [
            transform(poses[link], center[None])[0]
            for link, center in zip(robot.spheres.link, robot.spheres.center)
        ]
        np.testing.assert_allclose(centers, expected, atol=1e-12)


@pytest.mark.parametrize(
    "mount", [make_pose(None, [0, 0, 0.7]), from_rpy([np.pi, 0, 0.3], [0, 0, 2.0])]
)
def test_mounting_is_one_transform_on_the_left(mount):
    """A table's top or a ceiling: MuJoCo with the base placed there agrees."""
    robot = load_robot("ur10")
    model = mujoco_model(robot_path("ur10"))
    spec = mujoco.MjSpec()
    frame = spec.worldbody.add_frame(
        pos=mount[:3, 3], quat=Rotation.from_matrix(mount[:3, :3]).as_quat(scalar_first=True)
    )
    arm = mujoco.MjSpec()
    body = arm.worldbody
    for i in range(robot.n):
        T = robot.T_link_joint[i]
        quat = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
        body = body.add_body(name=f"link{i}", pos=T[:3, 3], quat=quat)
        body.add_joint(axis=robot.axis[i])
        body.add_geom(size=[0.01, 0, 0])
    frame.attach_body(arm.body("link0"), "", "")
    model = spec.compile()
    data = mujoco.MjData(model)
    q = random_joints(robot, np.random.default_rng(5))[0]
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    last = body_pose(model, data, f"link{robot.n - 1}")
    np.testing.assert_allclose(mount @ link_poses(robot, q)[-1], last, atol=1e-9)


def test_compose_is_the_product():
    rng = np.random.default_rng(6)
    A, B = (from_rpy(rng.uniform(-3, 3, 3), rng.uniform(-1, 1, 3)) for _ in range(2))
    np.testing.assert_allclose(compose(A, B), A @ B, atol=1e-14)
    np.testing.assert_allclose(compose(A, inverse(A)), np.eye(4), atol=1e-14)


def test_wrong_shapes_are_refused():
    robot = load_robot("ur5")
    with pytest.raises(ValueError, match="6 joints"):
        link_poses(robot, np.zeros(7))
    with pytest.raises(ValueError, match=r"links 0\.\.6"):
        point_jacobian(robot, robot.home, 7, np.zeros(3))
    with pytest.raises(ValueError, match="6 joints"):
        path_sphere_centers(robot, np.zeros((3, 5)))


def test_points_are_carried_by_their_links_as_by_matrices() -> None:
    rng = np.random.default_rng(8)
    T = np.tile(np.eye(4), (5, 1, 1))
    T[:, :3] = rng.normal(size=(5, 3, 4))
    link, points = rng.integers(0, 5, 40), rng.normal(size=(40, 3))
    expected = [(T[k] @ [*p, 1.0])[:3] for k, p in zip(link, points, strict=True)]
    assert np.allclose(carried_points(T, link, points), expected)
