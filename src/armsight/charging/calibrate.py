"""Where the camera stands and where the plug's tip is, without a marker: the plug is the marker.

The plug is turned to the camera and moved about; each look gives its pose in the camera with a
covariance (:mod:`armsight.charging.pose`), each stop of the arm its joints. Two transforms follow,
camera in base and plug on flange, by the closed form of Park or Shah as in the charging paper
(which cites Tsai), then by a bundle in which the arm's own errors are unknowns with priors and each
look counts by its covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Floats, JointVector, Mask, Pose, Poses
from armsight.calibration import se3
from armsight.calibration.arm import flange_poses
from armsight.calibration.closed_form import park
from armsight.calibration.robot_errors import RobotErrors
from armsight.errors import CalibrationError
from armsight.geometry.pose import exp
from armsight.robots.robot import Robot

LEAST_VIEWS = 6
LEAST_TURN = np.deg2rad(15.0)
"""The looks must turn the plug about at least two axes by this much (root mean square)."""
AGREE = 0.02
"""A look that disagrees by more than this is of another plug, or of another roll [m]; an angle
counts as what it moves at 0.1 m."""
REST_SIGMA = np.array([1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4])
"""How exactly the arm comes to rest where it says [m, rad]."""


@dataclass(frozen=True)
class PlugLook:
    """One look at the plug.

    Attributes:
        joints: (n,) as the arm reports them [rad].
        T_camera_plug: the plug in the camera's frame.
        covariance: (6, 6) of it as a twist in the plug's frame [m, rad].
        wrench: (6,) that the force sensor felt, in the flange's frame [N], [N m]; None where nobody
            feels. What hangs in a soft mount is bent by it.
    """

    joints: JointVector
    T_camera_plug: Pose
    covariance: Floats
    wrench: Floats | None = None


@dataclass(frozen=True)
class PlugCalibration:
    """The answer.

    Attributes:
        T_base_camera: the camera in base.
        T_flange_plug: the plug on the flange; its tip is its origin, its z points out of it.
        arm_errors: (size,) see :class:`RobotErrors`; zero where they were not solved.
        covariance: (12 + size, 12 + size) of camera, plug (twists in their own frames) and arm.
        used: which looks count.
        residual: (n, 6) of every look as a twist in the plug's frame [m, rad].
        errors: the model of the arm's errors.
    """

    T_base_camera: Pose
    T_flange_plug: Pose
    arm_errors: Floats
    covariance: Floats
    used: Mask
    residual: Floats
    errors: RobotErrors

    def tip_sigma(self, joints: JointVector) -> float:
        """Standard deviation of the tip against what the camera sees, with the arm there [m]."""
        C = np.linalg.inv(self.T_base_camera) @ self.base_tip(joints)
        J = _jacobian(self, np.asarray(joints, float)[None], C[None])[0]
        return float(np.sqrt(np.trace((J @ self.covariance @ J.T)[:3, :3])))

    def base_tip(self, joints: JointVector) -> Pose:
        """``T_base_plug`` by the calibrated arm."""
        A, _ = self.errors.flange_poses(np.asarray(joints, float)[None], self.arm_errors)
        return np.asarray(A[0] @ self.T_flange_plug)


def uncalibrated(T_base_camera: Pose, T_flange_plug: Pose, errors: RobotErrors) -> PlugCalibration:
    """What is believed before the first look."""
    size = errors.size
    return PlugCalibration(
        T_base_camera,
        T_flange_plug,
        np.zeros(size),
        np.eye(12 + size),
        np.zeros(0, bool),
        np.zeros((0, 6)),
        errors,
    )


def closed_form(robot: Robot, looks: Sequence[PlugLook]) -> tuple[Pose, Pose]:
    """``T_base_camera`` and ``T_flange_plug`` by Park's closed form, all looks alike.

    Raises:
        CalibrationError: see :func:`check_looks`.
    """
    A, C = _stacked(robot, looks)
    check_looks(A)
    return park(A, C)


def calibrate_by_plug(
    robot: Robot,
    looks: Sequence[PlugLook],
    rng: np.random.Generator,
    arm: bool = True,
    rounds: int = 15,
    errors: RobotErrors | None = None,
) -> PlugCalibration:
    """Closed form, wrong looks left out, then the bundle.

    Args:
        robot: the nominal arm.
        looks: at least :data:`LEAST_VIEWS`.
        rng: draws the subsets among which the start is chosen.
        arm: whether the arm's own errors are solved as well.
        rounds: of Gauss-Newton, at most.
        errors: that the arm may have; those of its size if None.

    Raises:
        CalibrationError: too few looks, all turned alike, or most of them contradict each other.
    """
    A, C = _stacked(robot, looks)
    check_looks(A)
    X, Z = _start(A, C, rng)
    answer = uncalibrated(X, Z, errors or RobotErrors(robot))
    joints = np.array([look.joints for look in looks])
    W = _weights(looks)
    for _ in range(rounds):
        answer, moved = _step(answer, joints, C, W, arm)
        if moved < 1e-8:
            break
    agree = answer.used & (_size(answer.residual) < AGREE)
    if agree.sum() < max(LEAST_VIEWS, 0.5 * len(looks)):
        raise CalibrationError(
            f"plug calibration: only {int(agree.sum())} of {len(looks)} looks agree; "
            "check that the plug in the hand is the type that was asked for and sits firmly"
        )
    return answer


def check_looks(A: Poses) -> None:
    """Refuse sets of looks that cannot tell the transforms.

    Args:
        A: (n, 4, 4) ``T_base_flange`` of the looks.

    Raises:
        CalibrationError: says what is missing.
    """
    if len(A) < LEAST_VIEWS:
        raise CalibrationError(
            f"plug calibration: {len(A)} looks; at least {LEAST_VIEWS} are needed, 15 are good"
        )
    i, j = np.triu_indices(len(A), 1)
    turns = se3.logs(se3.inverses(A[i]) @ A[j])[:, 3:]
    spread = np.sqrt(np.linalg.eigvalsh(turns.T @ turns / len(turns)))
    if spread[1] < LEAST_TURN:
        raise CalibrationError(
            "plug calibration: the looks turn the plug about one axis only "
            f"({np.rad2deg(spread[1]):.0f} deg about the next); turn it about at least two axes by "
            f"{np.rad2deg(LEAST_TURN):.0f} deg or more"
        )


def _stacked(robot: Robot, looks: Sequence[PlugLook]) -> tuple[Poses, Poses]:
    if not looks:
        return np.zeros((0, 4, 4)), np.zeros((0, 4, 4))
    A = flange_poses(robot, np.array([look.joints for look in looks]))
    return A, np.array([look.T_camera_plug for look in looks])


def _weights(looks: Sequence[PlugLook]) -> Floats:
    """(v, 6, 6) how much each look counts."""
    C = np.array([look.covariance for look in looks])
    return np.asarray(np.linalg.inv(C + np.diag(REST_SIGMA**2)))


def _start(A: Poses, C: Poses, rng: np.random.Generator) -> tuple[Pose, Pose]:
    """The closed form of the subset that most looks agree with (a wrong roll agrees with none)."""
    best: tuple[float, Pose, Pose] | None = None
    n = len(A)
    for attempt in range(40):
        pick = np.arange(n) if attempt == 0 else rng.choice(n, min(n, 5), replace=False)
        try:
            X, Z = park(A[pick], C[pick])
        except np.linalg.LinAlgError:
            continue
        gap = _gap(A, C, X, Z)
        cost = float(np.minimum(gap, AGREE).sum())
        if best is None or cost < best[0]:
            best = (cost, X, Z)
    assert best is not None
    good = _gap(A, C, best[1], best[2]) < AGREE
    if good.sum() >= LEAST_VIEWS:
        return park(A[good], C[good])
    return best[1], best[2]


def _gap(A: Poses, C: Poses, X: Pose, Z: Pose) -> Floats:
    """(n,) disagreement of each look [m]."""
    return _size(se3.logs(se3.inverses(X @ C) @ A @ Z))


def _size(twists: Floats) -> Floats:
    """(n,) metres, and 0.1 m times radians."""
    across = np.linalg.norm(twists[:, :3], axis=1)
    return np.asarray(across + 0.1 * np.linalg.norm(twists[:, 3:], axis=1))


def _jacobian(answer: PlugCalibration, joints: Floats, C: Poses) -> Floats:
    """(v, 6, 12 + size) of each look's residual by camera, plug and arm."""
    _, B = answer.errors.flange_poses(joints, answer.arm_errors)
    Z = answer.T_flange_plug
    J = np.zeros((len(joints), 6, 12 + B.shape[2]))
    J[:, :, :6] = -se3.adjoints(se3.inverses(C))
    J[:, :, 6:12] = np.eye(6)
    J[:, :, 12:] = se3.adjoints(se3.inverses(Z[None])) @ B
    return J


