"""Labels against a second kinematics (from the URDF's XML) and a second projection (numpy)."""

from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armsight.robots
from armsight.recognition.data.keypoints import find_keypoints, robot_keypoints
from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.data.sample import KNOWN_ROBOTS, Sample
from armsight.robots import load_robot
from armsight.robots.meshes import read_mesh

DATA = Path(armsight.robots.__file__).parent / "data"


def second_kinematics(name: str, q: np.ndarray) -> dict[str, np.ndarray]:
    """Pose of every URDF link in the root, by walking the XML."""
    tree = ElementTree.parse(DATA / name / "robot.urdf").getroot()
    angle = dict(zip(load_robot(name).joint_names, q))
    children = {}
    for joint in tree.findall("joint"):
        origin = joint.find("origin")
        xyz = (
            [float(v) for v in (origin.get("xyz") or "0 0 0").split()]
            if origin is not None
            else [0, 0, 0]
        )
        rpy = (
            [float(v) for v in (origin.get("rpy") or "0 0 0").split()]
            if origin is not None
            else [0, 0, 0]
        )
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), xyz
        if joint.get("type") in ("revolute", "continuous"):
            axis = np.array([float(v) for v in joint.find("axis").get("xyz").split()])
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec(
                axis * angle.get(joint.get("name"), 0.0)
            ).as_matrix()
            T = T @ turn
        children.setdefault(joint.find("parent").get("link"), []).append(
            (joint.find("child").get("link"), T)
        )
    below = {child for group in children.values() for child, _ in group}
    root = next(link.get("name") for link in tree.findall("link") if link.get("name") not in below)
    poses, stack = {}, [(root, np.eye(4))]
    while stack:
        link, T = stack.pop()
        poses[link] = T
        stack += [(child, T @ step) for child, step in children.get(link, [])]
    return poses


def camera_from_links(sample: Sample) -> list[np.ndarray]:
    """Pose of each link of the chain in the camera."""
    robot = load_robot(sample.robot)
    poses = second_kinematics(sample.robot, sample.q)
    to_base = np.linalg.inv(poses[robot.link_names[0]])
    return [sample.T_camera_base @ to_base @ poses[name] for name in robot.link_names]


def project(sample: Sample, points: np.ndarray) -> np.ndarray:
    """Pixels of points in the camera's frame; a pinhole and one radial term."""
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    bend = 1.0 + sample.distortion[0] * (x * x + y * y)
    K = sample.K
    return np.stack([K[0, 0] * x * bend + K[0, 2], K[1, 1] * y * bend + K[1, 2]], axis=1)


def silhouette(sample: Sample) -> np.ndarray:
    """(h, w) where the bare arm would be seen, by filling projected triangles."""
    out = np.zeros(sample.mask.shape, np.uint8)
    links = camera_from_links(sample)
    for mesh in load_robot(sample.robot).meshes:
        vertices, faces = read_mesh(mesh)
        T = links[mesh.link]
        pixels = project(sample, vertices @ T[:3, :3].T + T[:3, 3])
        triangles = np.round(pixels[faces] * 16).astype(np.int32)
        for triangle in triangles:
            cv2.fillConvexPoly(out, triangle, 1, cv2.LINE_8, 4)
    return out


def test_joints_follow_the_urdf(paper_like: LabelledSet) -> None:
    for sample in paper_like:
        links = camera_from_links(sample)
        joints = np.array([T[:3, 3] for T in links[1:]])
        np.testing.assert_allclose(sample.joints_camera, joints, atol=1e-6)
        assert len(sample.q) == len(joints)


def test_jittered_joints_stay_near_the_urdf(wild: LabelledSet) -> None:
    for sample in wild:
        if sample.robot in KNOWN_ROBOTS:
            joints = np.array([T[:3, 3] for T in camera_from_links(sample)[1:]])
            error = np.linalg.norm(sample.joints_camera - joints, axis=1)
            # A millimetre along each axis, and all joints before add theirs.
            assert np.all(error <= 0.001 * np.sqrt(3) * np.arange(1, len(joints) + 1) + 1e-9)
            assert error.max() > 0


def test_keypoints_project_where_the_labels_say(paper_like: LabelledSet, wild: LabelledSet) -> None:
    for sample in [*paper_like, *wild]:
        if len(sample.keypoints_camera):
            pixels = project(sample, sample.keypoints_camera)
            np.testing.assert_allclose(sample.keypoints_px, pixels, atol=1e-6)


