"""How fast the parts that may touch come to the border of a permitted region, and move in it.

Separation asks nothing of them there. Instead they keep, towards the region, a speed from which
they can brake to the contact speed v_c at its border: with the distance D to it, the time T_a for
which the arm goes on as commanded, and the deceleration a ::

    D = v T_a + (v^2 - v_c^2) / (2 a)

solved for v; and never less than v_c. In the region no point of them moves faster than v_c, but out
of it: leaving presses nothing. Until November 2026 it did count, and of a ball that came at 10 cm/s
the tip could get away no faster than at 2. All speeds are relative to the region, which may move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from armsight.arrays import Floats, JointVector, Mask, Points, Vector3
from armsight.motion.clamping import Clamp
from armsight.motion.contact_kernels import BISECTIONS, Touch, eased_share, motion_shares
from armsight.motion.contact_limits import MOST
from armsight.motion.nearest import Hazards, MovingBody, SeparationView
from armsight.motion.regions import Region
from armsight.motion.separation_kernels import Law
from armsight.robots.kernels import carried_points

EASINGS = 8
"""Halvings of the share by which a wish is eased: to less than a hundredth of it."""
ROUNDING = 1e-3
"""A speed that is greater by so much is the same [m/s]."""
PRESSED = 1.5
"""A body that is pressed by less than this [N] goes its own way."""


@dataclass(frozen=True)
class GentleSpeed:
    """Power and force limiting: near somebody's hand or face every part of the arm may keep v.

    Separation from what is in the region is replaced by this speed, and only there: a part that
    separation would let go faster may, also one that comes to touch. Towards everything else
    separation holds as it always does.

    What is touched may move with V. A blow is as hard as the two are fast relative to each other,
    and an arm that may not go along with a face that comes is pressed by it: the parts that may
    touch keep v relative to some ``a V``, a in 0..1, from a target that stands to one that moves as
    it was seen, and the rest of the arm ``v + |V|``. So standing is always allowed. V counts only
    so far that no part is faster than :data:`.MOST`. The parts that may touch come to the target,
    its own coming included, no faster than v; where it comes faster by itself, not at all.

    Attributes:
        name: of the permit.
        touchable: what is in the region.
        speed: v, by :mod:`armsight.motion.contact_limits` [m/s].
        velocity: (3,) V of the region [m/s].
        parts: (m,) bool, spheres of the moving body that may touch; None for none.
        middle: (3,) the region's centre [m].
        clamp: where what is touched could be held fast.
    """

    name: str
    touchable: Hazards
    speed: float
    velocity: Vector3 = field(default_factory=lambda: np.zeros(3))
    parts: Mask | None = None
    middle: Vector3 = field(default_factory=lambda: np.zeros(3))
    clamp: Clamp = field(default_factory=Clamp)

    @property
    def carried(self) -> Vector3:
        """(3,) V as it counts [m/s]."""
        fastest = max(float(np.linalg.norm(self.velocity)), 1e-9)
        return np.asarray(self.velocity * min(1.0, max(MOST - self.speed, 0.0) / fastest))

    def ease(self, body: MovingBody, q: JointVector, wanted: JointVector, law: Law) -> JointVector:
        """The motion nearest to a wanted one (n,) [rad/s] in which the touching parts keep this.

        As :meth:`ContactSpeed.ease`: what carries them along with the region is kept.
        """
        if self.parts is None or not self.parts.any():
            return wanted
        along = carried_along(body, q, int(np.flatnonzero(self.parts)[-1]), self.carried)

        def kept(share: float) -> bool:
            motion = along + share * (wanted - along)
            center, velocity = body.motion(q, motion)
            spin = self._spin(body, q, motion)
            slow = self._excess(1.0, velocity, spin)[self.parts] <= 0.0
            coming = self._coming(center, velocity, spin).min()
            free = self.clamp.shares(center, velocity, body.radius)[self.parts].min()
            return bool(slow.all() and min(coming, free) >= 1.0)

        share = greatest_share(kept)
        if share == 1.0:
            return wanted
        far = body.view(q, wanted, self.touchable, law).share[self.parts].min()
        return wanted if far >= share else np.asarray(along + share * (wanted - along))

    def limit(
        self, view: SeparationView, body: MovingBody, q: JointVector, motion: JointVector, law: Law
    ) -> SeparationView:
        """The view of a motion (n,) [rad/s] at (n,) [rad] with this law in it."""
        if not len(self.touchable.blocks.points):
            return view
        near = body.view(q, motion, self.touchable, law)
        spin = self._spin(body, q, motion)
        coming = self._coming(view.center, view.velocity, spin)
        gentle = np.minimum(self._most(view.velocity, spin), coming)
        gentle = np.minimum(gentle, self.clamp.shares(view.center, view.velocity, body.radius))
        allowed = np.maximum(near.share, gentle)
        tighter = allowed < view.share
        return replace(
            view,
            share=np.where(tighter, allowed, view.share),
            limiting=np.where(tighter, -1, view.limiting),
        )

    def words(self, view: SeparationView, body: MovingBody, sphere: int) -> str:
        """Why a sphere's motion is limited by this law."""
        free = self.clamp.shares(view.center, view.velocity, body.radius)[sphere]
        if free <= view.share[sphere] + 1e-9:
            return (
                f"{self.name} could be pressed against something firm: comes to it at no more than "
                f"{self.clamp.speed:g} m/s"
            )
        return f"comes to {self.name} at no more than {self.speed:g} m/s"

    def gentle(self, body: MovingBody, q: JointVector, motion: JointVector) -> Mask:
        """(m,) bool, the spheres that keep v by this, to within rounding."""
        center, velocity = body.motion(q, motion)
        excess = self._excess(1.0, velocity, self._spin(body, q, motion))
        slow = excess <= 0.02 * self.speed + ROUNDING
        return np.asarray(
            slow & (self.clamp.shares(center, velocity, body.radius, ROUNDING) >= 1.0)
        )

    def _spin(self, body: MovingBody, q: JointVector, motion: JointVector) -> Floats:
        """(m,) speed that turning adds to the centre's at most [m/s]."""
        return np.asarray(body.turning(q, motion) * body.radius)

    def _excess(self, share: Floats | float, velocity: Points, spin: Floats) -> Floats:
        """(m,) by how much a share of a motion is too fast [m/s]: convex in the share."""
        V, s = self.carried, np.broadcast_to(np.asarray(share, float), spin.shape)
        moves = s[:, None] * velocity
        a = np.clip(moves @ V / max(float(V @ V), 1e-12), 0.0, 1.0)
        relative = np.linalg.norm(moves - a[:, None] * V, axis=1) - self.speed
        if self.parts is not None:
            free = np.linalg.norm(moves, axis=1) - self.speed - float(np.linalg.norm(V))
            relative = np.where(self.parts, relative, free)
        return np.asarray(relative + s * spin)

    def _most(self, velocity: Points, spin: Floats) -> Floats:
        """(m,) greatest share of a motion at which each sphere keeps v; more than 1 if it may."""
        total = np.linalg.norm(velocity, axis=1) + spin
        good = self.speed / np.maximum(total, 1e-9)  # beside a target that stands
        if not self.carried.any():
            return np.asarray(good)
        bad = (MOST + self.speed) / np.maximum(total, 1e-9)
        for _ in range(BISECTIONS):
            middle = 0.5 * (good + bad)
            fits = self._excess(middle, velocity, spin) <= 0.0
            good, bad = np.where(fits, middle, good), np.where(fits, bad, middle)
        return np.asarray(good)

    def _coming(self, center: Points, velocity: Points, spin: Floats) -> Floats:
        """(m,) share at which the touching parts come to the target slowly enough."""
        out = np.full(len(spin), np.inf)
        if self.parts is None:
            return out
        way = self.middle - center
        way = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        most = np.maximum(self.speed + way @ self.velocity, 0.0)
        toward = np.einsum("ij,ij->i", velocity, way)
        held = self.parts & (toward > 0.0)
        out[held] = most[held] / np.maximum((toward + spin)[held], 1e-9)
        return out