def _step(
    answer: PlugCalibration, joints: Floats, C: Poses, W: Floats, arm: bool
) -> tuple[PlugCalibration, float]:
    """One Gauss-Newton step with Huber's weights; looks beyond all reason do not count."""
    errors = answer.errors
    A, _ = errors.flange_poses(joints, answer.arm_errors)
    r = se3.logs(se3.inverses(answer.T_base_camera @ C) @ A @ answer.T_flange_plug)
    J = _jacobian(answer, joints, C)
    size = np.sqrt(np.einsum("vi,vij,vj->v", r, W, r))
    scale = max(float(np.median(size)) / 2.3, 1.0)  # 2.3: median of chi with six degrees
    used = size < 8.0 * scale
    weight = np.where(used, 1.0 / np.maximum(size / (3.5 * scale), 1.0), 0.0) / scale**2
    free = 12 + errors.size if arm else 12
    J = J[:, :, :free]
    H = np.einsum("v,via,vij,vjb->ab", weight, J, W, J)
    g = -np.einsum("v,via,vij,vj->a", weight, J, W, r)
    if arm:
        prior = 1.0 / errors.sigma**2
        H[12:, 12:] += np.diag(prior)
        g[12:] -= prior * answer.arm_errors
    x = np.linalg.solve(H, g)
    covariance = np.zeros((12 + errors.size, 12 + errors.size))
    covariance[:free, :free] = np.linalg.inv(H)
    moved = replace(
        answer,
        T_base_camera=answer.T_base_camera @ exp(x[:6]),
        T_flange_plug=answer.T_flange_plug @ exp(x[6:12]),
        arm_errors=answer.arm_errors + x[12:] if arm else answer.arm_errors,
        covariance=covariance,
        used=used,
        residual=r,
    )
    return moved, float(np.linalg.norm(x[:12]))