def test_keypoints_move_with_their_links(paper_like: LabelledSet) -> None:
    for sample in paper_like:
        points, links = robot_keypoints(sample.robot), camera_from_links(sample)
        placed = np.array([(links[k] @ [*p, 1.0])[:3] for k, p in zip(points.link, points.point)])
        np.testing.assert_allclose(sample.keypoints_camera, placed, atol=1e-6)


def test_visible_keypoints_lie_on_their_link(paper_like: LabelledSet, wild: LabelledSet) -> None:
    seen = 0
    for sample in [*paper_like, *wild]:
        points = robot_keypoints(sample.robot)
        for k in np.flatnonzero(sample.keypoints_visible):
            u, v = np.round(sample.keypoints_px[k]).astype(int)
            window = sample.link_ids[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
            assert points.link[k] + 1 in window or points.other[k] + 1 in window
            seen += 1
    assert seen > 300


def test_mask_is_the_silhouette_of_the_meshes(paper_like: LabelledSet) -> None:
    for sample in paper_like:
        alone = silhouette(sample)
        grown = cv2.dilate(alone, np.ones((3, 3), np.uint8)) > 0
        assert sample.mask[~grown].sum() == 0  # nothing of the mask off the arm
        # A tool or a cable may hide a part; nothing else stands before it in this set.
        covered = (sample.mask & (alone > 0)).sum() / alone.sum()
        assert covered > 0.6
        if covered > 0.97:
            union = (sample.mask | (alone > 0)).sum()
            assert (sample.mask & (alone > 0)).sum() / union > 0.85


def test_each_link_id_lies_on_its_link(paper_like: LabelledSet) -> None:
    for sample in paper_like:
        links = camera_from_links(sample)
        for i in np.unique(sample.link_ids[sample.mask]):
            out = np.zeros(sample.mask.shape, np.uint8)
            for mesh in load_robot(sample.robot).meshes:
                if mesh.link == i - 1:
                    vertices, faces = read_mesh(mesh)
                    T = links[mesh.link]
                    pixels = project(sample, vertices @ T[:3, :3].T + T[:3, 3])
                    for triangle in np.round(pixels[faces] * 16).astype(np.int32):
                        cv2.fillConvexPoly(out, triangle, 1, cv2.LINE_8, 4)
            grown = cv2.dilate(out, np.ones((3, 3), np.uint8)) > 0
            assert not np.any((sample.link_ids == i) & ~grown)


def test_pictures_without_and_with_unknown_arms(wild: LabelledSet) -> None:
    none = [s for s in wild if s.robot == "none"]
    unknown = [s for s in wild if s.robot == "unknown"]
    assert len(none) == len(unknown) == 2
    for sample in none:
        assert not sample.mask.any()
        assert np.isnan(sample.T_camera_base).all()
        assert sample.q.shape == (0,)
        assert sample.joints_camera.shape == (0, 3)
    for sample in unknown:
        assert sample.mask.any()
        assert 4 <= len(sample.q) <= 7
        assert sample.link_ids.max() <= len(sample.q) + 1
        assert len(sample.keypoints_camera) == 0


def test_joints_stay_in_their_range(paper_like: LabelledSet, wild: LabelledSet) -> None:
    for sample in [*paper_like, *wild]:
        if sample.robot in KNOWN_ROBOTS:
            limits = load_robot(sample.robot).limits
            assert np.all(sample.q >= limits.lower - 1e-9)
            assert np.all(sample.q <= limits.upper + 1e-9)


def test_paper_like_is_a_kinect(paper_like: LabelledSet) -> None:
    for sample in paper_like:
        h, w = sample.mask.shape
        assert 2 * np.rad2deg(np.arctan(0.5 * w / sample.K[0, 0])) == pytest.approx(70)
        assert 2 * np.rad2deg(np.arctan(0.5 * h / sample.K[1, 1])) == pytest.approx(60)
        assert 1.2 - 1e-6 <= np.linalg.norm(sample.base_camera) <= 2.5 + 1e-6


@pytest.mark.parametrize("name", ["ur3", "panda"])
def test_stored_keypoints_are_those_of_the_meshes(name: str) -> None:
    stored, found = robot_keypoints(name), find_keypoints(load_robot(name))
    assert stored.names == found.names
    np.testing.assert_array_equal(stored.link, found.link)
    np.testing.assert_allclose(stored.point, found.point, atol=2e-4)


@pytest.mark.parametrize("name", KNOWN_ROBOTS)
def test_keypoints_are_28_and_distinct(name: str) -> None:
    points = robot_keypoints(name)
    assert len(points.names) == len(set(points.names)) == 28
    n = load_robot(name).n
    assert points.names[1 : n + 1] == load_robot(name).joint_names
    np.testing.assert_array_equal(points.point[: n + 1], 0.0)
