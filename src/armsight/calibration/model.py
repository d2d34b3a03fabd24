"""The measurement model: where a lens sees each corner, and how that moves with every unknown.

Corner k in view i through lens c, board on the flange (docs/calibration.md):

    pixel = project(lens_c, inv(T_rig_lens) inv(T_base_rig) FK(q_i, theta) E_i T_flange_board X_k)

A camera on the flange and a board on the base use the inverse of the arm's pose; a lens frame uses
a free pose instead of the arm. Every pose moves by ``T <- T exp(d)``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Floats, Ints, Mask, Poses
from armsight.calibration import se3
from armsight.calibration.problem import Freedom, Priors, Problem, labels_of, lens_vector
from armsight.calibration.projection import Chain, by_pose, moved, project, turned

SHAPE = 3  # print scale, bending along x, bending along y


@dataclass(frozen=True)
class State:
    """A value of every unknown.

    Attributes:
        lens: (L, 9) numbers of the lenses.
        T_rig_lens: (L, 4, 4).
        T_mount_rig: (R, 4, 4).
        time: (R,) camera clock minus arm clock [s].
        T_mount_board: (B, 4, 4).
        shape: (B, 3) print scale [1], bending along x and y at the edge [m].
        theta: (t,) the arm's errors.
        E: (V, 4, 4) error of each arm pose, or the free board's pose in a lens frame.
    """

    lens: Floats
    T_rig_lens: Poses
    T_mount_rig: Poses
    time: Floats
    T_mount_board: Poses
    shape: Floats
    theta: Floats
    E: Poses


@dataclass(frozen=True)
class Linearised:
    """Residuals and derivatives at a state, padded to the largest sighting.

    Attributes:
        residual: (F, K, 2) predicted minus seen over sigma; 0 where nothing was seen.
        jacobian: (F, K, 2, P + 6): P columns of global unknowns (see ``Model.columns``), then the
            view's pose error.
    """

    residual: Floats
    jacobian: Floats


class Model:
    """A problem made ready for the solver.

    Attributes:
        problem, freedom, priors: what it was made from.
        size: number G of global unknowns.
        free: (G,) which of them may move.
        labels: G names, for reports.
        columns: (F, P) global index of each local column of a sighting.
        view_of: (F,) view of each sighting.
        view_free: (V,) views whose pose error is an unknown.
        view_information: (V, 6, 6) prior about it (zero in lens frames).
    """

    def __init__(self, problem: Problem, freedom: Freedom, priors: Priors | None = None) -> None:
        self.problem, self.freedom = problem, freedom
        self.priors = priors or Priors()
        self._pad()
        self._index()
        self._views()
        self._prior_of_globals()

    # ------------------------------------------------------------------ layout

    def _pad(self) -> None:
        sightings = self.problem.sightings
        boards = self.problem.boards
        self.count = len(sightings)
        widest = max((len(s.corner) for s in sightings), default=0)
        F, K = self.count, widest
        self.points = np.zeros((F, K, 3))
        self.pixel = np.zeros((F, K, 2))
        self.sigma = np.ones(F)
        self.seen: Mask = np.zeros((F, K), bool)
        for f, s in enumerate(sightings):
            m = len(s.corner)
            self.points[f, :m] = boards[s.board].points[s.corner]
            self.pixel[f, :m] = s.pixel
            self.seen[f, :m] = True
            self.sigma[f] = s.sigma
        self.view_of: Ints = np.array([s.view for s in sightings], np.int64)
        self.lens_of: Ints = np.array([s.lens for s in sightings], np.int64)
        self.board_of: Ints = np.array([s.board for s in sightings], np.int64)
        rig_of_lens = np.array([lens.rig for lens in self.problem.lenses], np.int64)
        self.rig_of: Ints = rig_of_lens[self.lens_of] if F else np.zeros(0, np.int64)
        self._basis = np.zeros((F, K, 3, SHAPE))
        extents = [np.ptp(b.points, axis=0) / 2 for b in boards]
        centers = [(b.points.max(0) + b.points.min(0)) / 2 for b in boards]
        for f, b in enumerate(self.board_of):
            x = self.points[f]
            half = np.maximum(extents[b][:2], 1e-9)
            unit = (x[:, :2] - centers[b][:2]) / half
            self._basis[f, :, :2, 0] = x[:, :2]
            self._basis[f, :, 2, 1:] = unit**2 - 1 / 3

    def _index(self) -> None:
        problem = self.problem
        L, R, B = len(problem.lenses), len(problem.rigs), len(problem.boards)
        t = problem.robot.size if problem.robot is not None else 0
        self._at_lens = 0
        self._at_offset = 9 * L
        self._at_rig = self._at_offset + 6 * L
        self._at_time = self._at_rig + 6 * R
        self._at_board = self._at_time + R
        self._at_shape = self._at_board + 6 * B
        self._at_theta = self._at_shape + SHAPE * B
        self.size = self._at_theta + t
        self._thetas = t

        F = self.count
        parts = [
            self._at_lens + 9 * self.lens_of[:, None] + np.arange(9),
            self._at_offset + 6 * self.lens_of[:, None] + np.arange(6),
            self._at_rig + 6 * self.rig_of[:, None] + np.arange(6),
            self._at_time + self.rig_of[:, None] + np.arange(1),
            self._at_board + 6 * self.board_of[:, None] + np.arange(6),
            self._at_shape + SHAPE * self.board_of[:, None] + np.arange(SHAPE),
            np.broadcast_to(self._at_theta + np.arange(t), (F, t)),
        ]
        self.columns: Ints = np.concatenate(parts, axis=1).astype(np.int64)

        self.labels: tuple[str, ...] = labels_of(problem)

        views = problem.views
        arm_frame = np.array([not v.free for v in views], bool)[self.view_of]
        moves = np.array(
            [
                (problem.rigs[r].mount == "base") != (problem.boards[b].mount == "base")
                for r, b in zip(self.rig_of, self.board_of)
            ],
            bool,
        )
        arm_frame_moves = arm_frame & moves if F else np.zeros(0, bool)
        self._forward = np.array(  # the arm's pose as it is, or inverted, or not at all
            [
                (0 if not a else (1 if problem.rigs[r].mount == "base" else -1))
                for a, r in zip(arm_frame_moves, self.rig_of)
            ],
            int,
        ).reshape(F)
        self._free_frame = ~arm_frame

        free = np.zeros(self.size, bool)
        touched_lens = set(self.lens_of.tolist())
        for index, lens in enumerate(problem.lenses):
            if index not in touched_lens:
                continue
            if self.freedom.lens and not lens.keep:
                free[9 * index : 9 * index + 9] = True
            if lens.offset_free:
                free[self._at_offset + 6 * index : self._at_offset + 6 * index + 6] = True
        tied = arm_frame
        for r in set(self.rig_of[tied].tolist()):
            free[self._at_rig + 6 * r : self._at_rig + 6 * r + 6] = True
            free[self._at_time + r] = self.freedom.time
        for b in set(self.board_of[tied].tolist()):
            free[self._at_board + 6 * b : self._at_board + 6 * b + 6] = True
        if self.freedom.shape:
            for b in set(self.board_of.tolist()):
                free[self._at_shape + SHAPE * b : self._at_shape + SHAPE * (b + 1)] = True
        if self.freedom.robot and t:
            free[self._at_theta :] = bool(np.any(arm_frame_moves))
        self.free: Mask = free

    def _views(self) -> None:
        problem, V = self.problem, len(self.problem.views)
        self._joints = None
        if problem.robot is not None:
            missing = [i for i, v in enumerate(problem.views) if not v.free and v.joints is None]
            if missing:
                raise ValueError(f"a robot model needs joint angles; view {missing[0]} has none")
            n = problem.robot.robot.n
            self._joints = np.array([np.zeros(n) if v.free else v.joints for v in problem.views])
        self._nominal = np.array([v.T_base_flange for v in problem.views]).reshape(V, 4, 4)
        self._twist = np.array([v.twist for v in problem.views]).reshape(V, 6)
        self._held = np.array([v.free for v in problem.views], bool)
        self.view_information = np.zeros((V, 6, 6))
        moved = np.zeros(V, bool)
        moved[self.view_of[self._forward != 0]] = True
        used = np.zeros(V, bool)
        used[self.view_of] = True
        self.view_free = self._held & used
        if self.freedom.white is not None:
            t, r = self.freedom.white
            W = np.diag([1 / t**2] * 3 + [1 / r**2] * 3)
            self.view_free = self.view_free | (moved & ~self._held)
            self.view_information[moved & ~self._held] = W

    def _prior_of_globals(self) -> None:
        problem = self.problem
        H = np.zeros((self.size, self.size))
        for index, lens in enumerate(problem.lenses):
            if lens.prior is not None:
                at = slice(9 * index, 9 * index + 9)
                H[at, at] += lens.prior
        for b in range(len(problem.boards)):
            first = self._at_shape + SHAPE * b
            for k, sigma in enumerate(
                (self.priors.board_scale, self.priors.board_warp, self.priors.board_warp)
            ):
                H[first + k, first + k] += 1 / sigma**2
        for r in range(len(problem.rigs)):
            H[self._at_time + r, self._at_time + r] += 1 / self.priors.time**2
        if problem.robot is not None:
            at_theta = np.arange(self._at_theta, self.size)
            H[at_theta, at_theta] += 1 / problem.robot.sigma**2
        self.prior_information = H
        self._prior_lens = np.array([lens_vector(lens.camera) for lens in problem.lenses])

    # ------------------------------------------------------------------ slices

    def lens_slice(self, lens: int) -> slice:
        """Where a lens's nine numbers stand among the global unknowns."""
        return slice(9 * lens, 9 * lens + 9)

    def offset_slice(self, lens: int) -> slice:
        """Where a lens's pose in its rig stands."""
        return slice(self._at_offset + 6 * lens, self._at_offset + 6 * lens + 6)

    def rig_slice(self, rig: int) -> slice:
        """Where a rig's pose stands."""
        return slice(self._at_rig + 6 * rig, self._at_rig + 6 * rig + 6)

    def board_slice(self, board: int) -> slice:
        """Where a board's pose stands."""
        return slice(self._at_board + 6 * board, self._at_board + 6 * board + 6)

    def shape_slice(self, board: int) -> slice:
        """Where a board's print scale and bending stand."""
        return slice(self._at_shape + SHAPE * board, self._at_shape + SHAPE * (board + 1))

    @property
    def theta_slice(self) -> slice:
        """Where the arm's errors stand."""
        return slice(self._at_theta, self.size)

    # ------------------------------------------------------------------ values

    def start(self) -> State:
        """The problem's start values."""
        problem = self.problem
        L, R, B = len(problem.lenses), len(problem.rigs), len(problem.boards)
        E = np.broadcast_to(np.eye(4), (len(problem.views), 4, 4)).copy()
        E[self._held] = self._nominal[self._held]
        return State(
            self._prior_lens.copy(),
            np.array([lens.T_rig_lens for lens in problem.lenses]).reshape(L, 4, 4),
            np.array([rig.T_mount_rig for rig in problem.rigs]).reshape(R, 4, 4),
            np.zeros(R),
            np.array([b.T_mount_board for b in problem.boards]).reshape(B, 4, 4),
            np.zeros((B, SHAPE)),
            np.zeros(self._thetas),
            E,
        )

    def retract(self, state: State, step: Floats, view_step: Floats) -> State:
        """The state moved by (G,) global and (V, 6) view steps."""
        at = self
        L, R, B = len(state.lens), len(state.T_mount_rig), len(state.T_mount_board)
        return State(
            state.lens + step[: at._at_offset].reshape(L, 9),
            state.T_rig_lens @ se3.exps(step[at._at_offset : at._at_rig].reshape(L, 6)),
            state.T_mount_rig @ se3.exps(step[at._at_rig : at._at_time].reshape(R, 6)),
            state.time + step[at._at_time : at._at_board],
            state.T_mount_board @ se3.exps(step[at._at_board : at._at_shape].reshape(B, 6)),
            state.shape + step[at._at_shape : at._at_theta].reshape(B, SHAPE),
            state.theta + step[at._at_theta :],
            state.E @ se3.exps(view_step),
        )

    def prior_residual(self, state: State) -> Floats:
        """(G,) unknowns minus what the priors expect (zero where there is no prior)."""
        d = np.zeros(self.size)
        d[: self._at_offset] = (state.lens - self._prior_lens).ravel()
        d[self._at_time : self._at_board] = state.time
        d[self._at_shape : self._at_theta] = state.shape.ravel()
        d[self._at_theta :] = state.theta
        return d

    def arm_poses(self, state: State) -> tuple[Poses, Floats]:
        """(V, 4, 4) ``FK(q, theta) E`` and (V, 6, t) how theta turns it (body twist)."""
        if self.problem.robot is None or self._joints is None:
            return self._nominal @ state.E, np.zeros((len(self._nominal), 6, 0))
        poses, B = self.problem.robot.flange_poses(self._joints, state.theta)
        return poses @ state.E, se3.adjoints(se3.inverses(state.E)) @ B

    # ------------------------------------------------------------------ prediction

    def _chain(self, state: State) -> Chain:
        """Every corner from its board to its lens."""
        arm, B_theta = self.arm_poses(state)
        v, c, r, b = self.view_of, self.lens_of, self.rig_of, self.board_of
        late = se3.exps(self._twist[v] * state.time[r][:, None])
        arm_v = arm[v] @ late
        held = self._free_frame[:, None, None]
        forward = self._forward[:, None, None]
        T_board = np.where(held, np.eye(4), state.T_mount_board[b])
        arm_v = np.where(forward == -1, se3.inverses(arm_v), arm_v)
        T_arm = np.where(held, state.E[v], np.where(forward == 0, np.eye(4), arm_v))
        # A lens frame belongs to its rig's mount frame as well, so that two cameras share it.
        T_rig_mount = se3.inverses(state.T_mount_rig)[r]
        T_lens_rig = se3.inverses(state.T_rig_lens)[c]
        X = self.points + np.einsum("fkij,fj->fki", self._basis, state.shape[b])
        at_arm = moved(T_board, X)
        at_mount = moved(T_arm, at_arm)
        at_rig = moved(T_rig_mount, at_mount)
        at_lens = moved(T_lens_rig, at_rig)
        return Chain(
            T_board, T_arm, T_rig_mount, T_lens_rig, late, B_theta,
            X, at_arm, at_mount, at_rig, at_lens,
        )  # fmt: skip

    def linearise(self, state: State, derivatives: bool = True) -> Linearised:
        """Whitened residuals and their derivatives at a state."""
        F, K = self.seen.shape
        chain = self._chain(state)
        lens = state.lens[self.lens_of]
        pixel, d_point, d_lens = project(chain.at_lens, lens, derivatives)
        weight = self.seen / self.sigma[:, None]
        residual = np.where(self.seen[..., None], pixel - self.pixel, 0.0) * weight[..., None]
        if not derivatives:
            return Linearised(residual, np.empty((F, K, 2, 0)))

        # What a motion of each frame does to the pixels: rows of d_point, turned into that frame.
        by_lens = d_point * weight[..., None, None]
        by_rig = turned(by_lens, chain.T_lens_rig[:, :3, :3])
        by_mount = turned(by_rig, chain.T_rig_mount[:, :3, :3])
        by_arm = turned(by_mount, chain.T_arm[:, :3, :3])
        by_board = turned(by_arm, chain.T_board[:, :3, :3])
        held, tied = self._free_frame, ~self._free_frame
        ahead, back = held | (self._forward == 1), tied & (self._forward == -1)
        step = np.zeros((F, K, 2, 6))  # at the flange, after the time shift
        step[ahead] = by_pose(by_arm[ahead], chain.at_arm[ahead])
        step[back] = -by_pose(by_mount[back], chain.at_mount[back])

        J = np.zeros((F, K, 2, self.columns.shape[1] + 6))
        J[..., :9] = d_lens * weight[..., None, None]
        J[..., 9:15] = -by_pose(by_lens, chain.at_lens)
        J[..., 15:21] = -by_pose(by_rig, chain.at_rig)
        J[tied, ..., 22:28] = by_pose(by_board[tied], chain.X[tied])
        J[..., 28:31] = by_board @ self._basis
        speed = self._twist[self.view_of]
        if speed.any():
            J[tied, ..., 21] = np.einsum("fkil,fl->fki", step[tied], speed[tied])
            # E and theta act before the time shift.
            step[tied] = turned(step[tied], se3.adjoints(se3.inverses(chain.late[tied])))
        if self._thetas:
            J[tied, ..., 31:-6] = turned(step[tied], chain.B_theta[self.view_of[tied]])
        J[..., -6:] = step
        return Linearised(residual, J)

    def lens_points(self, state: State) -> Floats:
        """(F, K, 3) corners in the frame of the lens that saw them [m]."""
        return self._chain(state).at_lens

    def with_exact_views(self, state: State) -> State:
        """The state with every arm pose's own error set to nothing: what a new view would see."""
        E = state.E.copy()
        E[~self._held] = np.eye(4)
        return replace(state, E=E)
