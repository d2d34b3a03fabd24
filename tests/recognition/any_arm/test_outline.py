"""The fit to an outline, on masks drawn from arms whose pose and joints are known."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armsight.geometry.pose import inverse, look_at, make_pose
from armsight.recognition.any_arm.best_outline import Outlined, best_outlined
from armsight.recognition.any_arm.known import place_known
from armsight.recognition.any_arm.landmarks import find_landmarks
from armsight.recognition.any_arm.outline import (
    Edge,
    drawn_into,
    follow_outline,
    outline_overlap,
)
from armsight.recognition.any_arm.pixel_kernels import rim_pulls
from armsight.recognition.any_arm.solver import Fit, Observations, cost_of
from armsight.recognition.any_arm.trust import GAP
from armsight.recognition.any_arm.views import SIDE, Crop
from armsight.recognition.own_arm.surface import arm_surface, render
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import link_poses

FINE = 8
"""Pixels of the true mask a pixel of the crop's cells, each way."""


def _scene(name: str, seed: int) -> tuple[Fit, np.ndarray, Crop]:
    """An arm, and what a network without fault would say of its mask."""
    rng = np.random.default_rng(seed)
    robot = load_robot(name)
    lower, upper = (np.clip(v, -1.5, 1.5) for v in (robot.limits.lower, robot.limits.upper))
    q = rng.uniform(lower, upper)
    eye = 2.0 * np.array([np.cos(seed), np.sin(seed), rng.uniform(0.1, 0.5)])
    surface = arm_surface(robot)
    corners = surface.posed(q)
    T = inverse(look_at(eye, tuple(corners.mean(axis=0))))
    p = corners @ T[:3, :3].T + T[:3, 3]
    f = 0.38 * SIDE / np.abs(p[:, :2] / p[:, 2:]).max()
    cells = SIDE // 4
    middle, scale = 0.5 * (FINE * cells - 1), FINE / 4
    lens = np.array([f * scale, f * scale, middle, middle, 0, 0, 0, 0, 0.0])
    drawn = render(surface, corners, T, lens, (FINE * cells, FINE * cells)).mask
    small = drawn.reshape(cells, FINE, cells, FINE).mean((1, 3)).astype(np.float32)
    arm = cv2.resize(small, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR)
    inside = np.ones((SIDE, SIDE), bool)
    crop = Crop(np.zeros((SIDE, SIDE, 3), np.uint8), np.eye(3), f, inside)
    return Fit(robot, T, q, 0.0, np.eye(6 + robot.n)), arm, crop


def _moved(true: Fit, rng: np.random.Generator, shift: float, turn: float, joints: float) -> Fit:
    R = Rotation.from_rotvec(turn * rng.normal(size=3)).as_matrix()
    T = true.T_camera_base
    t = T[:3, 3] + shift * rng.normal(size=3) * [0.5, 0.5, 2.0]
    q = true.q + joints * rng.normal(size=len(true.q))
    return Fit(true.robot, make_pose(R @ T[:3, :3], t), q, 0.0, true.information)


def _landmarks(true: Fit, crop: Crop, rng: np.random.Generator, pixels: float) -> Observations:
    marks = find_landmarks(true.robot)
    p = marks.placed(true.T_camera_base @ link_poses(true.robot, true.q))
    sigma = pixels / crop.f
    at = p[:, :2] / p[:, 2:] + rng.normal(0.0, sigma, (len(p), 2))
    covariance = np.tile(np.eye(2) * sigma**2, (len(at), 1, 1))
    return Observations(marks.link, marks.point, at, covariance, np.ones(len(at)))


@pytest.mark.parametrize("known", [True, False])
def test_an_outline_brings_a_fit_nearer(known: bool) -> None:
    before, after = [], []
    for k, name in enumerate(["ur5", "panda", "iiwa", "ur10"] * 2):
        true, arm, crop = _scene(name, k)
        rng = np.random.default_rng([k, 1])
        start = _moved(true, rng, 0.03, 0.03, 0.0 if known else 0.06)
        seen = _landmarks(true, crop, rng, 5.0)
        edge = Edge.of(arm, crop)
        found = follow_outline(start, seen, edge, known)
        for fit, errors in ((start, before), (found, after)):
            away = np.linalg.norm(fit.joints() - true.joints(), axis=1)
            errors.append(1e3 * float(away.mean()))
        assert outline_overlap(found, edge) > outline_overlap(start, edge)
        if known:
            np.testing.assert_allclose(found.q, true.q, atol=1e-4)
    assert np.median(before) > 40.0
    assert np.median(after) < (18.0 if known else 30.0)