@dataclass(frozen=True)
class ContactSpeed:
    """The law of one permit at one time.

    Attributes:
        name: of the permit.
        parts: (m,) bool, spheres of the moving body that may touch.
        region: where; when: the time for which its place is taken [s].
        speed: v_c [m/s].
        margin: the border lies this far outside of the region: it is not known better [m].
        held: what is in it is held, as a plug in its socket: no way out of it is free.
        unsure: the region may come faster than it is known to by this [m/s]: the arm comes to its
            border by so much slower.
    """

    name: str
    parts: Mask
    region: Region
    when: float
    speed: float
    margin: float
    held: bool = False
    unsure: float = 0.0
    _placed: dict[tuple[bytes, float], Touch] = field(
        default_factory=dict, compare=False, repr=False
    )

    def limit(
        self, view: SeparationView, body: MovingBody, q: JointVector, motion: JointVector, law: Law
    ) -> SeparationView:
        """The view of a motion (n,) [rad/s] at (n,) [rad] with this law in it.

        A part that it limits has no limiting hazard (-1).
        """
        if not self.parts.any():
            return view
        allowed = np.full(len(self.parts), np.inf)
        rates = np.ascontiguousarray(motion, float)
        allowed[self.parts] = motion_shares(rates, self._touch(body, q, law))
        tighter = allowed < view.share
        return replace(
            view,
            share=np.where(tighter, allowed, view.share),
            limiting=np.where(tighter, -1, view.limiting),
        )

    def ease(self, body: MovingBody, q: JointVector, wanted: JointVector, law: Law) -> JointVector:
        """The motion nearest to a wanted one (n,) [rad/s] that keeps this law, at (n,) [rad].

        What carries the parts along with the region is kept: scaled as a whole, a motion would lag
        behind a region that moves, which is contact, too; and so is what leads away from it. Of the
        rest what closes in is slowed first, so that a part still comes to lie before its place
        while it comes slowly; where that is not enough, all of the rest is.
        """
        own = np.flatnonzero(self.parts)
        if len(own) == 0:
            return wanted
        touch = self._touch(body, q, law)
        along = carried_along(body, q, int(own[-1]), self.region.velocity)
        across, closes = self._across(body, q, wanted - along, touch)
        if across.any():
            base = wanted - across if closes else along + across
            share = eased_share(base, wanted - base, EASINGS, touch)
            if share >= 0.0:
                return wanted if share == 1.0 else base + share * (wanted - base)
        share = eased_share(along, wanted - along, EASINGS, touch)
        return along + share * (wanted - along) if 0.0 <= share < 1.0 else wanted

    def words(self, view: SeparationView, body: MovingBody, sphere: int) -> str:
        """Why a sphere's motion is limited by this law."""
        return f"comes to {self.name} at no more than {self.speed:g} m/s"

    def _across(
        self, body: MovingBody, q: JointVector, motion: JointVector, touch: Touch
    ) -> tuple[JointVector, bool]:
        """(n,) what of a motion [rad/s] brings the nearest part to the region, or away from it.

        And whether it is the first; zero where the second is not free.
        """
        nearest = int(np.argmin(touch.gap))
        part = int(np.flatnonzero(self.parts)[nearest])
        one = slice(nearest, nearest + 1)
        center = carried_points(touch.poses, touch.link[one], touch.local[one])
        outward = self.region.outward(center, self.when)[0]
        speed = float(outward @ (body.jacobian(q, part)[:3] @ motion))
        if speed > 0.0 and self.held:
            return np.zeros(len(q)), False
        return carried_along(body, q, part, speed * outward), speed < 0.0

    def _touch(self, body: MovingBody, q: JointVector, law: Law) -> Touch:
        """What the kernels are told of the parts at (n,) [rad]: a tick asks several times."""
        key = (q.tobytes(), law.T_arm)
        known = self._placed.get(key)
        if known is None:
            own = np.flatnonzero(self.parts)
            poses, link = body.poses(q), body.link[own]
            local, radius = body.local[own], body.radius[own]
            center = carried_points(poses, link, local)
            outward = self.region.outward(center, self.when) * (0.0 if self.held else 1.0)
            known = self._placed[key] = Touch(
                poses=poses,
                axis=body.robot.axis,
                brake=body.brake,
                link=link,
                local=local,
                radius=radius,
                gap=self.region.distance(center, self.when) - radius - self.margin,
                towards=self.region.towards(center, self.when),
                outward=outward,
                region=np.asarray(self.region.velocity, float),
                speed=float(self.speed),
                lag=float(law.T_arm),
                unsure=float(self.unsure),
            )
        return known


