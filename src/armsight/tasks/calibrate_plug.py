"""Calibrating a standing pair and the charging plug by showing the plug to the pair."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from armsight.arrays import Vector3
from armsight.calibration.robot_errors import RobotErrors
from armsight.charging.admittance import Admittance
from armsight.charging.calibrate import PlugLook
from armsight.charging.eye import drawn
from armsight.charging.plug_procedure import PlugNews, PlugResult, PlugSetup, plug_procedure
from armsight.charging.ports.table import PORTS
from armsight.errors import CalibrationError
from armsight.mapping.config import MappingConfig
from armsight.motion.data import GuardMode
from armsight.motion.face import Curve, EllipsoidMark, Face, Figure, FrameMark, Picture, PointsMark
from armsight.motion.intents import Intent, Rest
from armsight.motion.task import Observation, Subscriptions
from armsight.tasks.calibration_cell import free_checks
from armsight.tasks.calibration_entries import arm_of_errors
from armsight.tasks.plug_picture import over_arm
from armsight.tasks.procedure_task import RESTING, ProcedureTask
from armsight.tasks.room import Room
from armsight.workcell.beliefs import robot_in
from armsight.workcell.calibration_file.reading import BY_PLUG
from armsight.workcell.calibration_file.schema import (
    CalibratedArm,
    CalibratedPlug,
    CalibratedStereo,
)
from armsight.workcell.calibration_file.writing import plug_entry, stereo_entry
from armsight.workcell.schema import Workcell

if TYPE_CHECKING:
    from armsight.workcell import Cell

NO_SAG = 1e-6
"""The cell's kinematics are those of a stiff arm: sag is not solved [rad]."""
DELAY = 0.072
"""Of the mount's admittance; the calibration presses on nothing [s]."""
FOUND = (56, 189, 248)
WIDE = 480
"""Of the picture with the arm drawn over it [px]."""


def without_car(workcell: Workcell) -> Workcell:
    """A simulated station whose parking place is empty, as it is when one is calibrated.

    A car that is parked there, and not declared, might be somebody: the guard would keep away.
    """
    simulation = workcell.simulation.model_copy(update={"car": None})
    return workcell.model_copy(update={"simulation": simulation})


def plug_setup(
    cell: Cell, mapping: MappingConfig, pair: str | None = None, looks: int = 26
) -> PlugSetup:
    """A cell as believed before its pair and its plug are calibrated.

    Args:
        cell: open, without what an earlier calibration by the plug has found.
        mapping: of the session; its static map says where the arm may stand.
        pair: which of its standing pairs; the first if None.
        looks: how many to take.

    Raises:
        CalibrationError: it has no plug, no such pair, or one that the arm carries.
    """
    workcell, section = cell.workcell, cell.workcell.plug
    if section is None or cell.robot.tool is None or section.kind not in PORTS:
        raise CalibrationError(
            f"{workcell.file or workcell.name}: calibrate --plug needs a [plug] on the flange and "
            "robot.tool: what it is"
        )
    infos = {p.info.name: p.info for p in cell.stereo}
    standing = [name for name, info in infos.items() if info.mounted_on == "base"]
    if pair is not None and pair not in standing:
        what = "moves with the arm" if pair in infos else "is not there"
        raise CalibrationError(
            f"{workcell.name}: the pair {pair} {what}; pairs that stand: "
            f"{', '.join(standing) or 'none'}"
        )
    if not standing:
        raise CalibrationError(
            f"{workcell.name}: has no [[stereo]] pair that stands still to show the plug to"
        )
    known = cell.calibration is not None and cell.calibration.arm is not None
    mount = None
    if cell.wrench is not None:
        mount = Admittance((1e3 * section.mount_n_per_mm, section.mount_nm_per_rad), DELAY)
    free, _ = free_checks(cell, mapping)
    return PlugSetup(
        cell.robot,
        None if known else RobotErrors(robot_in(workcell), sag_sigma=NO_SAG),
        infos[pair or standing[0]],
        section.kind,
        mount,
        free,
        looks,
        workcell.robot.speed,
        workcell.robot.acceleration,
    )


