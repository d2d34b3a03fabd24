"""Registering cameras by a sphere that the arm carries: places, looks, and the solve (V, past it).

Like the board's procedure it knows neither the arm nor the cameras: it yields what it wants and is
sent what came of it.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import DepthImage, Floats, JointVector, Mask, Points, Vector3
from armsight.calibration.arm import flange_poses
from armsight.calibration.depth import DepthSamples, fit_depth
from armsight.calibration.live.seen import LookAt, Looked, MoveTo, Request
from armsight.calibration.sphere_sighting import find_sphere
from armsight.calibration.spheres import SphereRegistration, register_spheres
from armsight.calibration.views import FreeCheck
from armsight.devices.data import RgbdCameraInfo
from armsight.devices.depth_model import DepthModel
from armsight.errors import CalibrationError
from armsight.geometry.pose import inverse, transform
from armsight.robots.kinematics import link_poses
from armsight.robots.robot import Robot

CANDIDATES = 6000
"""Configurations that places are chosen from."""
RIM = 0.03
"""Of a picture's width that the sphere keeps from its edge."""
REST, FRAMES = 0.3, 5
"""Before each look [s], and exposures that are averaged."""
CENTER_SIGMA = 0.0015
"""Of a fitted centre, the arm's repeatability included [m]."""


@dataclass(frozen=True)
class SphereSetup:
    """What is there to register.

    Attributes:
        robot: the arm with the sphere as its tool.
        cameras: fixed, as believed.
        radius: of the sphere [m].
        hangs: (3,) about where its centre is in the flange's frame [m].
        free: whether the arm may stand at joint angles.
        places: how many the sphere is shown in.
        within: how far from where it is expected a camera may see it [m].
    """

    robot: Robot
    cameras: tuple[RgbdCameraInfo, ...]
    radius: float
    hangs: Vector3
    free: FreeCheck
    places: int = 30
    within: float = 0.15


@dataclass(frozen=True)
class SpherePlace:
    """The sphere in one place.

    Attributes:
        joints: (n,) as the arm reported [rad].
        seen: its centre in each camera's frame [m], or None where it was not found.
    """

    joints: JointVector
    seen: tuple[Vector3 | None, ...]


@dataclass(frozen=True)
class SphereResult:
    """What comes of it.

    Attributes:
        registration: cameras in base.
        depth: of each camera, or None.
        places: that were looked at.
    """

    registration: SphereRegistration
    depth: tuple[DepthModel | None, ...]
    places: tuple[SpherePlace, ...]


Told = Callable[[int, int, SpherePlace, Sequence[DepthImage | None]], None]
"""Told of places done, of how many, the newest, and its depth pictures."""


def sphere_procedure(
    setup: SphereSetup, rng: np.random.Generator, told: Told | None = None
) -> Generator[Request, bool | Looked, SphereResult]:
    """Show the sphere in many places and register all cameras; yields requests.

    Raises:
        CalibrationError: it can be shown nowhere, or no camera saw it often enough.
    """
    goals = choose_places(setup, rng)
    everyone = tuple(range(len(setup.cameras)))
    places: list[SpherePlace] = []
    for number, goal in enumerate(goals):
        arrived = yield MoveTo(goal, "show the sphere")
        if not arrived:
            continue
        looked = yield LookAt(everyone, REST, FRAMES)
        assert isinstance(looked, Looked)
        depth = [p.depth for p in looked.pictures]
        place = _read(setup, looked.joints, depth)
        places.append(place)
        if told is not None:
            told(number + 1, len(goals), place, depth)
    return solve_spheres(setup, places, rng)


def choose_places(setup: SphereSetup, rng: np.random.Generator) -> list[JointVector]:
    """Configurations that show the sphere all over what the cameras see, in a short order.

    Raises:
        CalibrationError: there are too few.
    """
    robot = setup.robot
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    joints = rng.uniform(lower, upper, (CANDIDATES, robot.n))
    flange = flange_poses(robot, joints)
    center = flange[:, :3, :3] @ setup.hangs + flange[:, :3, 3]
    views: Mask = np.array([_in_view(c, center, setup.radius) for c in setup.cameras])
    left = np.flatnonzero(views.any(0))
    chosen: list[int] = []
    # Far from all that were chosen, and where cameras look that have few so far.
    nearest = np.full(len(joints), 1.0)
    shown = np.zeros(len(setup.cameras))
    while len(left) and len(chosen) < setup.places:
        worth = nearest[left] * (views[:, left] / (1.0 + shown)[:, None]).sum(0)
        best = int(left[np.argmax(worth)])
        left = left[left != best]
        if not setup.free(joints[best]):
            continue
        clear = [
            views[k, best] and _unhidden(robot, joints[best], c, center[best], setup.radius)
            for k, c in enumerate(setup.cameras)
        ]
        if not any(clear):
            continue
        chosen.append(best)
        shown += clear
        nearest = np.minimum(nearest, np.linalg.norm(center - center[best], axis=1))
    if len(chosen) < 6:
        raise CalibrationError(
            f"the arm can show the sphere in {len(chosen)} places only: it needs six that the "
            "cameras look at; check where they are said to be, and what the arm must keep from"
        )
    return _short_way([joints[k] for k in chosen], robot.home)


