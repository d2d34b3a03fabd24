"""Who may touch what: requests are granted, watched and withdrawn here, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from armsight.arrays import Floats32, JointVector, Points, Vector3
from armsight.devices.data import JointState, Wrench
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.mapping.tracked import SURE
from armsight.motion.clamping import Clamp, firm_near
from armsight.motion.contact_speed import ContactSpeed, GentleSpeed, own_motion
from armsight.motion.executed import Executed
from armsight.motion.felt_velocity import FeltVelocity
from armsight.motion.force_watch import FELT, ForceWatch
from armsight.motion.guard_config import GuardConfig
from armsight.motion.known_before import KnownBefore
from armsight.motion.nearest import Hazards, MovingBody
from armsight.motion.permit_grounds import followed, jump, seen_against
from armsight.motion.permit_law import (
    ARM_ERROR,
    clamped_speed,
    floating,
    gentle_speed,
    pressing_speed,
    stopping_way,
    within_reach,
)
from armsight.motion.permits import (
    Permit,
    PermitRequest,
    PermitState,
    granted,
    region_refusal,
    request_fault,
    touching,
)
from armsight.motion.permitted import Grant, PermittedSnapshot, permitted
from armsight.motion.regions import Region
from armsight.motion.retreat import AHEAD, CLEAR, Retreat, behind, gap, gap_to_seen
from armsight.motion.told_velocity import ToldVelocity
from armsight.motion.tool_motion import ToolMotion
from armsight.robots.robot import Robot
from armsight.robots.sprung_tip import SprungTip

FREE = 0.5
"""More than this share of what is asked for must not be felt before it is granted."""
LATTICE = 0.03
"""A face is where its region is, seen or not: points at this distance stand for it [m]."""
HARD = 1e6
"""A thing of which nobody says how it gives way is as good as stone [N/m]."""
CREEP = 0.02
"""However unsure a thing's velocity is, it may be touched so fast relative to it [m/s]."""
AGAIN, QUIET, PUSHED = 10.0, 1.5, 2.5
"""For this long after a retreat [s] the arm gives way to a push that grows from less than QUIET to
more than PUSHED [N]."""
UNASKED = 0.5
"""In contact a permit outlives the last request by this much [s]: then nobody answers for it."""
PRESSED_ON = 5.0
"""And from somebody who still presses it the arm goes on leaving for this long [s]."""