def own_motion(velocity: Vector3, push: Vector3 | None) -> Vector3:
    """(3,) what a body does by itself of a velocity (3,) [m/s] that was seen while it was pressed.

    What is pressed gives way as fast as the arm comes: an arm that took this for the body's own
    motion, and went along with it, would press on for ever. So away from the arm nothing counts.

    Args:
        velocity: as seen.
        push: (3,) force of the body on the arm [N]; None where nobody feels any.
    """
    strength = 0.0 if push is None else float(np.linalg.norm(push))
    if push is None or strength < PRESSED:
        return velocity
    out = push / strength
    return np.asarray(velocity - min(float(velocity @ out), 0.0) * out)


def carried_along(body: MovingBody, q: JointVector, part: int, velocity: Vector3) -> JointVector:
    """(n,) joint velocities [rad/s] that carry a sphere along with (3,) [m/s], without turning."""
    J = body.jacobian(q, part)
    twist = np.concatenate([velocity, np.zeros(3)])
    return np.asarray(J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(6), twist))


def greatest_share(kept: Callable[[float], bool]) -> float:
    """The greatest share of a wish at which a law is kept; 1 where not even none of it keeps it."""
    if kept(1.0) or not kept(0.0):
        return 1.0
    good, bad = 0.0, 1.0
    for _ in range(EASINGS):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if kept(middle) else (good, middle)
    return good