def _in_view(info: RgbdCameraInfo, centers: Points, radius: float) -> Mask:
    local = transform(inverse(info.T_mount_camera), centers)
    lens, z = info.depth, local[:, 2]
    before = (z - radius > max(info.range[0], 0.3)) & (z < info.range[1])
    pixel = np.full((len(local), 2), -1.0)
    pixel[before] = lens.project(local[before])
    edge = RIM * lens.width + radius * lens.fx / np.maximum(z, 0.1)
    size = np.array([lens.width, lens.height])
    inside = (pixel > edge[:, None]) & (pixel < size - edge[:, None])
    return np.asarray(before & inside.all(1), bool)


def _unhidden(
    robot: Robot, joints: JointVector, info: RgbdCameraInfo, center: Vector3, radius: float
) -> bool:
    """Whether the arm's own links leave the camera's view of the sphere free."""
    spheres = robot.spheres
    poses = link_poses(robot, joints)[spheres.link]
    points = np.einsum("sij,sj->si", poses[:, :3, :3], spheres.center) + poses[:, :3, 3]
    eye = info.T_mount_camera[:3, 3]
    away = float(np.linalg.norm(center - eye))
    ray = (center - eye) / away
    along = (points - eye) @ ray
    aside = np.linalg.norm(points - eye - along[:, None] * ray, axis=1)
    before = (along > 0.0) & (along < away - 1.5 * radius)
    return not bool((before & (aside < spheres.radius + radius)).any())


def _short_way(goals: list[JointVector], start: JointVector) -> list[JointVector]:
    """Always on to the nearest."""
    out, at = [], np.asarray(start, float)
    while goals:
        at = goals.pop(int(np.argmin([np.abs(g - at).max() for g in goals])))
        out.append(at)
    return out


def _read(
    setup: SphereSetup, joints: JointVector, depth: Sequence[DepthImage | None]
) -> SpherePlace:
    T = flange_poses(setup.robot, np.asarray(joints, float)[None])[0]
    expected = T[:3, :3] @ setup.hangs + T[:3, 3]
    seen: list[Vector3 | None] = []
    for info, picture in zip(setup.cameras, depth):
        near = transform(inverse(info.T_mount_camera), expected[None])[0]
        fit = (
            find_sphere(picture, info.depth, info.noise, setup.radius, near, setup.within)
            if picture is not None
            else None
        )
        seen.append(fit.center if fit is not None else None)
    return SpherePlace(np.asarray(joints, float), tuple(seen))


def solve_spheres(
    setup: SphereSetup, places: Sequence[SpherePlace], rng: np.random.Generator
) -> SphereResult:
    """Register the cameras, then fit each one's depth, and both once more.

    Raises:
        CalibrationError: no camera saw the sphere often enough.
    """
    if not places:
        raise CalibrationError("the arm came to no place: see what the guard said")
    flange = flange_poses(setup.robot, np.array([p.joints for p in places]))
    models: tuple[DepthModel | None, ...] = (None,) * len(setup.cameras)
    for _ in range(2):
        seen = [
            [_corrected(setup, k, p, models[k]) for k, p in enumerate(place.seen)]
            for place in places
        ]
        found = register_spheres(flange, seen, setup.hangs, rng, CENTER_SIGMA)
        models = tuple(
            _depth_model(setup, k, places, flange, found) for k in range(len(setup.cameras))
        )
    return SphereResult(found, models, tuple(places))


def _surface(center: Points, radius: float) -> Floats:
    """(m,) depth of spheres' nearest points, where depth is read [m]; (m, 3) centres."""
    away = np.linalg.norm(center, axis=1)
    return np.asarray(center[:, 2] * (1.0 - radius / away), float)


def _corrected(
    setup: SphereSetup, camera: int, center: Vector3 | None, model: DepthModel | None
) -> Vector3 | None:
    """A centre by a depth model found before."""
    if center is None or model is None:
        return center
    lens = setup.cameras[camera].depth
    measured = _surface(np.asarray(center[None], float), setup.radius)
    true = measured
    pixel = lens.project(center[None])
    for _ in range(3):
        true = measured - model.error(true, pixel, lens)
    error = float((measured - true)[0])
    return np.asarray(center * (1.0 - error / center[2]))


def _depth_model(
    setup: SphereSetup,
    camera: int,
    places: Sequence[SpherePlace],
    flange: Floats,
    found: SphereRegistration,
) -> DepthModel | None:
    if found.used[camera] == 0:
        return None
    T = inverse(found.T_base_camera[camera])
    samples = []
    for place, at in zip(places, flange):
        center = place.seen[camera]
        if center is None:
            continue
        truth = transform(T, (at[:3, :3] @ found.hangs + at[:3, 3])[None])
        if np.linalg.norm(truth[0] - center) > setup.within:
            continue
        true = _surface(truth, setup.radius)
        pixel = setup.cameras[camera].depth.project(truth)
        samples.append(DepthSamples(pixel, true + center[2] - truth[:, 2], true, np.array([0.001])))
    return fit_depth(samples, setup.cameras[camera].depth)
