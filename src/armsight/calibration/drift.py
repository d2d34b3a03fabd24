"""Drift watch: says when a camera, the board or the robot's base was moved, from later sightings.

Every later sighting of the board (in passing, at rest) is compared with where the calibration puts
it. A camera that alone is off has moved; all off alike means base, board or robot. Two tests run:
one sighting far outside its ellipse, three in a row as confirmation; and a running mean of the
errors that grows where noise would cancel (design page, 5.9).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy import stats

from armsight.arrays import Floats, Pose
from armsight.calibration import se3
from armsight.calibration.calibrate import Calibration
from armsight.calibration.covariance import Covariance
from armsight.calibration.model import Model
from armsight.calibration.problem import ArmView, Freedom, Sighting

Cause = Literal["camera", "board, base or robot"]


@dataclass(frozen=True)
class DriftOptions:
    """How sure to be.

    Attributes:
        window: sightings of a camera that are judged together.
        false_alarm: probability that a judgement blames a camera that stands still.
        agree: sightings in a row that must agree.
        pose_noise: the arm's own error between views (translation [m], rotation [rad]), beside what
            the calibration found; absolute errors of the arm live here.
    """

    window: int = 6
    false_alarm: float = 1e-7
    agree: int = 3
    pose_noise: tuple[float, float] = (0.0003, 0.0004)


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


@dataclass
class _Track:
    """Recent sightings of one camera: each one's estimate of how the camera moved."""

    twists: list[Floats] = field(default_factory=list)
    information: list[Floats] = field(default_factory=list)
    off: int = 0


class DriftWatch:
    """Feeds on sightings and says when the calibration no longer holds."""

    def __init__(self, calibration: Calibration, options: DriftOptions | None = None) -> None:
        self._calibration = calibration
        self._options = options or DriftOptions()
        self._tracks = [_Track() for _ in calibration.problem.rigs]

    def reset(self) -> None:
        """Forget all sightings, after a new calibration."""
        self._tracks = [_Track() for _ in self._tracks]

    def add(self, view: ArmView, sightings: list[Sighting]) -> Drift | None:
        """Judge one pose of the resting arm, as all cameras that see the board saw it.

        Args:
            view: joints and controller's pose.
            sightings: their ``view`` is ignored.
        """
        seen: list[int] = []
        for rig in range(len(self._tracks)):
            mine = [
                replace(s, view=0)
                for s in sightings
                if self._calibration.problem.lenses[s.lens].rig == rig
            ]
            if not mine:
                continue
            twist, information = self._motion(rig, view, mine)
            track = self._tracks[rig]
            track.twists.append(twist)
            track.information.append(information)
            del track.twists[: -self._options.window]
            del track.information[: -self._options.window]
            seen.append(rig)
        return self._judge(seen)

    def _motion(self, rig: int, view: ArmView, sightings: list[Sighting]) -> tuple[Floats, Floats]:
        """(6,) how the camera seems to have moved, and (6, 6) information about it."""
        calibration = self._calibration
        problem = replace(calibration.problem, views=(view,), sightings=tuple(sightings))
        model = Model(problem, Freedom(lens=False, shape=False, white=None))
        state = replace(calibration.solution.state, E=np.eye(4)[None])
        at = model.rig_slice(rig)
        columns = np.arange(at.start, at.stop)
        local = [int(np.flatnonzero(model.columns[0] == c)[0]) for c in columns]
        t, r = self._options.pose_noise
        W = np.diag([1 / t**2] * 3 + [1 / r**2] * 3)
        total = np.zeros(6)
        H = np.zeros((6, 6))
        for _ in range(3):
            lin = model.linearise(state)
            F = len(sightings)
            J = lin.jacobian.reshape(F * lin.jacobian.shape[1] * 2, -1)
            e = lin.residual.reshape(-1)
            A, B = J[:, local], J[:, -6:]
            # The arm's own error of this pose is eliminated: it may explain part of what is seen.
            M = B.T @ B + W
            K = np.linalg.solve(M, B.T)
            Q = A - B @ (K @ A)
            H = A.T @ Q
            g = Q.T @ e
            step = -np.linalg.solve(H + 1e-9 * np.diag(np.diag(H)), g)
            total = total + step
            full = np.zeros(model.size)
            full[columns] = step
            state = model.retract(state, full, np.zeros((1, 6)))
        return total, H

    def _judge(self, seen: list[int]) -> Drift | None:
        options = self._options
        bar = float(stats.chi2.isf(options.false_alarm, 6))
        moved: dict[int, Floats] = {}
        for rig in seen:
            track = self._tracks[rig]
            recent = min(len(track.twists), options.agree)
            H = sum(track.information[-recent:], np.zeros((6, 6)))
            h = sum(
                (i @ x for i, x in zip(track.information[-recent:], track.twists[-recent:])),
                np.zeros(6),
            )
            mean = np.linalg.solve(H + 1e-9 * np.diag(np.diag(H)), h)
            # What the calibration itself did not know is no motion.
            C = np.linalg.inv(H + 1e-9 * np.diag(np.diag(H))) + self._known(rig)
            size = float(mean @ np.linalg.solve(C, mean))
            track.off = track.off + 1 if size > bar else 0
            if track.off >= 1 and recent >= options.agree:
                moved[rig] = np.asarray(mean, np.float64)
        if not moved:
            return None
        return self._say(moved, seen)

    def _known(self, rig: int) -> Floats:
        """Covariance that the calibration states, less what all cameras share."""
        covariance: Covariance = self._calibration.covariance
        return covariance.camera_pose(rig)

    def _say(self, moved: dict[int, Floats], seen: list[int]) -> Drift:
        names = tuple(self._calibration.problem.rigs[r].name for r in moved)
        worst = max(moved, key=lambda r: float(np.linalg.norm(moved[r][:3])))
        shift = float(np.linalg.norm(moved[worst][:3]))
        turn = float(np.linalg.norm(moved[worst][3:]))
        size = f"{1e3 * shift:.1f} mm and {np.rad2deg(turn):.2f} deg"
        watching = [r for r in range(len(self._tracks)) if len(self._tracks[r].twists)]
        if len(moved) == len(watching) and len(watching) > 1 and self._alike(moved):
            return Drift(
                "board, base or robot",
                names,
                shift,
                turn,
                f"all cameras see the board off alike ({size}): the board slipped on the flange, "
                "the robot's base was moved, or its zero is lost; tighten them and calibrate again",
            )
        which = " and ".join(names)
        return Drift(
            "camera",
            names,
            shift,
            turn,
            f"camera {which} was moved by about {size}; calibrate again before trusting it",
        )

    def _alike(self, moved: dict[int, Floats]) -> bool:
        """Whether the cameras' seeming motions are one motion of what they look at."""
        poses = {r: self._calibration.camera_pose(r) for r in moved}
        in_base = [
            poses[r] @ se3.exps(x[None])[0] @ np.linalg.inv(poses[r]) for r, x in moved.items()
        ]
        logs = se3.logs(np.array(in_base))
        spread = np.linalg.norm(logs - logs.mean(0), axis=1).max()
        return bool(spread < 0.5 * np.linalg.norm(logs.mean(0)))


def moved_camera(calibration: Calibration, rig: int, twist: Floats) -> Pose:
    """Where a camera stands after a motion in its own axes (for experiments)."""
    return np.asarray(calibration.camera_pose(rig) @ se3.exps(twist[None])[0])
