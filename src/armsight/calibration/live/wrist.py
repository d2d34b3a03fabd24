"""Calibrating a stereo pair on the flange by its own looks at a ball that stands still.

The sphere's registration with its roles exchanged: there fixed cameras see a ball that the arm
carries, at a place in the flange's frame that is not known; here the camera is carried, and the
ball's place in ``base`` is not known. Seen from the flange it is the base that moves. As there an
error of the distances is found, too: a ball that is not as large as it should be lies too near.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, JointVector, Mask, Points, Pose, Vector3
from armsight.calibration.arm import flange_poses
from armsight.calibration.live.seen import LookAt, Looked, MoveTo, Request
from armsight.calibration.spheres import register_spheres
from armsight.calibration.views import FreeCheck
from armsight.devices.data import StereoInfo
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, log, skew, transform
from armsight.robots.kinematics import sphere_centers
from armsight.robots.robot import Robot

NEAR, FAR = 0.22, 0.40
"""The ball is looked at from so far [m]: where the pair is used."""
SPREAD, CANDIDATES, ROUNDS = 1.2, 40000, 10
"""Views are drawn this far around home [rad], so many at a time, so often at most."""
RIM = 0.04
"""Of a picture's width that the ball keeps from its edge."""
KEPT, ON_WAY, STEP = 0.03, 0.025, 0.03
"""So far the arm keeps from the ball where it looks, and on its way [m], judged every so many [rad]
of it: the ball is believed to be where the fixed cameras have it."""
REST, FRAMES = 0.3, 4
"""Before each look [s], and exposures that are averaged."""
LEAST = 8
"""Looks that are needed."""
SIGMA = 0.001
"""Of a ball's centre, the arm's own errors included [m]."""
LENGTH, TURN = 0.05, 0.35
"""A view that differs by so much in where the ball is in the picture [m], or in how the flange is
turned [rad], is another view."""
TARGET = np.array([0.0, 0.0, 0.3])
"""A point this far before the pair is what its expected error is stated for [m]."""


@dataclass(frozen=True)
class WristSetup:
    """What is there to calibrate.

    Attributes:
        robot: the arm with its tool.
        pair: on the flange, as believed.
        radius: of the ball [m].
        free: whether the arm may stand at joint angles.
        looks: how many are taken.
    """

    robot: Robot
    pair: StereoInfo
    radius: float
    free: FreeCheck
    looks: int = 24


@dataclass(frozen=True)
class WristLook:
    """The ball seen once: ``T_base_flange`` and its centre (3,) in the left lens's frame [m]."""

    T_base_flange: Pose
    center: Vector3


@dataclass(frozen=True)
class WristResult:
    """What comes of it.

    Attributes:
        T_flange_camera: the left lens in the flange.
        covariance: (6, 6) of that, in the lens's axes [m], [rad].
        ball: (3,) its centre in ``base`` [m].
        used: looks that counted; rms: of their centres [m].
        looks: all of them.
    """

    T_flange_camera: Pose
    covariance: Floats
    ball: Vector3
    used: int
    rms: float
    looks: tuple[WristLook, ...]

    @property
    def target_error(self) -> float:
        """Expected error of a point 0.3 m before the pair [m]; the arm's own is not in it."""
        J = np.hstack([np.eye(3), -skew(TARGET)])
        return float(np.sqrt(np.trace(J @ self.covariance @ J.T)))


def wrist_procedure(
    setup: WristSetup,
    find: Callable[[], Vector3 | None],
    taken: Callable[[], WristLook | None],
    rng: np.random.Generator,
    told: Callable[[int, int, WristLook | None], None] = lambda done, of, look: None,
) -> Generator[Request, bool | Looked, WristResult]:
    """Look at the ball from all around and solve; yields requests.

    Args:
        setup: what is there.
        find: where the fixed cameras have the ball, (3,) in ``base`` [m]; asked after a look.
        taken: what the pair saw in the newest look, or None.
        rng: of views.
        told: of looks done, of how many, and the newest.

    Raises:
        CalibrationError: nobody sees the ball, or it can be looked at too seldom.
    """
    looked = yield LookAt((), REST, FRAMES)
    assert isinstance(looked, Looked)
    place = find()
    if place is None:
        raise CalibrationError(
            "no fixed camera sees the ball: put it on a stand, at rest, where they and the arm's "
            "pair can see it"
        )
    goals = choose_views(setup, place, rng)
    looks: list[WristLook] = []
    count, home, from_home = len(goals), np.asarray(setup.robot.home, float), False
    while goals:
        at = looked.joints
        clear = [k for k, goal in enumerate(goals) if keeps_off(setup, at, goal, place)]
        if not clear:
            if from_home or not keeps_off(setup, at, home, place):
                break
            from_home = True
            yield MoveTo(home, "away from the ball")
            looked = Looked(home, [])
            continue
        from_home = False
        goal = goals.pop(min(clear, key=lambda k: float(np.abs(goals[k] - at).max())))
        arrived = yield MoveTo(goal, "look at the ball")
        looked = yield LookAt((0,), REST, FRAMES)  # where it stands now, arrived or not
        assert isinstance(looked, Looked)
        look = taken() if arrived else None
        if look is not None:
            looks.append(look)
        told(count - len(goals), count, look)
    return solve_wrist(looks, place, rng)


