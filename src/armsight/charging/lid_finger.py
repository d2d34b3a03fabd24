"""The finger beside the plug at a lid: where it is, what it feels, and how it is moved."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.calibration import se3
from armsight.charging.feeling import Feeling
from armsight.charging.lid import AWAY, R_LID_FINGER, LidHand, LidOptions, Work
from armsight.charging.vehicle_file import VehicleShape
from armsight.charging.visit import StationOptions
from armsight.geometry.pose import inverse, make_pose
from armsight.robots.soft_mount import at_plug

OUT = 0.004
"""A finger that is drawn back by less is out [m]."""


@dataclass(frozen=True, eq=False)
class LidSetup:
    """What a station needs for lids.

    Attributes:
        shape: of the car that is expected; it has a lid.
        T_flange_finger: the tip when it is out, z along it, x the way of its pin.
        stroke: how far it is drawn back [m].
    """

    shape: VehicleShape
    T_flange_finger: Pose
    stroke: float


class LidFinger:
    """Works one lid after the other.

    Args:
        setup: finger and lid; T_flange_tip: the plug's nominal place.
        feeling: of the plug, in whose mount the finger is; options: of the station.

    Attributes:
        T_base_lid: where the lid is believed to be; covariance: (6, 6) of that.
        opened: it was opened and not shut again; shutting: it shall be shut now.
        hand: that is at work, or was; None before.
    """

    def __init__(
        self, setup: LidSetup, T_flange_tip: Pose, feeling: Feeling, options: StationOptions
    ) -> None:
        self.setup, self._feeling = setup, feeling
        self._T_plug_finger = np.asarray(inverse(T_flange_tip) @ setup.T_flange_finger)
        self._mount = options.insert.admittance
        lid = setup.shape.lid
        assert lid is not None
        mount = replace(self._mount, speed=LidOptions(lid.latch).admittance.speed)
        self._options = LidOptions(lid.latch, admittance=mount)
        self.begin()

    def begin(self) -> None:
        """Another visit: nothing is known."""
        self.T_base_lid: Pose | None = None
        self.covariance: Floats = np.eye(6)
        self.opened = self.shutting = False
        self.hand: LidHand | None = None

    def see(self, T_base_lid: Pose, covariance: Floats) -> tuple[Pose, Floats]:
        """A lid was seen; where its port is then, and the covariance of that."""
        self.T_base_lid, self.covariance = T_base_lid, covariance
        T_port_lid = self.setup.shape.T_port_lid
        six = se3.carried(T_port_lid, covariance)
        return np.asarray(T_base_lid @ inverse(T_port_lid)), six

    def looked_at(self) -> Pose:
        """Middle of the lid, turned as its port is: right and up for who looks at the car."""
        assert self.T_base_lid is not None
        T = self.T_base_lid @ inverse(self.setup.shape.T_port_lid)
        return make_pose(T[:3, :3], self.T_base_lid[:3, 3])

    def before(self) -> Pose:
        """``T_base_plug`` with the finger before the lid, from where it is opened and shut."""
        assert self.T_base_lid is not None
        T = self.T_base_lid @ make_pose(R_LID_FINGER, (0.03, 0.0, AWAY))
        return np.asarray(T @ inverse(self._T_plug_finger))

    def work(self, task: Work) -> None:
        """Something else is done from now on."""
        self.hand = LidHand(self._options, task)

    def step(self, now: float, T_base_plug: Pose, held: bool) -> Floats | None:
        """(6,) twist of the plug in its own axes that moves the finger; None where nobody feels."""
        assert self.T_base_lid is not None
        assert self.hand is not None
        wrench = self._feeling.contact(now)
        if wrench is None:
            return None
        T = self._T_plug_finger
        R, p = T[:3, :3], T[:3, 3]
        moved = self._mount.deflection(wrench)
        give = R.T @ (moved[:3] + np.cross(moved[3:], p))
        T_lid_finger = inverse(self.T_base_lid) @ T_base_plug @ T
        twist = self.hand.step(now, T_lid_finger, at_plug(wrench, T), held, give)
        turn = R @ twist[3:]
        return np.concatenate([R @ twist[:3] - np.cross(turn, p), turn])

    def touches(self, now: float) -> bool:
        """Whether it feels something: then the lid is where it was."""
        wrench = self._feeling.contact(now)
        return wrench is not None and float(np.linalg.norm(wrench[:3])) > self._options.touch_force
