"""Drift watch: says when a camera, the board or the robot's base was moved, from later sightings.

Every later sighting of the board (in passing, at rest) is compared with where the calibration puts
it, and turned into a motion of the camera that would explain it. The last few are combined, and
judged against everything that is not a motion: corner noise, the arm's repeatability, and what the
calibration itself did not know, carried through to these very poses. A camera that alone is off has
moved; all off alike means base, board or robot (docs/calibration.md).

No single sighting can blame anybody: a board seen wrongly by one square is left out of the sum in
turn, and the sightings must agree with one another on one motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy.special import chdtri

from armsight.arrays import Floats, Ints
from armsight.calibration import se3
from armsight.calibration.calibrate import Calibration
from armsight.calibration.model import Model, State
from armsight.calibration.problem import ArmView, Freedom, Problem, Sighting

Cause = Literal["camera", "board, base or robot"]


@dataclass(frozen=True)
class DriftOptions:
    """How sure to be.

    Attributes:
        window: sightings of a camera that are judged together, at most.
        agree: sightings that must agree before anybody is blamed, at least 2.
        false_alarm: probability that one judgement blames a camera that stands still.
        pose_noise: the arm's repeatability where the calibration has not found one
            (translation [m], rotation [rad]).
    """

    window: int = 6
    agree: int = 2
    false_alarm: float = 1e-7
    pose_noise: tuple[float, float] = (0.0001, 0.0002)


@dataclass(frozen=True)
class Drift:
    """Something has moved.

    Attributes:
        cause: a camera, or what all cameras share.
        cameras: their names.
        shift: estimated motion of the camera (or of the board) [m]; turn: [rad].
        message: in words, with what to do.
    """

    cause: Cause
    cameras: tuple[str, ...]
    shift: float
    turn: float
    message: str


@dataclass(frozen=True)
class _Motion:
    """What one sighting says of a camera's motion.

    Attributes:
        rest: number of the arm's rest in which it was made.
        information: (6, 6) about the motion; h: (6,) information times estimate.
        known: (6, g) how the estimate (times information) follows errors of the calibration.
    """

    rest: int
    information: Floats
    h: Floats
    known: Floats


@dataclass
class _Track:
    """Recent sightings of one camera (or of the board by all cameras), newest last."""

    motions: list[_Motion] = field(default_factory=list)

    def since(self, rest: int) -> list[_Motion]:
        """Those made in a rest or after it."""
        return [m for m in self.motions if m.rest >= rest]


@dataclass(frozen=True)
class Known:
    """What is held to be true, and how surely.

    Attributes:
        problem: rigs, lenses, boards and arm; its views and sightings are not looked at.
        state: value of everything; freedom: how the arm's errors enter.
        unknown: (g,) indices of the unknowns that are not sure; covariance: (g, g) of these.
        noise: usual standard deviation of a corner by lens [px].
        pose_noise: the arm's repeatability (translation [m], rotation [rad]), or None.
    """

    problem: Problem
    state: State
    freedom: Freedom
    unknown: Ints
    covariance: Floats
    noise: dict[int, float]
    pose_noise: tuple[float, float] | None = None


def known_from(calibration: Calibration) -> Known:
    """A solved calibration as what is held to be true."""
    solution = calibration.solution
    unknown: Ints = np.flatnonzero(solution.model.free)
    return Known(
        calibration.problem,
        solution.state,
        calibration.freedom,
        unknown,
        calibration.covariance.model[np.ix_(unknown, unknown)],
        calibration.corner_sigma(),
        calibration.freedom.white,
    )


class DriftWatch:
    """Feeds on sightings and says when the calibration no longer holds."""

    def __init__(self, known: Known, options: DriftOptions | None = None) -> None:
        self._known = known
        self._options = options or DriftOptions()
        self._pose_noise = known.pose_noise or self._options.pose_noise
        self.reset()

    def reset(self) -> None:
        """Forget all sightings, as after something was put back in place."""
        self._tracks = [_Track() for _ in self._known.problem.rigs]
        self._rested: list[tuple[int, ArmView, list[Sighting]]] = []
        self._rests = 0

    def add(self, view: ArmView, sightings: list[Sighting]) -> Drift | None:
        """Judge one pose of the resting arm, as all cameras that see the board saw it.

        Args:
            view: joints and controller's pose.
            sightings: their ``view`` is ignored.
        """
        sightings = [replace(s, view=0) for s in sightings]
        lenses = self._known.problem.lenses
        self._rests += 1
        for rig, track in enumerate(self._tracks):
            mine = [s for s in sightings if lenses[s.lens].rig == rig]
            if mine:
                track.motions.append(self._motion(rig, view, mine))
                del track.motions[: -self._options.window]
        if sightings:
            self._rested.append((self._rests, view, sightings))
            del self._rested[: -self._options.window]
        return self._judge()

    def _motion(
        self, rig: int | None, view: ArmView, sightings: list[Sighting], rest: int | None = None
    ) -> _Motion:
        """How a camera, or the board for None, seems to have moved, in its own axes."""
        held = self._known
        board = sightings[0].board
        sightings = [replace(s, sigma=held.noise.get(s.lens, s.sigma)) for s in sightings]
        problem = replace(held.problem, views=(view,), sightings=tuple(sightings))
        model = Model(problem, replace(held.freedom, white=None))
        start = replace(held.state, E=np.eye(4)[None])
        at = model.board_slice(board) if rig is None else model.rig_slice(rig)
        place = np.full(model.size, -1)
        place[held.unknown] = np.arange(len(held.unknown))
        t, r = self._pose_noise
        W = np.diag([1 / t**2] * 3 + [1 / r**2] * 3)
        total: Floats = np.zeros((1, 6))
        state, H, Q, weight = start, np.zeros((6, 6)), np.zeros((0, 6)), np.zeros(0)
        F = len(sightings)
        for turn in range(5):
            lin = model.linearise(state)
            K = lin.jacobian.shape[1]
            J = lin.jacobian.reshape(F * K * 2, -1)
            length = np.linalg.norm(lin.residual, axis=-1)
            # Single corners may be off by much, but not before the motion has been found.
            robust = 3.0 / np.maximum(length, 1e-12) if turn > 1 else np.ones_like(length)
            weight = np.repeat(np.minimum(1.0, robust).ravel(), 2)
            first = int(np.flatnonzero(model.columns[0] == at.start)[0])
            A, B = J[:, first : first + 6], J[:, -6:]
            # The arm's own error of this pose is eliminated: it may explain part of what is seen.
            Bw = B * weight[:, None]
            Q = A * weight[:, None] - Bw @ np.linalg.solve(Bw.T @ B + W, Bw.T @ A)
            H = Q.T @ A
            H += 1e-9 * np.diag(np.diag(H))
            step: Floats = np.asarray(-np.linalg.solve(H, Q.T @ lin.residual.reshape(-1)))[None]
            total = se3.logs(np.asarray(se3.exps(total) @ se3.exps(step)))
            state = _displaced(start, rig, board, total)
            if turn > 0 and length.max() < 3.0 and float((step @ H @ step.T)[0, 0]) < 1e-4:
                break  # nothing moved, no outlier: the usual case
        # An error d of the calibration shifts the estimate by -inv(H) Q^T J d.
        known = np.zeros((6, len(held.unknown)))
        rows = 2 * lin.jacobian.shape[1]
        for f in range(F):
            part = Q[f * rows : (f + 1) * rows].T @ lin.jacobian[f].reshape(rows, -1)
            columns = place[model.columns[f]]
            use = columns >= 0
            known[:, columns[use]] += part[:, : len(columns)][:, use]
        return _Motion(self._rests if rest is None else rest, H, H @ total[0], known)

    def _judge(self) -> Drift | None:
        """Who is to blame, if anybody; waits where it cannot be told yet."""
        watching = [r for r, track in enumerate(self._tracks) if track.motions]
        blamed = {
            r: found for r in watching if (found := self._agreed(self._tracks[r])) is not None
        }
        slip = self._slipped(watching)
        if not blamed and slip is None:
            return None
        begins = min([rest for _, rest in blamed.values()] + ([slip[1]] if slip else []))
        others = {r: self._witness(r, begins) for r in watching if r not in blamed}
        quiet = [r for r, off in others.items() if off is False]
        off = [r for r, off in others.items() if off is True]
        motions = {r: motion for r, (motion, _) in blamed.items()}
        if quiet:
            # A camera that sees the board where it should be speaks for board, base and arm.
            return self._camera(motions) if motions and not off else None
        if len(watching) == 1:
            return self._camera(motions) if motions else None
        if slip is not None and len(blamed) + len(off) == len(watching):
            return self._shared(slip[0], watching)
        if len(blamed) == len(watching):
            return self._shared(motions[watching[0]], watching)
        return None  # no witness yet, or one that has doubts: the next rests will tell

    def _slipped(self, watching: list[int]) -> tuple[Floats, int] | None:
        """The motion of the board that its last sightings by all cameras agree on."""
        bar = float(chdtri(6, self._options.false_alarm))
        last = [self._tracks[r].motions[-self._options.agree :] for r in watching]
        if not any(self._size(motions)[0] > bar for motions in last):
            return None  # nothing is off: spare the work
        board = [self._motion(None, view, seen, rest) for rest, view, seen in self._rested]
        return self._agreed(_Track(board))

    def _witness(self, rig: int, rest: int) -> bool | None:
        """Whether a camera has seen the board off since a rest; None if too seldom."""
        motions = self._tracks[rig].since(rest)
        if len(motions) < 2:
            return None
        return self._size(motions)[0] > float(chdtri(6, 1e-3))

    def _agreed(self, track: _Track) -> tuple[Floats, int] | None:
        """(6,) the motion that the last sightings agree on, and since which rest; or None."""
        options, motions = self._options, track.motions
        bar = float(chdtri(6, options.false_alarm))
        for count in range(options.agree, min(len(motions), options.window) + 1):
            recent = motions[-count:]
            size, mean = self._size(recent)
            if size <= bar:
                continue
            # None of them may be needed: what one sighting alone says may be a board seen wrongly.
            rest = ([m for m in recent if m is not left] for left in recent)
            if all(self._size(some)[0] > bar for some in rest) and self._agree(recent, mean):
                return mean, recent[0].rest
        return None

    def _size(self, motions: list[_Motion]) -> tuple[float, Floats]:
        """Squared size of the combined motion in its sigmas, and the motion."""
        C = np.linalg.inv(sum((m.information for m in motions), np.zeros((6, 6))))
        mean = C @ sum((m.h for m in motions), np.zeros(6))
        known = C @ sum((m.known for m in motions), np.zeros_like(motions[0].known))
        C = C + known @ self._known.covariance @ known.T
        return float(mean @ np.linalg.solve(C, mean)), np.asarray(mean, np.float64)

    def _agree(self, motions: list[_Motion], mean: Floats) -> bool:
        """Whether each sighting is within its own doubt of the common motion."""
        bar = 2.0 * float(chdtri(6, 1e-4))
        for m in motions:
            C = np.linalg.inv(m.information)
            off = C @ m.h - mean
            known = C @ m.known
            C = C + known @ self._known.covariance @ known.T
            if float(off @ np.linalg.solve(C, off)) > bar:
                return False
        return True

    def _camera(self, moved: dict[int, Floats]) -> Drift:
        worst = max(moved.values(), key=lambda m: float(np.linalg.norm(m[:3])))
        names = tuple(self._known.problem.rigs[r].name for r in moved)
        shift, turn, size = _words(worst)
        verb = "was" if len(names) == 1 else "were"
        return Drift(
            "camera",
            names,
            shift,
            turn,
            f"camera {' and '.join(names)} {verb} moved by about {size}; calibrate again before "
            "trusting it",
        )

    def _shared(self, motion: Floats, watching: list[int]) -> Drift:
        names = tuple(self._known.problem.rigs[r].name for r in watching)
        shift, turn, size = _words(motion)
        return Drift(
            "board, base or robot",
            names,
            shift,
            turn,
            f"all cameras see the board off ({size}): the board slipped on the flange, the robot's "
            "base was moved, or its zero is lost; tighten them and calibrate again",
        )


def _words(motion: Floats) -> tuple[float, float, str]:
    """Shift [m], turn [rad], and both in words."""
    shift, turn = float(np.linalg.norm(motion[:3])), float(np.linalg.norm(motion[3:]))
    return shift, turn, f"{1e3 * shift:.1f} mm and {np.rad2deg(turn):.2f} deg"


def _displaced(state: State, rig: int | None, board: int, twist: Floats) -> State:
    """A state in which a camera, or the board for None, was moved by a (1, 6) twist."""
    if rig is None:
        boards = state.T_mount_board.copy()
        boards[board] = boards[board] @ se3.exps(twist)[0]
        return replace(state, T_mount_board=boards)
    rigs = state.T_mount_rig.copy()
    rigs[rig] = rigs[rig] @ se3.exps(twist)[0]
    return replace(state, T_mount_rig=rigs)
