"""Backing out of a contact: brake, relax, and leave, slowly.

A permit that is withdrawn while the arm touches leaves it in contact. It then leaves along the path
that it came by, no faster than an arm that counts as standing, whatever any task wants, until the
parts that could touch are clear of the region. Where it came by no path, or one that leads along
the target or hardly away from it (it came along with something that moves), it leaves straight:
away from the region's centre and where it is pushed, by what the force sensor says, if the two
agree to within a right angle (a sensor may lie).

What holds the part that is in it, as a socket does, has one way out, which the task has named:
along it the arm leaves straight, turning nothing, the slower the harder it has to pull, and not at
all where it would pull harder than it was granted, or nobody feels how hard. On any other way out,
too, it is the slower the harder something is felt to be in the way, and ends where that presses as
hard as was granted.

What is touched goes on, for :data:`FOLLOWED`, as it did when it was last seen, or as the task goes
on to see it. Where it comes, the arm goes along with it, and leaves from there: from a stand that
comes at 6 cm/s, an arm that leaves with 4 would be pressed harder and harder. A thing that nobody
sees any more may swing back into an arm that stands: from there it leaves by ten centimetres.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.arrays import Floats, Ints, JointPath, JointVector, Points, Vector3
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.contact_speed import carried_along
from armsight.motion.executed import Executed
from armsight.motion.nearest import MovingBody
from armsight.motion.permits import Permit
from armsight.motion.permitted import Grant, permitted
from armsight.motion.regions import Region
from armsight.motion.steering import joints_of_twist

CLEAR = 0.02
"""The arm has left when what could touch is this far from the region [m]."""
LOST_CLEAR = 0.10
"""Or this far from a thing that nobody sees any more: it may come back [m] (V retreats so, too)."""
UNSEEN = 0.3
"""Nobody sees what was not seen for this long [s]."""
AHEAD = 1.0
"""And from where it comes to within this time [s]."""
FOLLOWED = 1.0
"""What nobody sees any more goes on as it did for this long [s], and then stays."""
PACE = 0.9
"""Share of the speed of an arm that counts as standing."""
ARRIVED = 0.01
"""A place of the way back is reached within this [rad]."""
CARRIED = 0.2
"""The target's velocity counts up to this [m/s]."""
REACH = 0.3
"""Least lever by which a joint's speed counts, where no part moves [m]."""
YIELDS, YIELDS_MOST = 0.01, 0.1
"""From a thing the arm leaves the faster the harder that presses: by so much for each newton
[m/s/N], and at most [m/s]. With the 4 cm/s of an arm that counts as standing alone, one that comes
on and is seen late stays pressed for as long as it comes."""
PUSHED = 1.5
"""A force of less says nothing of where the arm is pushed [N]."""