def choose_views(setup: WristSetup, place: Vector3, rng: np.random.Generator) -> list[JointVector]:
    """Configurations in which both lenses see a ball, unlike each other.

    Args:
        setup: what is there.
        place: (3,) of the ball in ``base`` [m].
        rng: draws them.

    Raises:
        CalibrationError: there are too few.
    """
    robot, pair = setup.robot, setup.pair
    lower, upper = robot.limits.lower, robot.limits.upper
    T_home_base = inverse(flange_poses(robot, robot.home[None])[0])
    found: list[JointVector] = []
    features: list[Floats] = []
    for _ in range(ROUNDS):
        joints = rng.uniform(
            np.maximum(robot.home - SPREAD, lower),
            np.minimum(robot.home + SPREAD, upper),
            (CANDIDATES, robot.n),
        )
        flange = flange_poses(robot, joints)
        seen = _in_camera(flange @ pair.T_mount_camera, place)
        for k in np.flatnonzero(in_view(pair, seen, setup.radius)):
            if _clear(setup, joints[k], place) and setup.free(joints[k]):
                found.append(joints[k])
                turn = log(T_home_base @ flange[k])[3:]
                features.append(np.concatenate([seen[k] / LENGTH, turn / TURN]))
        if len(found) >= 4 * setup.looks:
            break
    if len(found) < LEAST:
        raise CalibrationError(
            f"the arm can look at the ball at ({', '.join(f'{x:.2f}' for x in place)}) m in base "
            f"from {len(found)} places only: it needs {LEAST}; put it before the arm, 0.2 to 0.4 m "
            "from where the pair can come"
        )
    return [found[k] for k in _unlike(np.array(features), setup.looks)]


def solve_wrist(
    looks: Sequence[WristLook], place: Vector3, rng: np.random.Generator
) -> WristResult:
    """The pair on the flange, and the ball, by all looks.

    Args:
        looks: of a ball at rest.
        place: (3,) about where it is in ``base`` [m].
        rng: for the start.

    Raises:
        CalibrationError: there are too few, or they do not agree.
    """
    if len(looks) < LEAST:
        raise CalibrationError(
            f"the pair saw the ball {len(looks)} times, at least {LEAST} are needed; see what the "
            "guard said, and that nothing stands before the ball"
        )
    T_flange_base = np.array([inverse(one.T_base_flange) for one in looks])
    found = register_spheres(
        T_flange_base, [[one.center] for one in looks], place, rng, SIGMA, 0.03
    )
    return WristResult(
        found.T_base_camera[0], found.covariance[0], found.hangs, found.used[0],
        float(found.rms[0]), tuple(looks),
    )  # fmt: skip


def in_view(pair: StereoInfo, centers: Points, radius: float) -> Mask:
    """(k,) whether both lenses show whole balls at (k, 3) centres in the left one's frame."""
    right = transform(inverse(pair.T_left_right), centers)
    near = (centers[:, 2] > NEAR) & (centers[:, 2] < FAR)
    return np.asarray(
        near & _shown(pair.left, centers, radius) & _shown(pair.right, right, radius), bool
    )


def _shown(lens: PinholeCamera, centers: Points, radius: float) -> Mask:
    z = np.maximum(centers[:, 2], 0.1)
    pixel = lens.project(np.column_stack([centers[:, :2], z]))
    edge = RIM * lens.width + radius * lens.fx / z
    size = np.array([lens.width, lens.height])
    return np.asarray(((pixel > edge[:, None]) & (pixel < size - edge[:, None])).all(1), bool)


def _in_camera(T_base_camera: Floats, place: Vector3) -> Points:
    """(k, 3) a place of ``base`` in each of (k, 4, 4) cameras."""
    off = place - T_base_camera[:, :3, 3]
    return np.asarray(np.einsum("kji,kj->ki", T_base_camera[:, :3, :3], off))


def keeps_off(setup: WristSetup, start: JointVector, end: JointVector, place: Vector3) -> bool:
    """Whether the arm keeps from the ball on the straight way between (n,) joints [rad].

    That is the way which the planner takes, since the map has no ball.
    """
    steps = max(int(np.ceil(np.abs(end - start).max() / STEP)), 1)
    ways = (start + (end - start) * k / steps for k in range(steps + 1))
    return all(_clear(setup, q, place, ON_WAY) for q in ways)


def _clear(setup: WristSetup, joints: JointVector, place: Vector3, kept: float = KEPT) -> bool:
    """Whether the arm, with its tool, keeps from the ball."""
    away = np.linalg.norm(sphere_centers(setup.robot, joints) - place, axis=1)
    return bool((away - setup.robot.spheres.radius).min() > setup.radius + kept)


def _unlike(features: Floats, count: int) -> list[int]:
    """Of (k, d) features so many that are far from each other."""
    chosen = [0]
    nearest = np.linalg.norm(features - features[0], axis=1)
    while len(chosen) < min(count, len(features)):
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(features - features[chosen[-1]], axis=1))
    return chosen
