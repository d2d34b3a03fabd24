"""What a station's pairs show on the bench: looks drawn from their errors, or pictures searched."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from armsight.arrays import Pose
from armsight.charging.closer import Where
from armsight.charging.eye import PortEye, PortLook, SeenPort
from armsight.charging.find import INLETS
from armsight.charging.lid_eye import LidEye, LidLook
from armsight.charging.looking import INLETS_OF
from armsight.charging.vehicle_file import LidShape
from armsight.devices.data import JointState
from armsight.devices.history import JointHistory
from armsight.experiments.station_weather import POST, Surroundings
from armsight.geometry.pose import exp, inverse
from armsight.robots.robot import Robot
from armsight.runtime.posing import posed_pair
from armsight.simulation.world import SimulatedWorld

FLANGE = "flange"
"""The pair of the packaged cells that the arm carries."""
EVERY = 0.6
"""Between two drawn looks of a pair [s]."""
Mode = Literal["ours", "paper"]
__all__ = ["FLANGE", "POST", "DrawnEyes", "Eyes", "Mode", "RenderedEyes"]


class Eyes(Protocol):
    """Looks of the pairs that a station wants."""

    def look(
        self, now: float, joints: JointState, wanted: Sequence[str], T_base_port: Pose
    ) -> tuple[PortLook | LidLook, ...]:
        """Those that have become known at ``now`` [s]; the true pose is for drawn ones."""
        ...

    def expect(self, T_base_lid: Pose | None, T_base_port: Pose | None) -> None:
        """About where a lid is, and a port that is looked at from near; or None."""
        ...

    def show(self, T_base_plug: Pose | None) -> None:
        """Where the standing pair is shown the arm's plug, or None."""
        ...


@dataclass(frozen=True)
class LookErrors:
    """Standard deviations of a look: lateral, depth [m], tilt, roll [rad]; score that it gets."""

    lateral: float
    depth: float
    tilt: float
    roll: float
    score: float = 0.95


FAR = LookErrors(0.003, 0.003, np.deg2rad(1.0), np.deg2rad(0.4), 0.9)
NEAR = LookErrors(0.0008, 0.0008, np.deg2rad(0.6), np.deg2rad(0.3))
"""What the pairs' calibration and pictures leave, a second look's beside a first one's."""


class DrawnEyes:
    """A look every now and then, as wrong as looks are.

    Args:
        port: type of the inlet that is there.
        seed: of the errors.
        T_port_lid: where a lid is, or None.
        shut: whether it is.
        plug: type of the plug that is shown to it.
    """

    def __init__(
        self,
        port: str,
        seed: int,
        T_port_lid: Pose | None = None,
        shut: Callable[[], bool] = lambda: False,
        plug: str = "",
    ) -> None:
        self._port, self._T_port_lid, self._shut = port, T_port_lid, shut
        self._plug = plug
        self._T_shown: Pose | None = None
        self._rng = np.random.default_rng((seed, 77))
        self._last: dict[str, float] = {}

    def look(
        self, now: float, joints: JointState, wanted: Sequence[str], T_base_port: Pose
    ) -> tuple[PortLook | LidLook, ...]:
        """See :class:`Eyes`."""
        due = [pair for pair in wanted if now - self._last.get(pair, -1.0) >= EVERY]
        self._last |= dict.fromkeys(due, now)
        return tuple(self._drawn(pair, now, T_base_port) for pair in due)

    def expect(self, T_base_lid: Pose | None, T_base_port: Pose | None) -> None:
        """See :class:`Eyes`; a drawn look is as good without."""

    def show(self, T_base_plug: Pose | None) -> None:
        """See :class:`Eyes`; it is where it is believed, but for the look's errors."""
        self._T_shown = T_base_plug

    def _drawn(self, pair: str, now: float, T_base_port: Pose) -> PortLook | LidLook:
        errors = FAR if pair == POST else NEAR
        sigma = np.array([errors.lateral, errors.lateral, errors.depth] + [errors.tilt] * 2)
        sigma = np.append(sigma, errors.roll)
        off = exp(self._rng.standard_normal(6) * sigma)
        if self._T_shown is not None and pair == POST:
            T, name = self._T_shown @ off, self._plug
            shown = SeenPort(name, errors.score, T, np.diag(sigma**2), False)
            return PortLook(now, pair, (shown,), np.zeros((4, 4, 3), np.uint8))
        if self._T_port_lid is not None and self._shut():
            T_lid = np.asarray(T_base_port @ self._T_port_lid @ off)
            picture = np.zeros((4, 4, 3), np.uint8)
            return LidLook(now, pair, T_lid, np.diag(sigma**2), errors.score, picture)
        T = T_base_port @ off
        port = SeenPort(self._port, errors.score, T, np.diag(sigma**2), False)
        return PortLook(now, pair, (port,), np.zeros((4, 4, 3), np.uint8))


class RenderedEyes:
    """The pairs' pictures, rendered, searched and fitted by what does it in the cell.

    Args:
        world: with its stereo pairs.
        robot: as it is believed to be.
        plug: type of the station's plug.
        mode: the station's.
        lid: that the car has, or None.
        around: what weather and dirt make of the pictures; None leaves them as rendered.
        where: a port can be, in ``base``.
    """

    def __init__(
        self,
        world: SimulatedWorld,
        robot: Robot,
        plug: str,
        mode: Mode,
        lid: LidShape | None = None,
        around: Surroundings | None = None,
        where: Where | None = None,
    ) -> None:
        self._world, self._robot, self._around = world, robot, around
        self._eyes = {
            POST: PortEye(
                POST,
                INLETS,
                paper=mode == "paper",
                where=None if mode == "paper" or lid is not None else where,
            ),
            FLANGE: PortEye(FLANGE, INLETS_OF[plug], (0.15, 0.8)),
        }
        self._lids = {} if lid is None else {pair: LidEye(pair, lid) for pair in (POST, FLANGE)}
        self._history = JointHistory()
        self._known: list[tuple[float, PortLook | LidLook]] = []

    def expect(self, T_base_lid: Pose | None, T_base_port: Pose | None) -> None:
        """See :attr:`LidEye.expected` and :attr:`PortEye.expected`."""
        self._eyes[FLANGE].expected = T_base_port
        for eye in self._lids.values():
            eye.expected = T_base_lid

    def show(self, T_base_plug: Pose | None) -> None:
        """See :class:`Eyes`."""
        self._eyes[POST].shown = T_base_plug

    def look(
        self, now: float, joints: JointState, wanted: Sequence[str], T_base_port: Pose
    ) -> tuple[PortLook | LidLook, ...]:
        """See :class:`Eyes`; what was exposed is known when the cell would know it."""
        self._history.add(joints)
        for camera in self._world.stereo_cameras:
            camera.want_pictures(camera.info.name in wanted)
            frame = camera.read()
            if frame is None or camera.info.name not in wanted:
                continue
            view = posed_pair(frame, camera.info, self._robot, self._history)
            if self._around is not None and view.T_base_camera is not None:
                T = np.asarray(inverse(view.T_base_camera) @ T_base_port)
                view = replace(view, frame=self._around.over(frame, camera.info, T))
            lid = self._lids.get(camera.info.name)
            for eye in (self._eyes[camera.info.name], *(() if lid is None else (lid,))):
                seen = eye.update([view])
                if seen is not None:
                    self._known.append((now + eye.latency, seen))
        due = tuple(look for when, look in self._known if when <= now)
        self._known = [(when, look) for when, look in self._known if when > now]
        return due