def test_without_an_edge_a_fit_stays_as_it_is() -> None:
    true, arm, crop = _scene("ur5", 0)
    seen = _landmarks(true, crop, np.random.default_rng(0), 5.0)
    assert follow_outline(true, seen, Edge.of(np.zeros_like(arm), crop)) is true


def test_distances_to_an_edge_are_signed_and_in_pixels() -> None:
    _, arm, crop = _scene("ur5", 0)
    arm[:] = 0.0
    arm[:, : SIDE // 2] = 1.0
    distance = Edge.of(arm, crop).distance
    half = len(distance) // 2
    np.testing.assert_allclose(distance[5, half:], np.arange(half) + 0.5, atol=1.0)
    np.testing.assert_allclose(distance[5, :half], np.arange(-half, 0) + 0.5, atol=1.0)


def test_with_known_joints_a_pose_is_found_from_bad_landmarks() -> None:
    errors = []
    for k, name in enumerate(["ur5", "panda", "ur10"]):
        true, arm, crop = _scene(name, k)
        rng = np.random.default_rng([k, 2])
        seen = _landmarks(true, crop, rng, 8.0)
        # A third of them are somewhere else altogether, as a network's are.
        wild = rng.random(len(seen.at)) < 0.33
        seen.at[wild] += rng.normal(0.0, 40.0 / crop.f, (int(wild.sum()), 2))
        found = place_known(true.robot, find_landmarks(true.robot), seen, arm, crop, true.q)
        assert found is not None
        fit, overlap = found
        np.testing.assert_allclose(fit.q, true.q, atol=1e-4)
        assert overlap > 0.8
        errors.append(1e3 * np.linalg.norm(fit.joints() - true.joints(), axis=1).mean())
    assert np.median(errors) < 25.0


def test_an_outline_does_not_hold_to_the_edge_of_the_picture() -> None:
    """Half of the arm lies beyond the picture: the mask ends there, and the arm does not."""
    true, arm, crop = _scene("ur5", 0)
    inside = np.ones((SIDE, SIDE), bool)
    inside[:, : SIDE // 2] = False
    cut = np.where(inside, arm, 0.0).astype(np.float32)
    seen = _landmarks(true, crop, np.random.default_rng(0), 2.0)
    away = []
    for known in (crop, Crop(crop.image, crop.R, crop.f, inside)):
        fit = follow_outline(true, seen, Edge.of(cut, known))
        away.append(np.linalg.norm(fit.joints() - true.joints(), axis=1).mean())
    assert away[1] < 0.8 * away[0]
    assert outline_overlap(true, Edge.of(cut, Crop(crop.image, crop.R, crop.f, inside))) > 0.85
    assert outline_overlap(true, Edge.of(cut, crop)) < 0.75


def _best(true: Fit, starts: list[Fit], pixels: float, k: int) -> Outlined:
    _, arm, crop = _scene(true.robot.name, k)
    seen = _landmarks(true, crop, np.random.default_rng([k, 3]), pixels)
    found = best_outlined(starts, seen, arm, crop)
    assert found is not None
    return found


def test_a_pose_leads_only_others_that_put_the_joints_elsewhere() -> None:
    true = _scene("ur5", 0)[0]
    near = _moved(true, np.random.default_rng(0), 0.01, 0.01, 0.01)
    assert _best(true, [true], 2.0, 0).gap == GAP
    assert _best(true, [true, near], 2.0, 0).gap == GAP
    T = true.T_camera_base.copy()
    T[:3, 3] += 0.3 * T[:3, 3]  # too far by a third: nothing of it lies where it is seen
    far = Fit(true.robot, T, true.q, 0.0, true.information)
    nothing = np.zeros((SIDE, SIDE), np.float32)
    _, _, crop = _scene("ur5", 0)
    seen = _landmarks(true, crop, np.random.default_rng(0), 2.0)
    apart = best_outlined([far, true], seen, nothing, crop)
    assert apart is not None
    assert apart.fit is true
    assert 0.0 < apart.gap < cost_of(far, seen)


def test_a_fit_that_agrees_with_the_mask_decides_what_the_mask_is_unsure_about() -> None:
    true, arm, crop = _scene("ur5", 3)
    row, column = np.argwhere(arm > 0.99)[len(np.argwhere(arm > 0.99)) // 2]
    unsure, wrong = arm.copy(), arm.copy()
    unsure[row, column], wrong[row, column] = 0.4, 0.1
    assert drawn_into(unsure, true, 0.9, crop)[row, column] > 0.5
    assert drawn_into(wrong, true, 0.9, crop)[row, column] < 0.5
    assert drawn_into(unsure, true, 0.6, crop) is unsure
    beyond = np.argwhere(arm == 0.0)[0]
    unsure[tuple(beyond)] = 0.6
    assert drawn_into(unsure, true, 0.9, crop)[tuple(beyond)] < 0.5


def test_no_fits_have_no_best_one() -> None:
    _, arm, crop = _scene("ur5", 0)
    true = _scene("ur5", 0)[0]
    seen = _landmarks(true, crop, np.random.default_rng(0), 2.0)
    assert best_outlined([], seen, arm, crop) is None


def test_pulls_lead_from_the_drawn_rim_to_the_edge_of_the_mask() -> None:
    """Each by plain numpy: a drawn disc beside the disc of a mask, on one link that is turned."""
    n, f, sharp, along = 48, 60.0, 0.02, 0.5
    middle = 0.5 * (n - 1)
    v, u = np.mgrid[:n, :n]
    face = np.where(np.hypot(u - 22, v - 24) < 12, 1, -1).astype(np.int32)
    depth = np.where(face >= 0, 1.5 + 0.01 * u, np.inf).astype(np.float32)
    distance = np.hypot(u - 24.0, v - 25.0) - 13.0
    away = u < 30
    T = make_pose(Rotation.from_rotvec([0.3, -0.4, 0.2]).as_matrix(), np.array([0.1, -0.2, 1.4]))
    poses = np.stack([np.eye(4), np.eye(4), T])
    owner = np.array([0, 2])
    arguments = (depth, face, owner, poses, f, distance, away, 6.0, sharp, along)
    found, link, point, at, covariance = rim_pulls(*arguments, 1)
    drawn = face >= 0
    rim = drawn & (cv2.erode(drawn.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0) & away
    down, right = np.gradient(distance)
    k = 0
    for row, column in np.argwhere(rim):
        off = distance[row, column] + 0.5
        normal = np.array([right[row, column], down[row, column]])
        normal /= np.linalg.norm(normal)
        edge = np.clip(np.round([column, row] - off * normal).astype(int), 0, n - 1)
        if abs(off) >= 6.0 or not away[edge[1], edge[0]]:
            continue
        z = depth[row, column]
        ray = np.array([(column - middle) / f, (row - middle) / f, 1.0])
        assert link[k] == 2
        np.testing.assert_allclose(T[:3, :3] @ point[k] + T[:3, 3], z * ray, rtol=1e-6)
        np.testing.assert_allclose(at[k], ray[:2] - off * normal / f, rtol=1e-9)
        tangent = np.array([-normal[1], normal[0]])
        true = sharp**2 * np.outer(normal, normal) + along**2 * np.outer(tangent, tangent)
        np.testing.assert_allclose(covariance[k], true, rtol=1e-6, atol=1e-12)
        k += 1
    assert k == found == len(link) > 20
    # Of neighbours one in three, and all are counted.
    counted, _, some, *_ = rim_pulls(*arguments, 3)
    assert counted == found
    np.testing.assert_array_equal(some, point[::3])


def test_threads_do_not_change_which_fit_is_best() -> None:
    true, arm, crop = _scene("ur5", 0)
    seen = _landmarks(true, crop, np.random.default_rng(0), 4.0)
    starts = [_moved(true, np.random.default_rng(k), 0.05, 0.05, 0.1) for k in range(5)]
    one, two = (best_outlined(starts, seen, arm, crop, threads) for threads in (1, 2))
    assert one is not None
    assert two is not None
    assert (one.overlap, one.gap) == (two.overlap, two.gap)
    np.testing.assert_array_equal(one.fit.q, two.fit.q)
