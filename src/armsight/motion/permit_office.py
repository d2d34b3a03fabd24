"""Who may touch what: requests are granted, watched and withdrawn here, tick by tick."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from armsight.arrays import Mask
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.contact_speed import ContactSpeed
from armsight.motion.nearest import MovingBody
from armsight.motion.permits import (
    Permit,
    PermitRequest,
    PermitState,
    granted,
    region_refusal,
    request_fault,
)
from armsight.motion.permitted import (
    SURE,
    Grant,
    outside_the_map,
    permitted,
    somebody_beside,
)
from armsight.motion.regions import Region
from armsight.robots.robot import Robot

JUMP = 0.03
"""A target cannot be farther than this [m], beyond what is unsure, from where it was expected."""


class PermitOffice:
    """Keeps the one permit that a task may have.

    Attributes:
        permit: the newest answer; None while nothing is asked for.

    Args:
        robot: the arm with its tool; body: its moving parts; arm_error: Z_r [m].
    """

    def __init__(self, robot: Robot, body: MovingBody, arm_error: float) -> None:
        self.permit: Permit | None = None
        self._robot, self._body, self._arm_error = robot, body, arm_error
        self._request: PermitRequest | None = None
        self._grant: Grant | None = None
        self._looked: WorkspaceSnapshot | None = None

    @property
    def grant(self) -> Grant | None:
        """What may be touched now, or None."""
        return self._grant

    def consider(self, now: float, request: Any, snapshot: WorkspaceSnapshot | None) -> bool:
        """Answer what is asked at ``now`` [s]; true if what may be touched is another than before.

        Args:
            now: time [s].
            request: of the newest intent, or None.
            snapshot: the map in use, or None.
        """
        before = self._grant
        self._answer(now, request, snapshot)
        self._looked = snapshot
        permit = self.permit
        if permit is None or not permit.holds or permit.region is None:
            self._grant = None
        elif before is None or before.region is not permit.region:
            self._grant = Grant(permit.region, self._touching())
        return self._grant is not before

    def withdraw(self, reason: str) -> None:
        """What was granted is so no longer, from now on; the next tick counts without it."""
        if self.permit is not None and self.permit.holds:
            self.permit = replace(self.permit, state=PermitState.WITHDRAWN, reason=reason)
            self._grant = None

    def apply(self, snapshot: WorkspaceSnapshot) -> WorkspaceSnapshot:
        """A snapshot as the arm may count with it."""
        return snapshot if self._grant is None else permitted(snapshot, self._grant)

    def contact_speed(self, when: float) -> ContactSpeed | None:
        """The law for the parts that may touch at a time [s], or None."""
        if self._grant is None or self.permit is None:
            return None
        region = self._grant.region
        margin = self._arm_error + SURE * region.deviation(when)
        parts = self._grant.touching[self._body.moving]
        return ContactSpeed(self.permit.name, parts, region, when, self.permit.speed, margin)

    # -- inside ---------------------------------------------------------------------------------

    def _answer(self, now: float, request: Any, snapshot: WorkspaceSnapshot | None) -> None:
        if request is None or not math.isfinite(now):
            self._request, self.permit = None, None
            return
        name, kind = str(getattr(request, "name", "?")), getattr(request, "kind", "?")
        permit = self.permit
        if permit is None or (permit.name, permit.kind) != (name, kind):
            permit = self.permit = Permit(name, kind, PermitState.REFUSED)
        if permit.state == PermitState.WITHDRAWN:
            return
        reason = request_fault(request, self._robot, now)
        if not reason and permit.holds:
            reason = self._against(now, permit, request, snapshot)
        elif not reason:
            reason = self._refusal(now, request, snapshot)
        if not reason:
            self._request = request
            if not permit.holds:
                self.permit = granted(request, now)
        elif permit.holds:
            self.withdraw(reason)
        else:
            self.permit = replace(permit, reason=reason)

    def _refusal(
        self, now: float, request: PermitRequest, snapshot: WorkspaceSnapshot | None
    ) -> str:
        """Why a request is not granted now; empty when it is."""
        if snapshot is None:
            return "there is no map yet"
        if not self._touching(request).any():
            return (
                f"no sphere of {', '.join(request.parts)} is within {request.reach:g} m of the TCP"
            )
        return region_refusal(request.region, request.kind, now) or _seen_against(
            snapshot, request.region
        )

    def _against(
        self, now: float, permit: Permit, request: PermitRequest, snapshot: WorkspaceSnapshot | None
    ) -> str:
        """Why a permit does not hold any more; takes over the newest region otherwise."""
        assert permit.region is not None
        if now > permit.until:
            return "its time is over; ask for it anew"
        region = permit.region
        if request.region.exposure > region.exposure:
            away = float(
                np.linalg.norm(
                    request.region.center(request.region.exposure)
                    - region.center(request.region.exposure)
                )
            )
            when = request.region.exposure
            unsure = SURE * (region.deviation(when) + request.region.deviation(when))
            if away > JUMP + unsure:
                return f"it jumped by {away:.2f} m"
            region = request.region
        reason = region_refusal(region, permit.kind, now)
        if reason:
            return reason
        same = snapshot is self._looked and region is permit.region
        if snapshot is not None and not same:
            reason = _seen_against(snapshot, region)
            if reason:
                return reason
        if region is not permit.region:
            self.permit = replace(permit, region=region)
        return ""

    def _touching(self, request: PermitRequest | None = None) -> Mask:
        """(k,) bool, the spheres of the robot that a request names."""
        request = request or self._request
        assert request is not None
        robot = self._robot
        spheres, tool = robot.spheres, robot.tool
        out = np.isin(
            spheres.link,
            [k for k, name in enumerate(robot.link_names) if k and name in request.parts],
        )
        if "tool" in request.parts and tool is not None:
            out[len(spheres.link) - len(tool.spheres.radius) :] = True
        if math.isfinite(request.reach):
            T_last_tcp = robot.T_last_flange @ (np.eye(4) if tool is None else tool.T_flange_tcp)
            away = np.linalg.norm(spheres.center - T_last_tcp[:3, 3], axis=1)
            out &= (np.asarray(spheres.link) == robot.n) & (away <= request.reach)
        return out


def _seen_against(snapshot: WorkspaceSnapshot, region: Region) -> str:
    """What of the map speaks against touching something, in words; empty when nothing does."""
    if not math.isfinite(snapshot.stamp):
        return "no camera has sent a picture yet"
    if outside_the_map(snapshot, region):
        return "its region leaves the mapped box: nobody is looked for there"
    return somebody_beside(snapshot, region)