def choose_looks(
    answer: PlugCalibration,
    candidates: Floats,
    C: Poses,
    noise: Floats,
    targets: Floats,
    count: int,
    taken: Sequence[PlugLook] = (),
    seconds: Floats | None = None,
) -> list[int]:
    """The looks that make the tip surest, one after the other (greedy A-optimal design).

    Args:
        answer: what is believed now.
        candidates: (c, n) configurations [rad].
        C: (c, 4, 4) the plug in the camera there.
        noise: (c, 6, 6) covariance to be expected of each look.
        targets: (t, n) configurations at which the tip has to be right.
        count: how many to choose.
        taken: looks that tell something already.
        seconds: (c,) that each takes [s]: by how much the logarithm of the tip's variance falls
            counts per second; all alike if None.

    Returns:
        Indices of the chosen candidates, the most telling first.
    """
    gain, H = _gains(answer, candidates, C, noise), _known(answer, taken)
    goal, takes = _goal(answer, targets), np.ones(len(candidates)) if seconds is None else seconds
    chosen: list[int] = []
    for _ in range(min(count, len(candidates))):
        left = np.setdiff1d(np.arange(len(candidates)), chosen)
        told = np.log(_doubt(H[None], goal) / _doubt(H + gain[left], goal))
        chosen.append(int(left[np.argmax(told / takes[left])]))
        H = H + gain[chosen[-1]]
    return chosen


def _gains(answer: PlugCalibration, candidates: Floats, C: Poses, noise: Floats) -> Floats:
    """(c, m, m) the information that looks would bring."""
    J = _jacobian(answer, candidates, C)
    W = np.linalg.inv(noise + np.diag(REST_SIGMA**2))
    return np.asarray(J.transpose(0, 2, 1) @ W @ J)


def _known(answer: PlugCalibration, taken: Sequence[PlugLook]) -> Floats:
    """(m, m) the information that is there."""
    size = 12 + answer.errors.size
    H = np.zeros((size, size))
    H[12:, 12:] = np.diag(1.0 / answer.errors.sigma**2)
    H[:12, :12] = np.eye(12) * 1e2  # what a cold start knows: a decimetre, some degrees
    if taken:
        q = np.array([look.joints for look in taken])
        before = _jacobian(answer, q, np.array([look.T_camera_plug for look in taken]))
        H += np.einsum("via,vij,vjb->ab", before, _weights(taken), before)
    return H


def _goal(answer: PlugCalibration, targets: Floats) -> Floats:
    """(m, m) how much each unknown moves the tip at the targets."""
    inverse_camera = np.linalg.inv(answer.T_base_camera)
    at = np.array([inverse_camera @ answer.base_tip(q) for q in targets])
    Jt = _jacobian(answer, targets, at)[:, :3]
    return np.asarray(np.einsum("tia,tib->ab", Jt, Jt) / len(targets))


def _doubt(H: Floats, goal: Floats) -> Floats:
    """(c,) the tip's mean variance by (c, m, m) information [m^2]."""
    return np.asarray(np.trace(np.linalg.solve(H, goal[None]), axis1=1, axis2=2))
