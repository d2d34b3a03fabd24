"""What the station asks of the guard: to touch the port, with the plug, and nothing else."""

from __future__ import annotations

import numpy as np

from armsight.charging.eye import SeenPort
from armsight.charging.visit import StationOptions
from armsight.motion.data import GuardStatus
from armsight.motion.permits import PermitRequest, PermitState
from armsight.motion.regions import Region

RENEW = 90.0
"""A permit is asked for under a new name after this time, before it ends [s]."""
SPEED = 0.06
"""Of the plug in the region at most [m/s]."""


class Permission:
    """Asks for the permit of one port, anew when one was withdrawn.

    Args:
        options: of the station.
    """

    def __init__(self, options: StationOptions) -> None:
        self._options = options
        self._region: Region | None = None
        self._since = -np.inf
        self._number = 0
        self._pausing = False

    def see(self, port: SeenPort, stamp: float, sigma: float) -> None:
        """The port was seen at ``stamp`` [s]; its place is known to ``sigma`` [m] besides."""
        R = port.T_base_port[:3, :3]
        covariance = R @ port.covariance[:3, :3] @ R.T + sigma**2 * np.eye(3)
        covariance = 0.5 * (covariance + covariance.T)
        side = 2.0 * self._options.aside
        self._region = Region(
            "box", (side, side, side), port.T_base_port, stamp, np.zeros(3), covariance, 0.0
        )

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
        if self.lost(guard) and not self._pausing:
            self._pausing = True
            return None
        self._pausing = False
        if now - self._since > RENEW:
            self._since, self._number = now, self._number + 1
        o = self._options
        return PermitRequest(
            f"port {self._number}",
            "thing",
            self._region,
            speed=SPEED,
            force=o.force,
            torque=o.torque,
            seconds=120.0,
            stiffness=o.insert.admittance.stiffness[0],
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