class PermitOffice:
    """Keeps the one permit that a task may have.

    Attributes:
        permit: the newest answer; None while nothing is asked for.
        grant: what may be touched now, or None.
        retreat: the way out of a contact whose permit was withdrawn, or None.

    Args:
        robot: the arm with its tool; body: its moving parts; config: of the guard.
        executed: the way that the arm came.
    """

    def __init__(
        self, robot: Robot, body: MovingBody, config: GuardConfig, executed: Executed
    ) -> None:
        self.permit: Permit | None = None
        self.grant: Grant | None = None
        self.retreat: Retreat | None = None
        self._robot, self._body, self._config = robot, body, config
        self._executed = executed
        self._request: PermitRequest | None = None
        self._asked = -math.inf
        self._anew = False
        self._looked: WorkspaceSnapshot | None = None
        up = np.asarray(config.up, float)
        self._force = ForceWatch(robot, tuple(-9.81 * up))
        self._before = KnownBefore(robot, body)
        self._tool, self._pull = ToolMotion(robot), np.zeros(3)
        self._ceiling = (up, config.head_height - config.base_height)
        self._waiting: list[Wrench] = []
        self._q: JointVector | None = None
        self._now = 0.0
        self._left: tuple[Grant, float] | None = None
        self._firm: Floats32 = np.empty((0, 3), np.float32)
        self._quiet = False
        self._told, self._felt = ToldVelocity(), FeltVelocity(robot, config.start_delay)

    def feel(self, readings: Sequence[Wrench]) -> None:
        """Readings of the force sensor, oldest first; judged by the next :meth:`consider`."""
        self._waiting.extend(readings)

    def forget_times(self, now: float) -> None:
        """The clock jumped to ``now`` [s].

        Ahead, time may have passed. Back, it has not: what is granted ends, and what is touched is,
        as long from now as before.
        """
        if now < self._now:
            back = self._now - now
            self._asked -= back
            self._force.turn_back(back)
            if self._request is not None:
                asked = self._request.region.earlier(back)
                self._request = replace(self._request, region=asked)
            if self.permit is not None:
                region = None if self.permit.region is None else self.permit.region.earlier(back)
                self.permit = replace(self.permit, until=self.permit.until - back, region=region)
            if self.grant is not None:
                self.grant = replace(self.grant, region=self.grant.region.earlier(back))
            if self.retreat is not None:
                self.retreat.turn_back(back)
                self.grant = self.retreat.grant
            if self._left is not None:
                self._left = self._left[0], self._left[1] - back
        self._tool.forget()
        self._told.forget()
        self._felt.forget()
        self._waiting.clear()

    def consider(
        self,
        now: float,
        request: Any,
        snapshot: WorkspaceSnapshot | None,
        joints: JointState | None = None,
        command: JointVector | None = None,
    ) -> bool:
        """Answer what is asked at ``now`` [s]; true if what may be touched is another than before.

        Args:
            now: time [s].
            request: of the newest intent, or None.
            snapshot: the map in use, or None.
            joints: where the arm is; None where nobody knows.
            command: (n,) joint velocities that it was told last [rad/s], or None.
        """
        if not math.isfinite(now):
            return False  # whatever holds goes on when a time is told again
        before, self._now = self.grant, now
        if joints is not None:  # while nobody knows better, the arm is where it was: it brakes
            self._q, self._pull = np.asarray(joints.position, float), self._tool.take(joints)
            self._before.take(self._q)
            self._feel_contact(now, joints, command)
        self._answer(now, request, snapshot)
        self._looked = snapshot
        permit = self.permit
        if permit is not None and permit.holds and permit.region is not None:
            self.retreat = None
            if before is None or before.region is not permit.region or self._anew:
                self.grant, self._anew = self._grant(permit, permit.region), False
        elif self.retreat is None:
            self.grant = None
            self._give_way(now)
        elif not (self._touches(now) or self._pressed_on(now, self.retreat)):
            swings = self.retreat.grant.out is None  # what holds parts is bolted: it does not
            self._left, self._quiet = (self.retreat.grant, now) if swings else None, False
            self.retreat = self.grant = None
        else:
            self.retreat.grow_old(now)
            self.grant = self.retreat.grant
        if self.grant is None:
            self._told.forget()
            self._felt.forget()
        elif self.retreat is None:
            self._told.take(self.grant.region)
        else:
            self.retreat.felt = self._felt.faster
        if permit is not None and permit.holds:
            self.permit = replace(permit, pressed=self._force.pressed)
        return self.grant is not before

    def withdraw(self, reason: str, now: float, beside: bool = False) -> None:
        """What was granted is so no longer; an arm in contact backs out.

        Args:
            reason: in words.
            now: [s].
            beside: somebody may be beside what may be touched, or nobody asks for it any more. What
                holds a part of the arm is then not backed out of: it stands until that is permitted
                again.
        """
        if self.permit is None or not self.permit.holds:
            return
        before = self.permit
        self.permit = replace(
            before, state=PermitState.WITHDRAWN, reason=reason, pressed=self._force.pressed
        )
        if self._touches(now) and self.grant is not None and self._q is not None:
            self.retreat = Retreat(reason, self.grant, self._executed, self._q, now)
            self.retreat.stands = before if beside and self.one_way_out else None
            self.grant = self.retreat.grant

    @property
    def push(self) -> Vector3 | None:
        """(3,) force on the arm [N] in ``base``, by its force sensor; None where nobody says.

        Pulling at what holds it needs one that says it now.
        """
        if self.retreat is not None and self.retreat.grant.out is not None:
            return self._believed_push(self._now)
        return self._force.push

    def in_contact(self, now: float) -> bool:
        """Whether the parts that may touch are so near that a sideways motion would tear."""
        return self._touches(now)

    @property
    def leaves(self) -> bool:
        """Whether the arm is on its way out of a contact: not where it stands, held."""
        return self.retreat is not None and self.retreat.stands is None

    @property
    def one_way_out(self) -> bool:
        """Whether what may be touched holds the part that is in it, as a socket does."""
        return self.grant is not None and self.grant.out is not None

    def apply(self, snapshot: WorkspaceSnapshot) -> WorkspaceSnapshot:
        """A snapshot as the arm may count with it."""
        if self.grant is None:
            return snapshot
        if self.grant.person:
            self._firm = firm_near(snapshot, self.grant.region)
        return permitted(snapshot, self.grant)

    def law(
        self, when: float, q: JointVector | None, seen: WorkspaceSnapshot | None
    ) -> ContactSpeed | GentleSpeed | None:
        """The speed law of the permit at a time [s] for an arm at (n,) [rad], or None."""
        grant, permit = self.grant, self.permit
        if grant is None or not math.isfinite(when):
            return None
        name, speed = (permit.name, permit.speed) if permit is not None else ("", 0.0)
        if self.retreat is not None:
            speed = self._config.retreat_speed
        if not grant.person:
            stiffness = 0.0 if self._request is None else self._request.stiffness
            tip = floating(self._robot, self._request)
            speed = min(speed, pressing_speed(self._config, permit, stiffness, tip))
            unsure = 0.0 if self.retreat is not None else self._told.unsure(when)
            speed = max(speed - unsure, min(speed, CREEP))
            margin = ARM_ERROR + SURE * grant.region.deviation(when)
            parts, region = grant.touching[self._body.moving], self._felt.of(grant.region)
            held = grant.out is not None
            return ContactSpeed(name, parts, region, when, speed, margin, held, unsure)
        middle, slowly = grant.region.center(when), math.inf
        if self.retreat is None and q is not None and permit is not None:
            speed = min(speed, gentle_speed(self._robot, self._config, permit, middle, q))
            slowly = min(speed, clamped_speed(self._config, permit))
        touchable: Points = np.empty((0, 3))
        if isinstance(seen, PermittedSnapshot):
            touchable = seen.touchable.astype(float)
        # The arm may hide them from the map: a face is all of its region, a hand in its middle.
        face = grant.ceiling is None
        there = grant.region.lattice(when, LATTICE) if face else middle[None]
        touchable = np.concatenate([touchable, there])
        parts = grant.touching[self._body.moving]
        velocity = own_motion(grant.region.velocity, self._force.push)
        radius = 0.0 if seen is None else seen.hazard_radius
        near = Hazards.at(touchable, radius)
        clamp = Clamp(self._firm, near.blocks.points, radius, slowly)
        return GentleSpeed(name, near, speed, velocity, parts, middle, clamp)

    def _give_way(self, now: float) -> None:
        """What was touched comes back and pushes an arm that has left it: it leaves once more.

        Only a push that begins counts: a sensor that lies pushes all the time.
        """
        if self._left is None or self._q is None:
            return
        grant, since = self._left
        push = self._believed_push(now)
        if grant.person or now > since + AGAIN or push is None:
            return
        strength = float(np.linalg.norm(push))
        if strength < QUIET:
            self._quiet = True
        elif strength > PUSHED and self._quiet:
            grant = behind(grant, self._body, self._q, push, now)
            self.retreat = Retreat("what it touched pushes it", grant, self._executed, self._q, now)
            self.grant = self.retreat.grant

    def _pressed_on(self, now: float, retreat: Retreat) -> bool:
        """Whether a person whom the arm seems to have left still presses it: it goes on leaving.

        The arm hides from the cameras what lies against it. A sensor may lie, so not for long.
        """
        push = self._believed_push(now)
        if not retreat.grant.person or push is None or self._q is None:
            return False
        if float(np.linalg.norm(push)) <= PUSHED or now > retreat.began + PRESSED_ON:
            return False
        retreat.grant = behind(retreat.grant, self._body, self._q, push, now)
        return True

    # -- inside ---------------------------------------------------------------------------------

    def _believed_push(self, now: float) -> Vector3 | None:
        """(3,) force on the arm [N] in ``base``; None where no sensor can be believed."""
        return None if self._force.fault(now) else self._force.push

    def _feel_contact(self, now: float, joints: JointState, command: JointVector | None) -> None:
        """Judge every reading of the force sensor since the last tick."""
        if self._q is None:
            return
        latest = now + self._config.future  # one that lies about time would outdate all that follow
        readings = [reading for reading in self._waiting if reading.stamp <= latest]
        self._waiting = []
        self._force.take(readings, self._q, self._near(now), self._pull)
        retreat, permit, gives = self.retreat, self.permit, self._gives()
        reaches = self._reaches(now, joints, command)
        if self.grant is not None:
            push = self._force.push if reaches else None
            self._felt.take(joints, self.grant.region.velocity, push, gives, command)
        if retreat is not None and retreat.stands is not None:
            reason = self._force.excess(retreat.stands)
            if reason:  # it cannot stand there: out, along the one way
                retreat.stands, retreat.reason = None, reason
        if permit is None or not permit.holds:
            return
        silent = (
            ""
            if permit.kind == "thing" and math.isnan(self._force.pressed)
            else (self._force.fault(now))
        )
        deeper = stopping_way(self._config, *self._felt.closing)
        reason = silent or self._force.excess(permit, deeper, gives, reaches)
        if reason:
            self.withdraw(reason, now)

    def _reaches(self, now: float, joints: JointState, command: JointVector | None) -> bool:
        """Whether what is felt, and grows, may become a press of what may be touched."""
        grant, q = self.grant, self._q
        if grant is None or q is None or self.retreat is not None:
            return True
        if not self._force.pressed > FELT or self._touches(now):
            return True
        rates = [np.asarray(joints.velocity, float), *([] if command is None else [command])]
        return within_reach(self._body, grant, q, rates, now, self._told.unsure(now))

    def _gives(self) -> tuple[float, SprungTip] | None:
        """Stiffness of the thing that may be touched [N/m], and the tip on springs that may."""
        tip, request = floating(self._robot, self._request), self._request
        if tip is None or request is None or self.grant is None:
            return None
        return (request.stiffness if request.stiffness > 0.0 else HARD), tip

    def _answer(self, now: float, request: Any, snapshot: WorkspaceSnapshot | None) -> None:
        if request is None:
            self._unasked(now, snapshot)
            return
        self._asked = now
        name, kind = str(getattr(request, "name", "?")), str(getattr(request, "kind", "?"))
        permit, held = self.permit, None
        if permit is None or (permit.name, permit.kind) != (name, kind):
            held = permit if permit is not None and permit.holds else None
            permit = self.permit = Permit(name, kind, PermitState.REFUSED)
        reason, beside = request_fault(request, self._robot, now), False
        if not permit.holds:  # the map follows what is asked for, granted or not
            tracked = None if reason else followed(request, now)
            permit = self.permit = replace(permit, region=tracked)
        if self.retreat is not None and not reason:
            self._follow(now, self.retreat, request, snapshot)
        if permit.state == PermitState.WITHDRAWN:
            return
        if not reason and permit.holds:
            reason, beside = self._against(now, permit, request, snapshot)
        elif not reason:
            tare = self._before.tare(request, now)
            was_in = tare is not None and self._force.know(tare)
            reason, beside = self._refusal(now, request, snapshot, was_in)
        if not reason:
            self._anew = self._anew or not _same_terms(self._request, request)
            self._request = request
            if not permit.holds:
                hardest = {"thing": self._config.thing_force, "hand": self._config.hand_force}
                most = hardest.get(request.kind, math.inf)
                self.permit = granted(request, now, self._force.fault(now), most)
        elif permit.holds:
            self.withdraw(reason, now, beside)
        elif held is not None and self._touches(now):
            # It touches by the permit before this one: that ends as any does, by the way out.
            self.permit = replace(held, name=name, kind=kind)
            self.withdraw(reason, now, beside)
        else:
            self.permit = replace(permit, reason=reason)

    def _unasked(self, now: float, snapshot: WorkspaceSnapshot | None) -> None:
        """No task asks: what is touched nevertheless is left as when a permit is withdrawn."""
        permit, asked = self.permit, self._request
        if permit is None or asked is None or not permit.holds or not self._touches(now):
            self._request, self.permit = None, None
            return
        reason, beside = self._against(now, permit, asked, snapshot)
        if not reason and now > self._asked + UNASKED:
            reason, beside = "no task asks for it any more", True
        if reason:
            self.withdraw(reason, now, beside)

    def _refusal(
        self, now: float, request: PermitRequest, snapshot: WorkspaceSnapshot | None, was_in: bool
    ) -> tuple[str, bool]:
        """Why a request is not granted now, and whether somebody may be beside its region.

        Who was in contact before the guard began surprises nobody by pressing.
        """
        if snapshot is None:
            return "there is no map yet", False
        stands = self.retreat is not None and self.retreat.stands is not None
        if self.retreat is not None and not stands:
            return f"the arm still backs out: {self.retreat.reason}", False
        if not touching(self._robot, request).any():
            parts = ", ".join(request.parts)
            return f"no sphere of {parts} is within {request.reach:g} m of the TCP", False
        if request.kind != "thing":
            reason = self._force.fault(now)
            if reason:
                return f"nobody would feel how hard it presses: {reason}", False
        pressed = self._force.pressed
        if pressed > FREE * request.force and not (stands or was_in):
            return f"the force sensor feels {pressed:.1f} N before anything is touched", False
        if request.kind == "face" and not self._config.soft > 0.0:
            return "the tool's tip is not declared soft (guard.soft_tip_n_per_mm)", False
        reason = region_refusal(request.region, request.kind, now)
        if reason:
            return reason, False
        reason = seen_against(snapshot, request.region, request.kind)
        return reason, bool(reason)

    def _against(
        self, now: float, permit: Permit, request: PermitRequest, snapshot: WorkspaceSnapshot | None
    ) -> tuple[str, bool]:
        """Why a permit does not hold any more, and whether somebody may be beside its region.

        Takes over the newest region where nothing speaks against it.
        """
        assert permit.region is not None
        if now > permit.until:
            return "its time is over; ask for it anew", False
        region = permit.region
        if request.region.exposure > region.exposure:
            away = jump(region, request.region)
            if away > 0.0:
                return f"it jumped by {away:.2f} m", False
            region = request.region
        reason = region_refusal(region, permit.kind, now, held=True)
        if reason:
            return reason, False
        same = snapshot is self._looked and region is permit.region
        if snapshot is not None and not same:
            reason = seen_against(snapshot, region, permit.kind)
            if reason:
                return reason, True
        if region is not permit.region:
            self.permit = replace(permit, region=region)
        return "", False

    def _follow(
        self,
        now: float,
        retreat: Retreat,
        request: PermitRequest,
        snapshot: WorkspaceSnapshot | None,
    ) -> None:
        """The arm backs out of what goes on to be seen: from where it is, not from where it was."""
        region, before = request.region, retreat.grant.region
        if region.exposure <= before.exposure or jump(before, region) > 0.0:
            return
        at_rest = replace(region, velocity=np.zeros(3))  # too fast to be touched, not to be left
        if region_refusal(at_rest, request.kind, now):
            return
        if snapshot is not None and not seen_against(snapshot, region, request.kind):
            retreat.follow(region, now)

    def _grant(self, permit: Permit, region: Region) -> Grant:
        ceiling = self._ceiling if permit.kind == "hand" else None
        assert self._request is not None
        parts = touching(self._robot, self._request)
        if permit.kind != "thing":
            return Grant(region, parts, True, ceiling)
        out = self._request.out
        return Grant(
            region, parts, out=None if out is None else np.asarray(out), force=permit.force
        )

    def _near(self, now: float) -> bool:
        """Whether what is felt may be contact: the map need not show it, where the arm hides it."""
        if self.grant is None or self._q is None:
            return False
        return gap(self._body, self.grant, self._q, now) < CLEAR or self._touches(now)

    def _touches(self, now: float) -> bool:
        """Whether the parts that may touch are so near that leaving begins there.

        In the large region of a hand that is where the map shows it, or where it is felt.
        """
        grant, q = self.grant, self._q
        if grant is None or q is None:
            return False
        ahead: tuple[float, ...] = ()
        clear = CLEAR
        if self.retreat is not None:
            ahead, clear = (now + AHEAD,), self.retreat.clearance(now)
        if min(gap(self._body, grant, q, t) for t in (now, *ahead)) < clear and (
            grant.ceiling is None or self._force.pressed > FELT
        ):
            return True
        if not grant.person or self._looked is None:
            return False
        return gap_to_seen(self._body, grant, q, self._looked) < CLEAR


def _same_terms(a: PermitRequest | None, b: PermitRequest) -> bool:
    """Whether two requests ask for the same of what is in their region."""
    if a is None or (a.kind, a.parts, a.reach, a.force) != (b.kind, b.parts, b.reach, b.force):
        return False
    if a.out is None or b.out is None:
        return a.out is b.out
    return bool(np.array_equal(a.out, b.out))