class Retreat:
    """One way out.

    Attributes:
        reason: why.
        grant: what could be touched, where it was believed last.
        braked: the arm has come to rest first.
        stands: the permit that was withdrawn, where the arm does not leave what holds it, but
            stands until that is permitted again, or presses harder than this permit allowed.
        began: when [s].
        felt: (3,) by how much what is touched comes faster than it is seen to [m/s].
    """

    def __init__(
        self, reason: str, grant: Grant, executed: Executed, q: JointVector, now: float
    ) -> None:
        self.reason = reason
        self.braked = False
        self.stands: Permit | None = None
        self.began = now
        self.felt: Vector3 = np.zeros(3)
        self._until = now + FOLLOWED
        self._seen = grant.region.exposure
        self.grant = replace(grant, region=replace(grant.region, drift=0.0))
        back: JointPath = executed.retrace(q, 1.0)
        self._places = [np.asarray(place) for place in back[1:]]

    @property
    def carried(self) -> Vector3:
        """(3,) velocity of the target [m/s], cut at :data:`CARRIED`."""
        velocity = self.grant.region.velocity + self.felt
        speed = float(np.linalg.norm(velocity))
        return np.asarray(velocity * min(1.0, CARRIED / max(speed, 1e-9)))

    @property
    def at_once(self) -> bool:
        """Whether it is left as soon as the drives can: a thing that holds nothing."""
        return not self.grant.person and self.grant.out is None

    def follow(self, region: Region, now: float) -> None:
        """What is touched was seen anew."""
        self._until, self._seen = now + FOLLOWED, now
        self.grant = replace(self.grant, region=replace(region, drift=0.0))

    def turn_back(self, back: float) -> None:
        """The clock was turned back by so much [s]."""
        self.began, self._until, self._seen = (
            at - back for at in (self.began, self._until, self._seen)
        )
        self.grant = replace(self.grant, region=self.grant.region.earlier(back))
        if self.stands is not None:
            self.stands = replace(self.stands, until=self.stands.until - back)

    def clearance(self, now: float) -> float:
        """How far from the region the arm has left [m]: what holds parts does not swing back."""
        may_swing = not self.grant.person and self.grant.out is None
        lost = may_swing and now > self._seen + UNSEEN
        return LOST_CLEAR if lost else CLEAR

    def grow_old(self, now: float) -> None:
        """What nobody has seen for long goes nowhere any more."""
        region = self.grant.region
        if now > self._until and region.speed > 0.0:
            self.grant = replace(self.grant, region=_at_rest(region, region.center(now), now))

    def motion(
        self,
        body: MovingBody,
        q: JointVector,
        now: float,
        speed: float,
        push: Vector3 | None = None,
    ) -> JointVector:
        """(n,) joint velocities of the next step [rad/s].

        No point is faster than a share of speed, besides what carries the arm along with a target
        that comes at it, and what gives way to a thing that presses.

        Args:
            body: the arm's moving parts.
            q: (n,) where it is [rad].
            now: time [s].
            speed: of an arm that counts as standing [m/s].
            push: (3,) force on the arm in ``base`` [N], where a sensor feels one.
        """
        if self.grant.out is not None:
            return self._pulled_out(body, q, now, speed, self.grant.out, push)
        while self._places and np.abs(self._places[0] - q).max() < ARRIVED:
            self._places.pop(0)
        part, out = self._outward(body, q, now, push)
        if push is not None and not self.grant.person:
            speed += min(YIELDS * max(float(push @ out), 0.0), YIELDS_MOST) / PACE
        J = np.asarray(body.jacobian(q, part), float)
        speed *= self._yielding(push, out)
        way = self._paced(body, q, _straight(J, out), speed)
        if self._places:
            back = self._paced(body, q, self._places[0] - q, speed)
            step, straight = J[:3] @ back, float(out @ J[:3] @ way)
            leaves = float(step @ out) >= 0.5 * float(np.linalg.norm(step))
            if leaves and float(step @ out) >= 0.5 * straight:
                way = back
        coming = self.carried - min(float(out @ self.carried), 0.0) * out  # sideways it rubs
        return np.asarray(way + carried_along(body, q, part, coming))

    def _pulled_out(
        self,
        body: MovingBody,
        q: JointVector,
        now: float,
        speed: float,
        out: Vector3,
        push: Vector3 | None,
    ) -> JointVector:
        """(n,) joint velocities [rad/s] along (3,) the one way out of what holds the arm's part."""
        if push is None or not self.grant.force > 0.0:
            return np.zeros(len(q))
        part, _ = _deepest(self.grant, body, q, now)
        J = np.asarray(body.jacobian(q, part), float)
        way = joints_of_twist(J, np.concatenate([out, np.zeros(3)]))
        return self._paced(body, q, way, self._yielding(push, out) * speed)

    def _yielding(self, push: Vector3 | None, out: Vector3) -> float:
        """The slower the harder the way out is blocked; it ends where that is what was granted."""
        if push is None or not self.grant.force > 0.0:
            return 1.0
        return 1.0 - float(np.clip(-(push @ out) / self.grant.force, 0.0, 1.0))

    def _paced(
        self, body: MovingBody, q: JointVector, way: JointVector, speed: float
    ) -> JointVector:
        """(n,) joint velocities [rad/s] along a way at which no point is faster than it may be."""
        length = float(np.abs(way).max())
        if length < 1e-9:
            return np.zeros(len(q))
        rate = way / length
        _, velocity = body.motion(q, rate)
        fastest = max(body.fastest(q, rate, velocity), REACH)
        return np.asarray(rate * (PACE * speed / fastest))

    def _outward(
        self, body: MovingBody, q: JointVector, now: float, push: Vector3 | None
    ) -> tuple[int, Vector3]:
        """The deepest part, and the direction (3,) in which it leaves."""
        deepest, center = _deepest(self.grant, body, q, now)
        way = center - self.grant.region.center(now)
        way = way / max(float(np.linalg.norm(way)), 1e-9)
        if push is not None and float(np.linalg.norm(push)) > PUSHED and float(push @ way) > 0.0:
            way = way + push / float(np.linalg.norm(push))
            way = way / float(np.linalg.norm(way))
        return deepest, np.asarray(way)


