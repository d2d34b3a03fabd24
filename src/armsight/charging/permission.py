"""What the station asks of the guard: to touch port or lid, with the tool, and nothing else."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, Pose, Vector3
from armsight.charging.eye import SeenPort
from armsight.charging.visit import StationOptions
from armsight.geometry.pose import make_pose
from armsight.motion.asking import AskAnew
from armsight.motion.data import GuardStatus
from armsight.motion.permits import PermitRequest, PermitState
from armsight.motion.regions import Region

RENEW = 90.0
"""A permit is asked for under a new name after this time, before it ends [s]."""
SOFT = 0.4
"""But not while it presses with more than this share of its force: what is felt before a permit is
granted speaks against it, and the plug would stand in its socket without one."""
SPEED = 0.06
"""Of the plug in the region at most [m/s]."""
HARD = 0.8
"""Share of the force of a permit: who presses with more was not interrupted by others."""
LID_SPEED = 0.08
"""Of the finger in that of a lid [m/s]."""
LID_BOX = np.array([[-0.13, -0.10, -0.07], [0.22, 0.10, 0.18]])
"""Where a lid swings, and the finger and the plug beside it work it, in the lid's frame [m]."""


class Permission:
    """Asks for the permit of one port, anew when one was withdrawn.

    Args:
        options: of the station.
    """

    def __init__(self, options: StationOptions) -> None:
        self._options = options
        self._region: Region | None = None
        self._what, self._speed = "port", SPEED
        self._out: Vector3 | None = None
        self._tare: Floats | None = None
        self._since = -np.inf
        self._number = 0
        self._asking = AskAnew()

    def see(self, port: SeenPort, stamp: float, sigma: float, tare: Floats | None = None) -> None:
        """The port was seen at ``stamp`` [s]; its place is known to ``sigma`` [m] besides.

        ``tare`` (6,) is what the sensor said before the plug went there, for a station that was
        killed since [N], [N m].
        """
        side = 2.0 * self._options.aside
        self._name("port", SPEED)
        self._out, self._tare = np.asarray(port.T_base_port)[:3, 2], tare
        self._about(port.T_base_port, (side, side, side), port.covariance, stamp, sigma)

    def see_lid(
        self,
        T_base_lid: Pose,
        covariance: Floats,
        stamp: float,
        sigma: float,
        tare: Floats | None = None,
    ) -> None:
        """The lid was seen likewise: the finger may touch where it swings."""
        x, y, z = (float(v) for v in LID_BOX[1] - LID_BOX[0])
        self._name("lid", LID_SPEED)
        self._out, self._tare = None, tare
        T = T_base_lid @ make_pose(None, LID_BOX.mean(axis=0))
        self._about(T, (x, y, z), covariance, stamp, sigma)

    def _name(self, what: str, speed: float) -> None:
        if what != self._what:  # another place under the same name would have jumped there
            self._since = -np.inf
        self._what, self._speed = what, speed

    def _about(
        self, T: Pose, size: tuple[float, float, float], six: Floats, stamp: float, sigma: float
    ) -> None:
        R = T[:3, :3]
        covariance = R @ six[:3, :3] @ R.T + sigma**2 * np.eye(3)
        covariance = 0.5 * (covariance + covariance.T)
        self._region = Region("box", size, T, stamp, np.zeros(3), covariance, 0.0)

    @property
    def exposure(self) -> float:
        """When what may be touched was seen, or felt, last [s]."""
        return -np.inf if self._region is None else self._region.exposure

    def felt(self, now: float) -> None:
        """The plug is in the socket: the port is where it was."""
        region = self._region
        if region is not None:
            self._region = Region(
                region.shape, region.size, region.T_base_region, now, region.velocity,
                region.covariance, 0.0,
            )  # fmt: skip

    def ask(self, now: float, guard: GuardStatus | None) -> PermitRequest | None:
        """The request of this round; None without a port, or to clear one that was withdrawn."""
        if self._region is None:
            return None
        if not self._asking.may_ask(guard):
            return None
        o, permit = self._options, None if guard is None else guard.permit
        presses = permit is not None and permit.pressed > SOFT * o.force
        if now - self._since > (np.inf if presses and np.isfinite(self._since) else RENEW):
            self._since, self._number = now, self._number + 1
        return PermitRequest(
            f"{self._what} {self._number}",
            "thing",
            self._region,
            speed=self._speed,
            force=o.force,
            torque=o.torque,
            seconds=120.0,
            stiffness=o.insert.admittance.stiffness[0],
            out=self._out,
            tare=self._tare,
        )

    def holds(self, guard: GuardStatus | None) -> bool:
        """Whether the plug may touch."""
        return guard is not None and guard.permit is not None and guard.permit.holds

    def lost(self, guard: GuardStatus | None) -> str:
        """Why a permit was withdrawn, in words; empty when none was."""
        permit = None if guard is None else guard.permit
        if permit is None or permit.state is not PermitState.WITHDRAWN:
            return ""
        return permit.reason or "the permit was withdrawn"

    def interrupted(self, guard: GuardStatus | None) -> bool:
        """Whether a permit was withdrawn while nothing pressed hard: somebody came near."""
        permit = None if guard is None else guard.permit
        if permit is None or not self.lost(guard):
            return False
        return permit.pressed < HARD * permit.force
