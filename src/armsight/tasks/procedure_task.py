"""A task that carries out a calibration procedure: its wishes become intents, frames its pictures.

A procedure is a generator that yields where the arm shall rest (:class:`MoveTo`) and what shall be
looked at (:class:`LookAt`), and is sent what came of it. The guard moves the arm, with whatever it
knows of limits, solids, the arm itself and the map. Cameras that are being calibrated are no
evidence for the map: from cold they are centimetres off and see the arm where it is not. So nobody
protects people while a cell is calibrated from cold: the cell must be empty
(:func:`~armsight.tasks.calibration_cell.unseen_is_empty`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from typing import Generic, TypeVar

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats, JointVector
from armsight.calibration.live.seen import LookAt, Looked, MoveTo, Picture, Request
from armsight.devices.data import StereoFrame, Wrench
from armsight.errors import ArmsightError
from armsight.motion.face import Face
from armsight.motion.intents import Intent, JointIntent, Rest
from armsight.motion.perception import CameraUse, PosedFrame
from armsight.motion.task import Observation, Subscriptions

TOLERANCE = 0.003
"""An arm this near to where it was sent has arrived [rad]; where it stands is measured anyhow."""
RESTING = 0.005
"""Joints slower than this rest [rad/s]."""
STUCK, CREEP = 3.0, 0.06
"""An arm that has moved by less than so much [rad] for this long [s] on its way does not arrive:
before what it must keep away from it creeps, slower and slower."""
WAIT = 1.5
"""A camera that has sent no picture for this long after all is still has none [s]."""

Result = TypeVar("Result")


class ProcedureTask(Generic[Result]):
    """Carries a procedure out.

    Attributes:
        result: what was found, once the task is done; None before, and when it failed.
        error: why it failed, or None.
        done: whether it has ended, one way or the other.
        held: why the arm did not get where it was sent last, by the guard; empty when nobody says.
    """

    name = "calibrate"
    period = 0.016
    latency = 0.0  # what it computes could be computed while the arm travels

    def __init__(
        self,
        cameras: Sequence[CameraUse],
        steps: Callable[[Callable[[], float]], Generator[Request, bool | Looked, Result]],
        face: Callable[[], Face],
        pairs: Sequence[str] = (),
    ) -> None:
        """Prepare.

        Args:
            cameras: whose pictures, and which, it looks at; the procedure counts them so.
            steps: begins the procedure, given the cell's clock [s].
            face: what it shows.
            pairs: stereo pairs that it looks at; they count on after the cameras.
        """
        self.result: Result | None = None
        self.error: ArmsightError | None = None
        self.held = ""
        self._cameras, self._begin, self.face = tuple(cameras), steps, face
        self._pairs = tuple(pairs)
        self._now = 0.0
        self._quiet = Subscriptions()
        self._watching = Subscriptions(self._cameras, stereo=self._pairs)
        self.reset()

    def reset(self) -> None:
        """From the beginning."""
        self.result = self.error = None
        self._steps = self._begin(lambda: self._now)
        self._request: Request | None = None
        self._begun = False
        self._number = 0
        self._still_since = math.inf
        self._looking_since = math.inf
        self._forget()

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self.result is not None or self.error is not None

    @property
    def subscriptions(self) -> Subscriptions:
        """Pictures only while they are looked at: they are costly to take."""
        looking = isinstance(self._request, LookAt) and not self.done
        return self._watching if looking else self._quiet

    def update(self, observation: Observation) -> Intent | None:
        """One round: hand the procedure what came of its last wish, and pursue the next."""
        self._now = observation.now
        if self.done or observation.joints is None:
            return Rest("calibration is done" if self.done else "")
        if not self._begun:
            self._begun = True
            self._send(None)
        self._notice_rest(observation)
        reply: bool | Looked | None = None
        if isinstance(self._request, MoveTo):
            reply = self._arrived(observation)
        elif isinstance(self._request, LookAt):
            reply = self._looked(observation, self._request)
        if reply is not None:
            self._send(reply)
        if isinstance(self._request, MoveTo):
            name = f"{self._request.stage} {self._number}"
            return JointIntent(name, self._request.joints, TOLERANCE)
        return Rest("calibration is done" if self.done else "looking")

    def _send(self, reply: bool | Looked | None) -> None:
        """The procedure's next wish, or its end."""
        try:
            self._request = next(self._steps) if reply is None else self._steps.send(reply)
        except StopIteration as end:
            self.result, self._request = end.value, None
        except ArmsightError as error:
            self.error, self._request = error, None
        self._number += 1
        self._mark: tuple[float, JointVector] | None = None
        self._looking_since = math.inf
        self._forget()
        self._still_since = self._now if isinstance(self._request, MoveTo) else self._still_since

    def _forget(self) -> None:
        """What was taken is of another place, or of an arm that moved."""
        self._taken: list[list[PosedFrame]] = [[] for _ in self._cameras]
        self._paired: list[list[StereoFrame]] = [[] for _ in self._pairs]
        self._felt: list[Wrench] = []

    def _notice_rest(self, observation: Observation) -> None:
        assert observation.joints is not None
        moving = float(np.abs(observation.joints.velocity).max()) > RESTING
        if moving:
            self._still_since = math.inf
        elif math.isinf(self._still_since):
            self._still_since = observation.now

    def _arrived(self, observation: Observation) -> bool | None:
        """Whether the arm has arrived; None while it is on its way."""
        assert isinstance(self._request, MoveTo)
        guard, joints = observation.guard, observation.joints
        assert joints is not None
        off = float(np.abs(joints.position - self._request.joints).max())
        named = guard is not None and guard.goal == f"{self._request.stage} {self._number}"
        resting = math.isfinite(self._still_since)
        if resting and (off < TOLERANCE or (named and guard is not None and guard.reached)):
            return True
        if self._mark is None or np.abs(joints.position - self._mark[1]).max() > CREEP:
            self._mark = observation.now, joints.position
        if observation.now - self._mark[0] > STUCK:
            self.held = guard.reason if named and guard is not None else ""
            return False
        return None

    def _looked(self, observation: Observation, request: LookAt) -> Looked | None:
        """The pictures of the resting arm; None while they are being taken."""
        since = self._still_since + request.rest
        if math.isinf(self._still_since):
            self._forget()
            return None
        if math.isinf(self._looking_since):
            self._looking_since = max(since, observation.now)
        wrench, first = observation.wrench, len(self._cameras)
        last = self._felt[-1].stamp if self._felt else -math.inf
        if wrench is not None and wrench.stamp >= since and wrench.stamp > last:
            self._felt.append(wrench)
        counts = [
            self._take(observation, self._cameras[i], self._taken[i], request.frames, since)
            if i < first
            else self._take_pair(observation, i - first, request.frames, since)
            for i in request.cameras
        ]
        enough = all(count >= request.frames for count in counts)
        if not enough and observation.now - self._looking_since < WAIT:
            return None
        assert observation.joints is not None
        return Looked(
            self._joints(observation.joints.position),
            [
                *(self._picture(i) for i in range(len(self._cameras))),
                *(_pair_picture(frames) for frames in self._paired),
            ],
            _mean_wrench(self._felt),
        )

    def _take(
        self,
        observation: Observation,
        use: CameraUse,
        taken: list[PosedFrame],
        most: int,
        since: float,
    ) -> int:
        """Keep a camera's newest frame; how many there are."""
        posed = observation.frame(use.camera)
        if posed is None or posed.frame.stamp < since or not _complete(posed, use):
            return len(taken)
        if len(taken) < most and (not taken or taken[-1].frame.sequence < posed.frame.sequence):
            taken.append(posed)
        return len(taken)

    def _take_pair(self, observation: Observation, pair: int, most: int, since: float) -> int:
        """Likewise of a stereo pair."""
        taken, name = self._paired[pair], self._pairs[pair]
        frame = next((f for f in observation.pairs if f.camera == name), None)
        if frame is None or frame.stamp < since:
            return len(taken)
        if len(taken) < most and (not taken or taken[-1].sequence < frame.sequence):
            taken.append(frame)
        return len(taken)

    def _joints(self, now: JointVector) -> JointVector:
        """Mean of the joints at the exposures, or as they are now without any."""
        seen = [p.joints.position for taken in self._taken for p in taken if p.joints is not None]
        return np.asarray(np.mean(seen, axis=0) if seen else now, float)

    def _picture(self, camera: int) -> Picture:
        taken = self._taken[camera]
        if not taken:
            return Picture(None, None, None, "the camera sent no picture")
        depth = np.stack([p.frame.depth for p in taken])
        with np.errstate(invalid="ignore"):
            known = np.isfinite(depth)
            count = known.sum(0)
            mean = np.where(known, depth, 0.0).sum(0) / np.maximum(count, 1)
        return Picture(
            _mean([_grey(p.frame.color) for p in taken if p.frame.color is not None]),
            _mean([p.frame.infrared for p in taken if p.frame.infrared is not None]),
            np.where(count > 0, mean, np.nan).astype(np.float32),
        )


def _pair_picture(taken: Sequence[StereoFrame]) -> Picture:
    if not taken:
        return Picture(None, None, None, "the pair sent no pictures")
    left, right = (_mean([_grey(getattr(f, side)) for f in taken]) for side in ("left", "right"))
    return Picture(left, None, None, right=right)


def _mean_wrench(felt: Sequence[Wrench]) -> Floats | None:
    if not felt:
        return None
    return np.asarray(np.mean([np.concatenate([w.force, w.torque]) for w in felt], axis=0))


def _complete(posed: PosedFrame, use: CameraUse) -> bool:
    """Whether a frame has what was asked for: a camera may have colour or infrared alone."""
    if use.color_rate == 0.0:
        return True
    return posed.frame.color is not None or posed.frame.infrared is not None


def _grey(color: Bytes) -> Bytes:
    return np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), np.uint8)


def _mean(pictures: Sequence[Bytes]) -> Bytes | None:
    """Several exposures of the same as one."""
    if not pictures:
        return None
    total = np.zeros(pictures[0].shape, np.float32)
    for picture in pictures:
        cv2.accumulate(picture, total)
    return np.rint(total / len(pictures)).astype(np.uint8)
