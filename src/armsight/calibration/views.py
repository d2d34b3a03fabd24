"""Where to look next: the view that most lowers the expected error, per second of robot time.

A view's information about cameras, lenses, board and arm, with its own pose error eliminated, adds
to what is known; no data are needed to compute it, only where everything roughly is. So candidates
that are reachable and free are ranked by how much they would lower the squared target error over
the user's volume, over all cameras that would see them (docs/calibration.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs

from armsight.arrays import Floats, Ints, JointPath, JointVector, Mask, Pose, Poses
from armsight.calibration import arm, se3
from armsight.calibration.calibrate import target_points
from armsight.calibration.covariance import invert, point_derivatives
from armsight.calibration.model import Model, State
from armsight.calibration.problem import (
    ArmView,
    Freedom,
    Priors,
    Problem,
    Sighting,
    lens_from_vector,
)
from armsight.calibration.projection import project
from armsight.calibration.solver import NormalEquations, Solution, normal_equations
from armsight.robots.robot import Robot

FreeCheck = Callable[[JointVector], bool]
"""Whether the arm may stand at (n,) joint angles."""


@dataclass(frozen=True)
class Candidates:
    """Views that could be taken.

    Attributes:
        joints: (c, n) [rad].
        information: (c, g, g) that each would add about the free unknowns.
        sees: (c, L) which lenses would see the board.
    """

    joints: JointPath
    information: Floats
    sees: Mask

    def only(self, index: Ints) -> Candidates:
        """Some of them."""
        return Candidates(self.joints[index], self.information[index], self.sees[index])


def board_in_view(
    problem: Problem,
    state: State,
    flanges: Poses,
    lens: int,
    margin: float = 4.0,
    slant: float = np.deg2rad(55),
    least_square: float = 7.0,
    board: int = 0,
) -> tuple[Mask, Floats]:
    """Whether a lens would see the whole board well.

    Args:
        problem: with the board and lenses.
        state: present estimate.
        flanges: (v, 4, 4) ``T_base_flange``.
        lens: index.
        margin: to the image's edge [px].
        slant: greatest angle of incidence [rad].
        least_square: shortest distance of neighbouring corners [px].
        board: index.

    Returns:
        (v,) answers, and (v, k, 2) predicted pixels.
    """
    definition = problem.lenses[lens]
    rig = problem.rigs[definition.rig]
    T_mount_lens = state.T_mount_rig[definition.rig] @ state.T_rig_lens[lens]
    M = flanges if rig.mount == "base" else se3.inverses(flanges)
    T = se3.inverses(T_mount_lens[None]) @ M @ state.T_mount_board[board]
    X = problem.boards[board].points
    p = X @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    pixel, _, _ = project(p, np.broadcast_to(state.lens[lens], (len(p), 9)), False)
    camera = definition.camera
    # A wide-angle polynomial folds back far outside the image: the ray itself must be inside.
    reach = 1.15 * np.hypot(camera.width, camera.height) / (2 * camera.fx)
    ahead = p[..., 2].min(1) > 0.25
    radius = np.linalg.norm(p[..., :2], axis=-1) / np.maximum(p[..., 2], 1e-6)
    inside = (
        ahead
        & (radius.max(1) < reach)
        & (pixel.min((1, 2)) > margin)
        & (pixel[..., 0].max(1) < camera.width - 1 - margin)
        & (pixel[..., 1].max(1) < camera.height - 1 - margin)
    )
    toward = p.mean(1)
    toward /= np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-12)
    facing = np.einsum("vi,vi->v", T[:, :3, 2], toward)
    gaps = np.linalg.norm(np.diff(pixel, axis=1), axis=-1).min(1)
    return inside & (facing > np.cos(slant)) & (gaps > least_square), pixel


def propose(
    problem: Problem,
    state: State,
    robot: Robot,
    rng: np.random.Generator,
    count: int,
    free: FreeCheck | None = None,
    near: JointVector | None = None,
    distance: tuple[float, float] = (0.55, 1.5),
    tilt: float = np.deg2rad(42),
    limits: dict[int, Floats] | None = None,
    margin: float = 10.0,
) -> JointPath:
    """Reachable configurations that show the board somewhere in some camera's image.

    Args:
        problem: cameras, lenses, boards.
        state: where they roughly are.
        robot: the arm.
        rng: draws.
        count: wanted; fewer may be found.
        free: whether the arm may stand there.
        near: start of the search for joint angles; home if None.
        distance: range from the camera [m].
        tilt: greatest tilt [rad].
        limits: of a rig, (3,) greatest roll, pitch, yaw found by tilting [rad].
        margin: to the image's edge [px].

    Returns:
        (c, n) joint angles [rad].
    """
    found: list[Floats] = []
    total = 0
    board = problem.boards[0].points
    middle = 0.5 * (board.max(0) + board.min(0))
    T_middle = np.eye(4)
    T_middle[:3, 3] = -middle
    T_flange_board = state.T_mount_board[0]
    used = list(range(len(problem.lenses)))
    for _ in range(8):
        if total >= count:
            break
        n = max(2 * (count - total), 24)
        targets = np.empty((n, 4, 4))
        for k in range(n):
            lens = used[int(rng.integers(len(used)))]
            definition = problem.lenses[lens]
            camera = lens_from_vector(
                state.lens[lens], definition.camera.width, definition.camera.height
            )
            u = rng.uniform(0.06, 0.94, 2) * [camera.width - 1, camera.height - 1]
            ray = np.append(camera.normalise(u[None])[0], 1.0)
            z = rng.uniform(*distance)
            T = np.eye(4)
            T[:3, 3] = ray * z
            axis = rng.normal(size=2)
            axis /= np.linalg.norm(axis)
            angle = rng.uniform(0.15, 1.0) * tilt
            roll = rng.uniform(-0.8, 0.8)
            if limits is not None and definition.rig in limits:
                lim = limits[definition.rig]
                angle = min(angle, float(lim[1:].max()))
                roll = float(np.clip(roll, -lim[0], lim[0]))
            turn = se3.exps(np.array([[0, 0, 0, *(axis * angle), 0], [0, 0, 0, 0, 0, roll]]))
            T_base_lens = state.T_mount_rig[definition.rig] @ state.T_rig_lens[lens]
            targets[k] = (
                T_base_lens
                @ T
                @ turn[0]
                @ turn[1]
                @ T_middle
                @ se3.inverses(T_flange_board[None])[0]
            )
        inside = np.linalg.norm(targets[:, :3, 3], axis=1) < 1.05 * robot.reach
        targets = targets[inside]
        if not len(targets):
            continue
        start = robot.home if near is None else near
        q = np.tile(start, (len(targets), 1)) + rng.normal(0, 0.3, (len(targets), robot.n))
        q, ok = arm.reach(robot, targets, q)
        q = q[ok]
        if not len(q):
            continue
        flanges = arm.flange_poses(robot, q)
        seen = np.zeros(len(q), bool)
        for lens in used:
            seen |= board_in_view(problem, state, flanges, lens, margin)[0]
        q = q[seen]
        if free is not None and len(q):
            q = q[[free(x) for x in q]]
        found.append(q)
        total += len(q)
    return np.concatenate(found)[:count] if found else np.zeros((0, robot.n))


def information(
    problem: Problem,
    state: State,
    freedom: Freedom,
    robot: Robot,
    joints: JointPath,
    priors: Priors | None = None,
    margin: float = 10.0,
    sigma: dict[int, float] | None = None,
) -> Candidates:
    """What each of (c, n) configurations would teach about the free unknowns of a problem."""
    flanges = arm.flange_poses(robot, joints)
    sightings: list[Sighting] = []
    sees = np.zeros((len(joints), len(problem.lenses)), bool)
    corners = np.arange(len(problem.boards[0].points))
    for lens in range(len(problem.lenses)):
        sees[:, lens], pixel = board_in_view(problem, state, flanges, lens, margin)
        noise = (sigma or {}).get(lens, 0.15)
        sightings += [
            Sighting(int(v), lens, 0, corners, pixel[v], noise)
            for v in np.flatnonzero(sees[:, lens])
        ]
    views = tuple(ArmView(T, q) for T, q in zip(flanges, joints))
    trial = replace(problem, views=views, sightings=tuple(sightings))
    full = Model(problem, freedom, priors)
    g = int(full.free.sum())
    out = np.zeros((len(joints), g, g))
    if not sightings:
        return Candidates(joints, out, sees)
    model = Model(trial, freedom, priors)
    here = replace(state, E=np.tile(np.eye(4), (len(views), 1, 1)))
    lin = model.linearise(here)
    F, K = model.seen.shape
    J = lin.jacobian.reshape(F, 2 * K, -1)
    # Columns of the whole problem's free unknowns, for every view at once.
    place = np.full(model.size, -1)
    place[np.flatnonzero(full.free)] = np.arange(g)
    P = model.columns.shape[1]
    local: Ints = place[model.columns]
    for v in range(len(joints)):
        mine = np.flatnonzero(model.view_of == v)
        if not len(mine):
            continue
        A = np.zeros((len(mine) * 2 * K, g + 6))
        for row, f in enumerate(mine):
            at = slice(row * 2 * K, (row + 1) * 2 * K)
            use = local[f] >= 0
            A[at, local[f][use]] = J[f][:, :P][:, use]
            A[at, g:] = J[f][:, P:]
        N = A.T @ A
        H = N[:g, :g]
        if model.view_free[v]:
            H = H - N[:g, g:] @ np.linalg.solve(N[g:, g:] + model.view_information[v], N[g:, :g])
        out[v] = H
    return Candidates(joints, out, sees)


def target_weight(solution: Solution, free: Ints, lenses: tuple[int, ...] | None = None) -> Floats:
    """(g, g) so that trace(weight @ covariance) is the mean squared target error [m^2]."""
    problem = solution.model.problem
    chosen = tuple(range(len(problem.lenses))) if lenses is None else lenses
    total = np.zeros((len(free), len(free)))
    for lens in chosen:
        pixels, z = target_points(problem.lenses[lens].camera)
        D = point_derivatives(solution, lens, pixels, z)[:, :, free].reshape(-1, len(free))
        total += D.T @ D / len(z)
    return total / max(len(chosen), 1)


@dataclass(frozen=True)
class Choice:
    """The next view.

    Attributes:
        index: of the candidate.
        expected: target error after it [m]; present: target error now [m].
        seconds: travel and look.
    """

    index: int
    expected: float
    present: float
    seconds: float


def choose(
    S: Floats,
    weight: Floats,
    candidates: Candidates,
    seconds: Floats,
    patience: float = 1.0,
) -> Choice:
    """The candidate that lowers the squared target error most, per second.

    Args:
        S: (g, g) information that there is.
        weight: (g, g) of :func:`target_weight`.
        candidates: what could be added.
        seconds: (c,) robot time of each [s].
        patience: power of the time: 0 ignores it.
    """
    scale = 1 / np.sqrt(np.maximum(np.diagonal(S), 1e-300))
    W = weight * scale[:, None] * scale
    Sn = S * scale[:, None] * scale + 1e-12 * np.eye(len(S))
    now = float(np.trace(np.linalg.solve(Sn, W)))
    values, axes = np.linalg.eigh(W)
    root = axes * np.sqrt(np.maximum(values, 0.0))  # W = root @ root.T
    root = root[:, values > 1e-12 * max(values[-1], 1e-300)]
    total = Sn + candidates.information * scale[:, None] * scale
    after = np.array([_trace_of_solution(T, root) for T in total])
    gain = (now - after) / seconds**patience
    best = int(np.argmax(gain))
    return Choice(
        best,
        float(np.sqrt(max(after[best], 0.0))),
        float(np.sqrt(max(now, 0.0))),
        float(seconds[best]),
    )


def _trace_of_solution(S: Floats, root: Floats) -> float:
    """Trace of ``inv(S) @ root @ root.T``, by Cholesky: the inverse takes ten times as long."""
    L, failed = dpotrf(S, lower=1)
    if failed:
        return float(np.trace(np.linalg.lstsq(S, root @ root.T, rcond=None)[0]))
    solved, _ = dtrtrs(L, root, lower=1)
    return float(np.sum(solved * solved))


def travel_seconds(
    robot: Robot, start: JointVector, joints: JointPath, speed: float, acceleration: float
) -> Floats:
    """(c,) time of straight joint moves from a start, by trapezoids of the slowest joint [s]."""
    way = np.abs(joints - start)
    v, a = robot.limits.velocity * speed, robot.limits.acceleration * acceleration
    ramp = v * v / a
    t = np.where(way > ramp, way / v + v / a, 2 * np.sqrt(way / a))
    return np.asarray(t.max(1))


def reduced_information(solution: Solution) -> tuple[Floats, NormalEquations]:
    """(g, g) information of a solution's free unknowns, and its normal equations."""
    return solution.normal.reduced(), solution.normal


def expected_error(S: Floats, weight: Floats) -> float:
    """Target error [m] with information S."""
    return float(np.sqrt(max(np.trace(invert(S) @ weight), 0.0)))


def truth_bound(
    problem: Problem, state: State, freedom: Freedom, priors: Priors | None = None
) -> Floats:
    """(g, g) covariance that no unbiased estimate can beat, at the truth (Cramer-Rao).

    Args:
        problem: with the true noise of corners.
        state: the truth.
        freedom: the unknowns, with the true size of pose errors.
        priors: that the truth was drawn from.
    """
    model = Model(problem, freedom, priors)
    normal, _ = normal_equations(model, state, np.inf)
    out = np.zeros((model.size, model.size))
    out[np.ix_(normal.free, normal.free)] = invert(normal.reduced())
    return out


__all__ = [
    "Candidates",
    "Choice",
    "Pose",
    "board_in_view",
    "choose",
    "expected_error",
    "information",
    "propose",
    "reduced_information",
    "target_weight",
    "travel_seconds",
    "truth_bound",
]