class CalibratePlugTask(ProcedureTask[PlugResult]):
    """Shows the plug to the pair from many sides."""

    name = "calibrate by plug"

    def __init__(
        self,
        setup: PlugSetup,
        rng: np.random.Generator,
        told: Callable[[PlugNews], None] = lambda news: None,
        kept: Callable[[PlugLook], None] = lambda look: None,
        done: Sequence[PlugLook] = (),
    ) -> None:
        """Prepare.

        Args:
            setup: what is there to calibrate.
            rng: of places.
            told: told of every look.
            kept: told of every one that counts.
            done: looks of a run that was stopped.
        """
        self._room, self._sees = Room(setup.robot), False
        room = self._room
        setup = replace(setup, room=room.left, lasts=room.lasts, here=lambda: room.here)
        self._face, self._told = _PlugFace(setup), told
        super().__init__(
            (),
            lambda clock: plug_procedure(setup, rng, self._look, kept, done),
            self._face.face,
            (setup.pair.name,),
        )

    @property
    def subscriptions(self) -> Subscriptions:
        """The pair's pictures, and the map: it says where the guard would not let the arm stand."""
        return replace(super().subscriptions, snapshot=True)

    def update(self, observation: Observation) -> Intent | None:
        """See :class:`~armsight.motion.task.Task`."""
        guard = observation.guard
        if observation.snapshot is None or guard is None:
            return Rest("there is no map yet")
        self._room.snapshot = observation.snapshot
        if observation.joints is not None:
            self._room.here = observation.joints.position
            if (
                np.abs(observation.joints.velocity).max() < RESTING
                and guard.protective_distance > 0
            ):
                self._room.rests = guard.protective_distance
        self._sees = self._sees or guard.mode is not GuardMode.STOPPED
        if not self._sees:  # what the cameras have not looked at yet is no place to keep away from
            return Rest(f"the cell is not seen yet: {guard.reason}")
        return super().update(observation)

    def _look(self, news: PlugNews) -> None:
        if news.picture is None and news.problem and self.held:
            news = replace(news, problem=f"{news.problem}: {self.held}")
        self._face.told(news)
        self._told(news)


class _PlugFace:
    """Looks so far, how sure the tip is, and the newest picture with the arm drawn over it."""

    def __init__(self, setup: PlugSetup) -> None:
        self._setup = setup
        self._news: PlugNews | None = None
        self._places: list[Vector3] = []
        self._good = 0
        self._pictures: tuple[Picture, ...] = ()

    def told(self, news: PlugNews) -> None:
        """A look was taken."""
        self._news = news
        self._good += news.seen is not None
        if news.picture is None:
            return
        self._places.append(news.answer.base_tip(news.joints)[:3, 3])
        setup, lens = self._setup, self._setup.pair.left
        whole = over_arm(news.picture, lens, setup.robot, news.joints, news.answer)
        size = (WIDE, round(WIDE * lens.height / lens.width))
        small = np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.uint8)
        color = np.asarray(cv2.cvtColor(news.picture, cv2.COLOR_GRAY2RGB), np.uint8)
        self._pictures = (
            Picture("the arm as believed", small),
            Picture(f"plug in {setup.pair.name}", drawn(color, lens, news.seen)),
        )

    def face(self) -> Face:
        """As it is now."""
        news = self._news
        if news is None:
            return Face("choosing places")
        answer, marks = news.answer, list[PointsMark]()
        if self._places:
            marks.append(PointsMark("looks", np.array(self._places), 0.012, FOUND))
        T, C = answer.T_base_camera, answer.covariance[:3, :3]
        sigma, solved = float("nan"), bool(answer.used.size)
        if solved:
            sigma = 1e3 * answer.tip_sigma(news.joints)
        ellipsoid = EllipsoidMark.of(
            f"doubt about {self._setup.pair.name}", T[:3, 3], T[:3, :3] @ C @ T[:3, :3].T, 3.0
        )
        return Face(
            state=f"look {news.done} of {news.of}",
            reason=news.problem,
            figures=(Figure("good looks", float(self._good)), Figure("tip known to", sigma, "mm")),
            curves=(Curve("tip known to", sigma, "mm"),),
            pictures=self._pictures,
            marks=(
                *marks,
                FrameMark(f"pair {self._setup.pair.name}", T),
                FrameMark("plug", answer.base_tip(news.joints), 0.05),
                *((ellipsoid,) if solved else ()),
            ),
        )


def plug_entries(
    workcell: Workcell, setup: PlugSetup, result: PlugResult
) -> tuple[CalibratedStereo, CalibratedPlug, CalibratedArm | None]:
    """What was found as entries of the calibration file; the arm where its errors were solved."""
    answer, section = result.answer, workcell.plug
    pair = next(s for s in workcell.stereo if s.name == setup.pair.name)
    tool = robot_in(workcell).tool
    assert section is not None
    assert tool is not None
    source = f"{BY_PLUG}, {int(answer.used.sum())} looks"
    stereo = stereo_entry(
        workcell,
        pair,
        answer.T_base_camera,
        answer.covariance[:6, :6],
        model=setup.pair.model,
        source=source,
    )
    plug = plug_entry(
        section,
        answer.T_flange_plug,
        answer.covariance[6:12, 6:12],
        tool.T_flange_tcp,
        source=source,
        tip_error=result.sigma,
    )
    arm = None
    if setup.errors is not None:
        arm = arm_of_errors(setup.errors, answer.arm_errors, source)
    return stereo, plug, arm
