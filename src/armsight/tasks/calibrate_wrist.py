"""Calibrating the pair on the wrist by a ball at rest, at which it looks from all around."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armsight.arrays import Bytes, Pose, Vector3
from armsight.calibration.live.seen import LookAt, Looked
from armsight.calibration.live.wrist import (
    FRAMES,
    WristLook,
    WristResult,
    WristSetup,
    wrist_procedure,
)
from armsight.devices.data import StereoInfo
from armsight.errors import CalibrationError
from armsight.geometry.pose import inverse
from armsight.mapping.config import MappingConfig
from armsight.motion.face import Face, Figure, Picture, PointsMark
from armsight.motion.task import Observation, Subscriptions
from armsight.servoing.eyes import Eye, WristEye
from armsight.servoing.sighting import Look, Looks
from armsight.servoing.targets.ball import Ball
from armsight.tasks.calibration_cell import free_checks, to_calibrate
from armsight.tasks.procedure_task import ProcedureTask
from armsight.workcell.calibration_file.schema import CalibratedStereo
from armsight.workcell.calibration_file.writing import stereo_entry
from armsight.workcell.schema import Workcell

if TYPE_CHECKING:
    from armsight.workcell import Cell

RADIUS = 0.04
"""Of the red ball [m]."""
TOGETHER = 0.03
"""Looks at a ball at rest lie within this [m]; the fixed cameras differ by no more than twice."""
PATIENCE = 3.0
"""The pair is given so long to see the ball [s]."""


def ball_at_rest(workcell: Workcell) -> Workcell:
    """The cell with its cameras no evidence for the map, and a simulated ball that stays put."""
    targets = tuple(
        t.model_copy(update={"path": "free"}) if t.kind == "ball" else t
        for t in workcell.simulation.target
    )
    simulation = workcell.simulation.model_copy(update={"target": targets})
    return to_calibrate(workcell).model_copy(update={"simulation": simulation})


def wrist_setup(cell: Cell, mapping: MappingConfig) -> WristSetup:
    """A cell as believed before its pair is calibrated.

    Raises:
        CalibrationError: it has no pair on the flange, or no fixed camera with colour.
    """
    pairs = [p.info for p in cell.stereo if p.info.mounted_on == "flange"]
    if not pairs:
        raise CalibrationError(f"{cell.workcell.name}: has no [[stereo]] on the flange")
    if not _colored(cell):
        raise CalibrationError(
            f"{cell.workcell.name}: has no fixed [[camera]] with colour that could find the ball"
        )
    free, _ = free_checks(cell, mapping)
    return WristSetup(cell.robot, pairs[0], RADIUS, free)


def _colored(cell: Cell) -> list[str]:
    return [
        c.info.name
        for c in cell.cameras
        if c.info.color is not None and c.info.mounted_on == "base"
    ]


class CalibrateWristTask(ProcedureTask[WristResult]):
    """Finds the ball with the fixed cameras, and looks at it with the pair from all around."""

    name = "calibrate the wrist's pair"

    def __init__(self, cell: Cell, setup: WristSetup, rng: np.random.Generator) -> None:
        """Prepare.

        Args:
            cell: open, see :func:`ball_at_rest`.
            setup: what is there to calibrate.
            rng: of views.
        """
        self.setup, self._fixed = setup, _colored(cell)
        self._place: Vector3 | None = None
        ball = Ball(RADIUS)
        eyes = [Eye(name, ball) for name in self._fixed]
        self.perceivers: tuple[Eye | WristEye, ...] = (
            *eyes, WristEye(setup.pair.name, ball, cell.robot),
        )  # fmt: skip
        self._state, self._shown = "looking for the ball", dict[str, Bytes]()
        self._counts = [0, 0]
        super().__init__(
            (),
            lambda clock: wrist_procedure(setup, self._found, self._seen, rng, self._told),
            self._as_it_is,
        )
        self._quiet = Subscriptions(perceivers=tuple(eye.name for eye in self.perceivers))
        self._watching = self._quiet

    def reset(self) -> None:
        """From the beginning."""
        self._place = None
        self._places: dict[str, list[Vector3]] = {}
        self._looks: list[Look] = []
        super().reset()

    def _looked(self, observation: Observation, request: LookAt) -> Looked | None:
        """What the eyes saw of an arm at rest; None while they look."""
        since = self._still_since + request.rest
        if not observation.now >= since:
            self._places, self._looks = {}, []
            return None
        if np.isinf(self._looking_since):
            self._looking_since = observation.now
            self._places, self._looks = {}, []
        for perceived in observation.perceived:
            if isinstance(perceived.evidence, Looks):
                for look in perceived.evidence.looks:
                    self._keep(look, since)
        if request.cameras:
            enough = len(self._looks) >= request.frames
        else:
            enough = bool(self._fixed) and all(
                len(self._places.get(name, ())) >= request.frames for name in self._fixed
            )
        if not enough and observation.now < self._looking_since + PATIENCE:
            return None
        assert observation.joints is not None
        return Looked(np.asarray(observation.joints.position, float), [])

    def _keep(self, look: Look, since: float) -> None:
        """One look that was exposed while the arm stood."""
        if look.picture is not None:
            self._shown[look.camera] = look.picture
        if look.stamp < since or not look.sightings:
            return
        if look.wrist:
            if not self._looks or look.stamp > self._looks[-1].stamp:
                self._looks.append(look)
        else:
            places = self._places.setdefault(look.camera, [])
            place = look.sightings[0].position
            if not places or not np.array_equal(places[-1], place):
                places.append(place)

    def _found(self) -> Vector3 | None:
        """(3,) where the fixed cameras have the ball, if they agree [m]."""
        means = [np.mean(places, axis=0) for places in self._places.values()]
        if not means:
            return None
        middle = np.median(means, axis=0)
        good = [m for m in means if np.linalg.norm(m - middle) < 2.0 * TOGETHER]
        if not good:
            return None
        self._place = np.asarray(np.mean(good, axis=0))
        return self._place

    def _seen(self) -> WristLook | None:
        """The mean of the newest looks of the pair; None where they show no ball at rest."""
        mount = inverse(self.setup.pair.T_mount_camera)
        looks = [(look.T_base_camera, look.sightings[0].position) for look in self._looks[:FRAMES]]
        if not looks:
            return None
        centers = [(inverse(T) @ np.array([*p, 1.0]))[:3] for T, p in looks]
        middle = np.median(centers, axis=0)
        near = [c for c in centers if np.linalg.norm(c - middle) < TOGETHER]
        T: Pose = looks[-1][0] @ mount
        return WristLook(T, np.asarray(np.mean(near, axis=0))) if near else None

    def _told(self, done: int, of: int, look: WristLook | None) -> None:
        self._state = f"look {done} of {of}"
        self._counts = [done, self._counts[1] + (look is not None)]

    def _as_it_is(self) -> Face:
        """What the page shows."""
        place = self._place
        marks = () if place is None else (PointsMark("ball", place[None], 0.02, (230, 40, 40)),)
        return Face(
            state=self._state,
            figures=(
                Figure("looks", float(self._counts[0])),
                Figure("ball seen", float(self._counts[1])),
            ),
            pictures=tuple(Picture(n, p) for n, p in sorted(self._shown.items())),
            marks=marks,
        )


def wrist_entry(workcell: Workcell, pair: StereoInfo, result: WristResult) -> CalibratedStereo:
    """The pair's entry; its lenses stay."""
    section = next(s for s in workcell.stereo if s.name == pair.name)
    return stereo_entry(
        workcell, section, result.T_flange_camera, result.covariance, model=pair.model,
        source=f"armsight calibrate --wrist, {result.used} looks",
    )  # fmt: skip
