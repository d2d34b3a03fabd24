"""What a task of visual servoing is made of: a target, the way to it, and what may be touched.

One :class:`Docking` a task; a new one (a spoon, a tool) is a detector and one of these.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from armsight.arrays import Floats, Pose, Vector3
from armsight.geometry.pose import cross, make_pose
from armsight.motion.permits import LIMITS, ContactKind, PermitRequest
from armsight.motion.regions import Region, RegionShape
from armsight.robots.sprung_tip import SprungTip, press_depth
from armsight.servoing.eyes import Target
from armsight.servoing.targets.ball import Ball
from armsight.servoing.targets.bullseye import Bullseye
from armsight.servoing.targets.held_ball import HeldBall
from armsight.servoing.targets.mouth import Mouth
from armsight.servoing.targets.palm import Palm

Direction: TypeAlias = Literal["facing", "normal", "down"]
"""How the tool points: towards the operator's side, against the target's normal, or down."""
SURE = 0.01
"""The place of a thing is never surer than if it drifted so fast [m/s]."""
DOCK_NAMES: tuple[str, ...] = ("ball", "held_ball", "bullseye", "straw", "hand")


@dataclass(frozen=True)
class Touchable:
    """Where the target was.

    Attributes:
        stamp: [s]; position: (3,) [m], velocity: (3,) [m/s], covariance: (3, 3) [m^2], in ``base``.
        margin: what it may reach beyond its own size about that [m].
        drift: how fast its place becomes unsure while nobody sees it [m/s].
        normal: (3,) unit, out of its surface, where it has a face that was seen; else None.
        along: (3,) unit, where it goes on beyond its point (a forearm), where that was seen.
        seen: newest exposure that showed it [s], where the stamp may be that of another picture.
    """

    stamp: float
    position: Vector3
    velocity: Vector3
    covariance: Floats
    margin: float = 0.0
    drift: float = 0.1
    normal: Vector3 | None = None
    along: Vector3 | None = None
    seen: float = math.inf


@dataclass(frozen=True)
class Docking:
    """A target, the way to it, and what is asked of the guard.

    Attributes:
        name: of the task; detector: makes what finds its target in pictures.
        direction: how the tool points.
        turned: share of the way from there to against the target's normal that ``normal`` takes.
        radius: of the target's surface about its point [m]; 0 for a plane.
        gap: how far before the surface the tip ends [m]; below 0 presses.
        permit: kind of the contact permit.
        shape, size: of the region, see :class:`~armsight.motion.regions.Region`; a capsule lies
            along the target (towards the person's side where nobody saw how it lies), a box on the
            surface.
        offset: of its centre from the target: along the normal, up, and along the target [m].
        reach: that much of the tool, from its tip, may touch [m].
        gentle: speed of the tip near somebody's part [m/s]: what the guard allows there.
        speed: of the touch [m/s]; force: [N]; stiffness: of the target and what holds it [N/m].
        drift: how fast its place becomes unsure while nobody sees it, at most [m/s]; a thing's less
            where its velocity is known better.
        scale: of the fixed cameras' colour pictures: a ring of 15 mm needs all of their pixels.
        wary: from what strays from its prediction the tip leaves as soon as it has touched it.
        planned: the guard's planner leads the arm before it, past who holds it.
        creeps: a tip that stands where the surface should be and feels nothing goes on by this much
            at most, slowly, until something is felt [m] (:mod:`~armsight.servoing.creeping`).
    """

    name: str
    detector: Callable[[], Target]
    direction: Direction = "facing"
    turned: float = 1.0
    radius: float = 0.0
    gap: float = 0.0
    permit: ContactKind = "thing"
    shape: RegionShape = "sphere"
    size: tuple[float, float, float] = (0.04, 0.0, 0.0)
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    reach: float = 0.06
    gentle: float = math.inf
    speed: float = 0.15
    force: float = 10.0
    stiffness: float = 5e3
    drift: float = 0.06
    scale: float = 1.0
    wary: bool = False
    planned: bool = False
    creeps: float = 0.0

    def reserve(self, tip: SprungTip | None = None) -> float:
        """How wrong a prediction of it may be [m]: then it is pressed with half of the force.

        Args:
            tip: how the tool's own tip gives way; None where it does not.
        """
        return press_depth(0.5 * self.force, self.stiffness, tip) if self.wary else math.inf

    def request(
        self, seen: Touchable, otherwise: Vector3, up: Vector3, front: Vector3
    ) -> PermitRequest:
        """What is asked of the guard.

        Args:
            seen: the target.
            otherwise: (3,) unit, taken for its normal where nobody knows that.
            up: (3,) unit, in ``base``.
            front: (3,) unit, towards the person's side.
        """
        normal = otherwise if seen.normal is None else seen.normal
        side = front if seen.along is None else seen.along
        a, b, c = self.size
        if self.shape == "box":
            size = (a, b, c + 2.0 * seen.margin)
        elif self.shape == "sphere":  # no larger than what may be had: what sticks out keeps S_p
            size = (min(a + seen.margin, 0.5 * LIMITS[self.permit].extent), b, c)
        else:
            size = (a + seen.margin, b, c)
        center = seen.position + self.offset[0] * normal + self.offset[1] * up
        center = center + self.offset[2] * side
        stamp = seen.stamp
        if self.permit != "thing":  # of somebody a picture that did not show them is no evidence
            stamp = min(stamp, seen.seen)
            center = center + (stamp - seen.stamp) * seen.velocity
        region = Region(
            self.shape,
            size,
            facing_pose(center, side if self.shape == "capsule" else normal),
            stamp,
            seen.velocity,
            seen.covariance,
            min(max(seen.drift, SURE), self.drift) if self.permit == "thing" else self.drift,
        )
        return PermitRequest(
            self.name, self.permit, region, reach=self.reach, speed=self.speed, force=self.force,
            stiffness=self.stiffness, seconds=20.0,
        )  # fmt: skip


def facing_pose(place: Vector3, normal: Vector3) -> Pose:
    """A frame at a place whose z is a normal; its turn about that is arbitrary."""
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    x = cross(helper, normal)
    x /= np.linalg.norm(x)
    return make_pose(np.stack([x, cross(normal, x), normal], axis=1), place)


def docking(name: str, ball_radius: float = 0.04) -> Docking:
    """The docking of one of V's tasks, by its name (:data:`DOCK_NAMES`).

    Args:
        name: ``ball``, ``held_ball``, ``bullseye``, ``straw`` or ``hand``.
        ball_radius: of the red ball [m].

    Raises:
        KeyError: there is no such task.
    """
    return {
        # On a light stand: nobody is beside it.
        "ball": Docking(
            "ball", lambda: Ball(ball_radius), radius=ball_radius, size=(ball_radius, 0.0, 0.0),
            stiffness=2.5e3, scale=0.5, wary=True, creeps=0.015,
        ),
        # The same in somebody's gloved hand, with the arm behind it: as long as the tip needs to be
        # away from the rest of them, and so narrow that beside an arm's length no head is in it.
        "held_ball": Docking(
            "held_ball", lambda: HeldBall(ball_radius), radius=ball_radius, permit="hand",
            shape="capsule", size=(0.16, 0.42, 0.0), offset=(0.0, 0.0, 0.19), gentle=0.25,
            speed=0.25, force=75.0, stiffness=2.5e3, drift=0.08, scale=0.5, wary=True, planned=True,
            creeps=0.015,
        ),
        # Its plate has 16 cm; how it is turned about its middle nobody knows. The region ends with
        # what is printed: from before it the tip comes as slowly as a stiff one may press.
        "bullseye": Docking(
            "bullseye", Bullseye, "normal", shape="box", size=(0.19, 0.19, 0.014),
            offset=(-0.007, 0.0, 0.0), drift=0.03,
        ),
        # The head behind and above the mouth; a straw bends before anything gives way. It need not
        # come along the normal, for which the wrist would fold against the forearm.
        "straw": Docking(
            "straw", Mouth, "normal", turned=0.5, gap=-0.012, permit="face", size=(0.22, 0.0, 0.0),
            offset=(-0.06, 0.045, 0.0), reach=0.08, gentle=0.09, speed=0.1, force=5.0,
            stiffness=150.0,
        ),
        # The hand with the forearm behind it; the item is let go above the palm.
        "hand": Docking(
            "hand", Palm, "down", gap=0.07, permit="hand", shape="capsule", size=(0.11, 0.20, 0.0),
            offset=(0.0, 0.0, 0.09), reach=0.10, gentle=0.115, speed=0.25, force=25.0, drift=0.08,
        ),
    }[name]  # fmt: skip
