"""Backing out of a contact: brake, relax, and go back the way the arm came, slowly.

A permit that is withdrawn while the arm touches leaves it in contact. It then leaves along the path
that it came by, no faster than an arm that counts as standing, whatever any task wants, until the
parts that could touch are clear of the region. Where it came by no path, it leaves straight away
from the region. From a target that was coming along it leaves that much faster: one that pushed at
6 cm/s would else press harder and harder on an arm that leaves with 4.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.arrays import JointPath, JointVector, Vector3
from armsight.motion.executed import Executed
from armsight.motion.nearest import MovingBody
from armsight.motion.permitted import Grant

CLEAR = 0.02
"""The arm has left when what could touch is this far from the region [m]."""
PACE = 0.9
"""Share of the speed of an arm that counts as standing."""
ARRIVED = 0.01
"""A place of the way back is reached within this [rad]."""
CARRIED = 0.1
"""The target's velocity counts up to this [m/s]."""
REACH = 0.3
"""Least lever by which a joint's speed counts, where no part moves [m]."""


class Retreat:
    """One way out.

    Attributes:
        reason: why.
        grant: what could be touched.
        braked: the arm has come to rest first.
        carried: (3,) velocity of the target when it was last granted [m/s], cut at :data:`CARRIED`.
    """

    def __init__(
        self, reason: str, grant: Grant, executed: Executed, q: JointVector, now: float
    ) -> None:
        region = grant.region  # as it is now: what is lost goes nowhere
        T = np.array(region.T_base_region, float)
        T[:3, 3] = region.center(now)
        still = replace(region, T_base_region=T, exposure=now, velocity=np.zeros(3), drift=0.0)
        self.reason, self.grant = reason, replace(grant, region=still)
        self.braked = False
        self.carried = region.velocity * min(1.0, CARRIED / max(region.speed, 1e-9))
        back: JointPath = executed.retrace(q, 1.0)
        self._places = [np.asarray(place) for place in back[1:]]

    def motion(self, body: MovingBody, q: JointVector, now: float, speed: float) -> JointVector:
        """(n,) joint velocities of the next step [rad/s].

        No point is faster than a share of speed, besides what carries the arm along with a target
        that comes at it.

        Args:
            body: the arm's moving parts.
            q: (n,) where it is [rad].
            now: time [s].
            speed: of an arm that counts as standing [m/s].
        """
        while self._places and np.abs(self._places[0] - q).max() < ARRIVED:
            self._places.pop(0)
        way = self._places[0] - q if self._places else self._away(body, q, now)
        if self._places and not self._leaves(body, q, way, now):
            way = self._away(body, q, now)  # it came along with its target: back is nearer to it
        length = float(np.abs(way).max())
        if length < 1e-9:
            return np.zeros(len(q))
        rate = way / length
        _, velocity = body.motion(q, rate)
        fastest = max(body.fastest(q, rate, velocity), REACH)
        return np.asarray(rate * (PACE * speed / fastest) + self._along(body, q, now))

    def _leaves(self, body: MovingBody, q: JointVector, way: JointVector, now: float) -> bool:
        """Whether a motion (n,) takes the deepest part out of the region, not along its border."""
        part, out = self._outward(body, q, now)
        step = body.jacobian(q, part)[:3] @ way
        return float(step @ out) >= 0.5 * float(np.linalg.norm(step))

    def _outward(self, body: MovingBody, q: JointVector, now: float) -> tuple[int, Vector3]:
        """The deepest part, and the direction (3,) from the region's centre to it."""
        parts = np.flatnonzero(self.grant.touching[body.moving])
        center, _ = body.motion(q, np.zeros(len(q)))
        deepest = int(parts[np.argmin(self.grant.region.distance(center[parts], now))])
        way = center[deepest] - self.grant.region.center(now)
        return deepest, np.asarray(way / max(float(np.linalg.norm(way)), 1e-9))

    def _along(self, body: MovingBody, q: JointVector, now: float) -> JointVector:
        """(n,) joint velocities [rad/s] to give way to a target that comes at it."""
        if not self.carried.any():
            return np.zeros(len(q))
        part, way = self._outward(body, q, now)
        coming = max(float(way @ self.carried), 0.0) * way
        J = body.jacobian(q, part)
        twist = np.concatenate([coming, np.zeros(3)])
        return np.asarray(J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(6), twist))

    def _away(self, body: MovingBody, q: JointVector, now: float) -> JointVector:
        """(n,) direction in which the deepest part moves straight away from the region."""
        part, way = self._outward(body, q, now)
        J = body.jacobian(q, part)[:3]
        return np.asarray(J.T @ np.linalg.solve(J @ J.T + 0.01 * np.eye(3), way))


def gap(body: MovingBody, grant: Grant, q: JointVector, now: float) -> float:
    """Distance [m] from the parts that may touch to the region, at (n,) [rad]; negative inside."""
    parts = np.flatnonzero(grant.touching[body.moving])
    if len(parts) == 0:
        return np.inf
    center, _ = body.motion(q, np.zeros(len(q)))
    away = grant.region.distance(center[parts], now) - body.radius[parts]
    return float(away.min())