def _straight(J: Floats, out: Vector3) -> JointVector:
    """(n,) direction in which a part with a (6, n) Jacobian moves along (3,) a unit vector."""
    return np.asarray(J[:3].T @ np.linalg.solve(J[:3] @ J[:3].T + 0.01 * np.eye(3), out))


def behind(grant: Grant, body: MovingBody, q: JointVector, push: Vector3, now: float) -> Grant:
    """What pushes with (3,) a force [N] in ``base`` lies against the part that it pushes.

    Where it was seen last says nothing any more: the region is put, at rest, where it is felt.
    """
    region = grant.region
    part, center = _deepest(grant, body, q, now)
    inside = -float(region.distance(region.center(now)[None], now)[0])
    out = push / float(np.linalg.norm(push))
    there = center - (inside + float(body.radius[part])) * out
    return replace(grant, region=_at_rest(region, there, now), out=None)


def _at_rest(region: Region, center: Vector3, now: float) -> Region:
    """A region put at a place, where it stays."""
    T = np.array(region.T_base_region, float)
    T[:3, 3] = center
    return replace(region, T_base_region=T, exposure=now, velocity=np.zeros(3), drift=0.0)


def _deepest(grant: Grant, body: MovingBody, q: JointVector, now: float) -> tuple[int, Vector3]:
    """Of the parts that may touch the one deepest in the region, and where its centre is (3,)."""
    parts, center = _touching(grant, body, q)
    deepest = int(np.argmin(grant.region.distance(center, now)))
    return int(parts[deepest]), np.asarray(center[deepest])


def _touching(grant: Grant, body: MovingBody, q: JointVector) -> tuple[Ints, Points]:
    """(k,) the parts that may touch, and their centres (k, 3), at (n,) [rad]."""
    parts = np.flatnonzero(grant.touching[body.moving])
    center, _ = body.motion(q, np.zeros(len(q)))
    return parts, center[parts]


def gap(body: MovingBody, grant: Grant, q: JointVector, when: float) -> float:
    """Distance [m] from the parts that may touch to the region, at (n,) [rad]; negative inside."""
    parts, center = _touching(grant, body, q)
    if not len(parts):
        return np.inf
    away = grant.region.distance(center, when) - body.radius[parts]
    return float(away.min())


def gap_to_seen(
    body: MovingBody, grant: Grant, q: JointVector, snapshot: WorkspaceSnapshot
) -> float:
    """Distance [m] from the parts that may touch to what is seen in a person's region."""
    seen = permitted(snapshot, grant).touchable
    parts, center = _touching(grant, body, q)
    if not len(seen) or not len(parts):
        return np.inf
    away = np.linalg.norm(seen[None] - center[:, None], axis=2)
    return float((away.min(axis=1) - body.radius[parts] - snapshot.hazard_radius).min())
