"""The sphere's procedure from places to poses, with pictures that solve every ray exactly."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.calibration.arm import flange_poses
from armsight.calibration.live.seen import LookAt, Looked, MoveTo, Picture
from armsight.calibration.live.sphere import SphereSetup, choose_places, sphere_procedure
from armsight.devices.camera_models import camera_info
from armsight.errors import CalibrationError
from armsight.experiments.calibration_sphere import papers_way
from armsight.geometry.pose import exp, inverse, look_at, transform
from armsight.robots import load_robot
from armsight.tasks.calibrate_sphere import carrying_sphere
from armsight.workcell.packaged import load

R, HANGS = 0.075, np.array([0.0, 0.0, 0.25])


def cameras(wrong=None):
    """Two Kinects before an arm at the origin; ``wrong``: twists of how they are believed."""
    eyes = [np.array([1.6, 1.2, 1.0]), np.array([1.6, -1.2, 0.9])]
    out = []
    for k, eye in enumerate(eyes):
        T = look_at(eye, np.array([0.2, 0.0, 0.5]))
        if wrong is not None:
            T = T @ exp(wrong[k])
        out.append(replace(camera_info(f"cam{k}", "kinect_v2"), T_mount_camera=T))
    return tuple(out)


def picture(info, center, error):
    """The depth picture of the sphere before a wall, read too deep by ``error(z)``."""
    rays = info.depth.rays
    ray = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=2)
    local = transform(inverse(info.T_mount_camera), center[None])[0]
    a, b = np.sum(ray * ray, 2), ray @ local
    inside = b * b - a * (local @ local - R**2)
    z = np.full(a.shape, 4.0)
    hit = inside > 0
    z[hit] = (b[hit] - np.sqrt(inside[hit])) / a[hit]
    return (z + error(z)).astype(np.float32)


def carry_out(setup, truth, hangs, error, rng, refuse=()):
    """Be the arm and the cameras; the result and what the watcher was told."""
    told, moves = [], 0
    steps = sphere_procedure(setup, rng, lambda *all: told.append(all))
    request, at = next(steps), None
    try:
        while True:
            if isinstance(request, MoveTo):
                moves += 1
                at = request.joints
                request = steps.send(moves not in refuse)
            else:
                assert isinstance(request, LookAt)
                T = flange_poses(setup.robot, at[None])[0]
                center = T[:3, :3] @ hangs + T[:3, 3]
                pictures = [Picture(None, None, picture(c, center, error)) for c in truth]
                request = steps.send(Looked(at, pictures))
    except StopIteration as end:
        return end.value, told


def test_cameras_found_through_the_whole_procedure(rng):
    """Cameras 5 cm off, depth read 1 % and 8 mm too deep, the sphere a centimetre aside."""
    robot = load_robot("ur5")
    wrong = [[0.04, -0.03, 0.02, 0.02, -0.01, 0.02], [-0.02, 0.03, 0.03, 0.0, 0.02, -0.02]]
    setup = SphereSetup(robot, cameras(wrong), R, HANGS, lambda q: True, places=14)
    truth, hangs = cameras(), HANGS + np.array([0.008, -0.006, 0.003])
    result, told = carry_out(setup, truth, hangs, lambda z: 0.008 + 0.01 * (z - 1.5), rng, {2})
    assert len(result.places) == len(told) == 13  # the second move did not arrive
    assert told[-1][:2] == (14, 14)
    found = result.registration
    np.testing.assert_allclose(found.hangs, hangs, atol=1e-3)
    points = np.array([[x, y, z] for x in (-0.4, 0.4) for y in (-0.3, 0.3) for z in (1.2, 2.0)])
    for k, info in enumerate(truth):
        T = found.T_base_camera[k]
        off = transform(T, points) - transform(info.T_mount_camera, points)
        assert np.linalg.norm(off, axis=1).max() < 2e-3
        model = result.depth[k]
        z = np.linspace(1.3, 2.0, 8)
        middle = np.tile([255.5, 211.5], (8, 1))
        np.testing.assert_allclose(
            model.error(z, middle, info.depth), 0.008 + 0.01 * (z - 1.5), atol=2e-3
        )


def test_places_are_free_seen_and_spread(rng):
    robot, infos = load_robot("ur5"), cameras()
    asked = []

    def free(q):
        asked.append(q)
        return q[0] > 0.0

    setup = SphereSetup(robot, infos, R, HANGS, free, places=12)
    goals = choose_places(setup, rng)
    assert len(goals) == 12
    assert all(q[0] > 0.0 for q in goals)
    T = flange_poses(robot, np.array(goals))
    centers = T[:, :3, :3] @ HANGS + T[:, :3, 3]
    for k, center in enumerate(centers):
        views = [c.depth.project(transform(inverse(c.T_mount_camera), center[None])) for c in infos]
        assert any(((v > 0) & (v < [512, 424])).all() for v in views)
        assert np.linalg.norm(np.delete(centers, k, 0) - center, axis=1).min() > 0.08


def test_an_arm_that_may_stand_nowhere(rng):
    setup = SphereSetup(load_robot("ur5"), cameras(), R, HANGS, lambda q: False)
    with pytest.raises(CalibrationError, match="0 places only"):
        next(sphere_procedure(setup, rng))


def test_vs_way_is_exact_where_nothing_is_biased(rng):
    """The baseline must not be a straw man: without depth errors it finds the cameras, too."""
    robot, truth = load_robot("ur5"), cameras()
    setup = SphereSetup(robot, truth, R, HANGS, lambda q: True, places=12)
    result, _ = carry_out(setup, truth, HANGS, lambda z: 0.0, rng)
    for T, info in zip(papers_way(setup, result), truth):
        np.testing.assert_allclose(T, info.T_mount_camera, atol=2e-3)


@pytest.mark.parametrize("name", ["ur10_charging", "ur10_handover", "ur5_calibration"])
def test_the_arm_carries_the_sphere_and_nothing_else(name):
    """A plug, a gripper or a board in the cell's file is not on the arm meanwhile."""
    cell = carrying_sphere(load(name))
    assert cell.robot.tool == "sphere_marker"
    assert (cell.board, cell.gripper, cell.plug, cell.held) == (None, None, None, ())
    assert not any(camera.guard for camera in cell.camera)
