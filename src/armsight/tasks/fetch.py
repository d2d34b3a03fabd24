"""Fetching an item from where items lie: above it, down, grip, see that it is held, and up.

Where that is stands in the cell's file; nobody looks for the item. So the gripper has to say what
came of it: closed on nothing, held apart by something, or not closed at all.
"""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import Pose
from armsight.errors import UsageError
from armsight.geometry.pose import inverse, make_pose
from armsight.geometry.shapes import Solid
from armsight.motion.asking import AskAnew
from armsight.motion.intents import Intent, PoseIntent, Rest
from armsight.motion.permits import PermitRequest, PermitState
from armsight.motion.regions import Region
from armsight.motion.task import Observation
from armsight.robots.held import holding
from armsight.robots.kinematics import tcp_jacobian, tcp_pose
from armsight.robots.robot import Robot
from armsight.workcell.schema import Workcell

ABOVE, HIGHER = 0.12, 0.005
"""So far above the item's middle the TCP waits, and so far above it it grips [m]."""
MARGIN = 0.012
"""What may be touched reaches so far beyond the item [m]: it need not lie as exactly as that."""
REACH = 0.12
"""So much of the tool, from its tip, may touch it [m]."""
FORCE, SPEED, STIFFNESS = 10.0, 0.1, 2.5e3
"""Of the touch [N], [m/s]; what lies loose gives way to rubber fingers like this [N/m]."""
CLOSES, JAMMED = 0.3, 4.0
"""What a gripper is given to close, and to say so [s]; then it is jammed."""
SOFTLY, SLOWLY = 1.3, 0.03
"""From so many times the item's width on fingers close no faster than this [m/s]: at their own
speed they struck the wrist with 4 N, rising, which the guard took for a press."""
ON = 0.005
"""Fingers told to come so much closer [m] that stand are on something."""
NOTHING = 0.3
"""Fingers nearer to each other than this share of the item's least width hold nothing ..."""
WIDER = 1.4
"""... and fingers that stand farther apart than this times its greatest hold something else."""
LATE = 30.0
"""A way that takes longer is given up [s]."""
TRIES = 2
"""So often it is tried."""


class Fetch:
    """Takes an item into the gripper.

    Args:
        T_base_item: its middle, z upwards.
        size: its edges [m].
        opening: width of the open gripper [m].

    Attributes:
        phase: over, down, grip, up, held or failed.
        words: what it does, or why it failed.
    """

    def __init__(self, T_base_item: Pose, size: tuple[float, float, float], opening: float) -> None:
        self.T_base_item, self.size, self.opening = T_base_item, size, opening
        self.reset()

    def reset(self) -> None:
        """From the beginning."""
        self.phase, self.words = "over", "on the way to where items lie"
        self._since, self._tries = math.nan, 1
        self._grip: Pose | None = None
        self._asking = AskAnew()
        self._lifted = self.T_base_item

    @property
    def done(self) -> bool:
        """Whether it has ended, one way or the other."""
        return self.phase in ("held", "failed")

    def update(self, observation: Observation) -> Intent:
        """What is wanted in this round, before the item is held."""
        now, joints = observation.now, observation.joints
        if joints is None:
            return Rest("no joint reading yet")
        if math.isnan(self._since):
            self._since = now
        if self._grip is None:
            self._grip = self._pose(tcp_pose(observation.robot, joints.position))
        if self.phase == "grip":
            self._gripped(observation)
        elif not self.done and self._arrived(observation):
            self._next(now)
        elif not self.done and now > self._since + LATE:
            why = "" if observation.guard is None else observation.guard.reason
            self._fail(f"could not come to where items lie: {why or 'it took too long'}")
        return self._intent(observation)

    def _next(self, now: float) -> None:
        """The phase after one that is on its way."""
        after = {"over": "down", "down": "grip", "up": "held"}
        self._begin(after[self.phase], now)

    def _begin(self, phase: str, now: float) -> None:
        words = {
            "over": "tries once more: nothing was between the fingers",
            "down": "comes down to the item",
            "grip": "closes the gripper",
            "up": "lifts the item",
            "held": "the item is held",
        }
        self.phase, self.words, self._since = phase, words[phase], now

    def _fail(self, words: str) -> None:
        self.phase, self.words = "failed", words

    def _arrived(self, observation: Observation) -> bool:
        """Whether it is where this phase leads; what slipped on the way up ends it."""
        guard, gripper = observation.guard, observation.gripper
        if self.phase == "up" and gripper is not None and self._holds(gripper.width) != "it":
            self._fail("the item has slipped out of the gripper while it was lifted")
            return False
        opened = self.phase != "over" or gripper is None or gripper.width > 0.8 * self.opening
        there = guard is not None and guard.reached and guard.goal == self._name
        return there and opened

    def _gripped(self, observation: Observation) -> None:
        """What the fingers say, once they stand."""
        now, gripper = observation.now, observation.gripper
        if now < self._since + CLOSES:
            return
        if gripper is None:
            self._fail("no gripper says whether it holds anything")
            return
        late = now > self._since + JAMMED
        wish = self._closing(now)
        on = wish < gripper.width - ON or wish == 0.0
        if (gripper.moving or not on) and not late:
            return
        wide = 1e3 * gripper.width
        found = self._holds(gripper.width)
        if found == "it" and gripper.holding is not False:
            self._begin("up", now)
        elif found == "nothing":
            if self._tries < TRIES:
                self._tries += 1
                self._begin("over", now)
            else:
                self._fail(
                    f"no item where items lie: the gripper closed on nothing ({wide:.0f} mm)"
                )
        elif late:
            self._fail(
                f"the gripper did not close on the item: {wide:.0f} mm; it is jammed, or holds "
                "something else"
            )

    def _closing(self, now: float) -> float:
        """How far apart the fingers shall be that close on the item [m]."""
        begins = min(SOFTLY * max(self.size[:2]), self.opening)
        return max(begins - SLOWLY * max(now - self._since - CLOSES, 0.0), 0.0)

    def _holds(self, width: float) -> str:
        """What fingers so far apart [m] hold: it, nothing or something else."""
        least, most = min(self.size[:2]), max(self.size[:2])
        if width < NOTHING * least:
            return "nothing"
        return "it" if width < WIDER * most else "something else"

    @property
    def _name(self) -> str:
        """Of the goal of this phase."""
        return {"over": "above the items", "down": "the item", "up": "lifted"}.get(self.phase, "")

    def _intent(self, observation: Observation) -> Intent:
        grip = self._grip
        assert grip is not None
        open_width = self.opening if self.phase in ("over", "down") else 0.0
        if self.phase == "grip":
            open_width = self._closing(observation.now)
        if self.phase == "failed":
            return Rest(self.words)
        if self.phase == "grip":
            return Rest(self.words, permit=self._permit(observation), width=open_width)
        if self.phase == "held":
            return Rest(self.words, width=open_width)
        T = grip.copy()
        if self.phase != "down":
            T[:3, 3] += ABOVE * self.T_base_item[:3, 2]
        # Without a permit what lies there may be a person, and is kept away from.
        again = self.phase == "up" or self._asking.may_ask(observation.guard)
        permit = self._permit(observation) if again else None
        return PoseIntent(
            self._name, T, tolerance=0.003, tolerance_rad=0.02, permit=permit, width=open_width
        )

    def _permit(self, observation: Observation) -> PermitRequest:
        """To touch the item where it lies, or where the fingers have it."""
        T, velocity = self.T_base_item, np.zeros(3)
        joints = observation.joints
        assert joints is not None
        assert self._grip is not None
        permit = None if observation.guard is None else observation.guard.permit
        leaves = permit is not None and permit.state is PermitState.WITHDRAWN
        if self.phase == "up" and leaves:  # nothing that is carried along is ever left
            T = self._lifted
        elif self.phase == "up":
            tip = tcp_pose(observation.robot, joints.position)
            T = make_pose(T[:3, :3], T[:3, 3] + tip[:3, 3] - self._grip[:3, 3])
            velocity = (tcp_jacobian(observation.robot, joints.position) @ joints.velocity)[:3]
            self._lifted = T
        a, b, c = (edge + 2.0 * MARGIN for edge in self.size)
        region = Region(
            "box", (a, b, c), T, joints.stamp, velocity, 0.003**2 * np.eye(3), 0.0
        )  # fmt: skip
        return PermitRequest(
            "item", "thing", region, reach=REACH, speed=SPEED, force=FORCE, stiffness=STIFFNESS,
            seconds=60.0, out=self.T_base_item[:3, 2].copy(),
        )  # fmt: skip

    def _pose(self, tcp: Pose) -> Pose:
        """``T_base_tcp`` over the item, the fingers along that edge which turns the hand least."""
        up = self.T_base_item[:3, 2]
        ways = [s * self.T_base_item[:3, k] for k in (0, 1) for s in (1.0, -1.0)]
        y = max(ways, key=lambda way: float(way @ tcp[:3, 1]))
        R = np.stack([np.cross(y, -up), y, -up], axis=1)
        return make_pose(R, self.T_base_item[:3, 3] + HIGHER * up)


def with_item(robot: Robot, size: tuple[float, float, float]) -> Robot:
    """An arm whose gripper counts as holding an item, all the time.

    The guard knows no arm that changes: so an empty gripper keeps what it may hold clear as well,
    and what it holds is no stranger beside it.

    Args:
        robot: with its gripper.
        size: of the item, its last edge along the gripper [m].
    """
    tool = robot.tool
    assert tool is not None
    T = tool.T_flange_tcp @ make_pose(None, (0.0, 0.0, HIGHER))
    wide = max(size[:2])  # along either edge, as it is gripped
    item = Solid("item", "box", (wide, wide, size[2]), T)
    return robot.without_tool().with_tool(holding(tool, [item]))


def fetch_in(workcell: Workcell, opening: float, T_world_base: Pose) -> Fetch:
    """Fetching in a cell, from where its file says that items lie.

    Args:
        workcell: the cell.
        opening: width of the open gripper [m].
        T_world_base: where its robot stands.

    Raises:
        UsageError: the file says nothing of it, or the gripper is too small.
    """
    items = workcell.items
    if items is None:
        raise UsageError(
            f"{workcell.file or workcell.name}: says of no place where items lie; add [items] with "
            "the position of one, or put it into the gripper and leave fetch out"
        )
    if min(items.size[:2]) > 0.9 * opening:
        raise UsageError(
            f"{workcell.file or workcell.name}: items of {1e3 * min(items.size[:2]):.0f} mm do not "
            f"go into a gripper that opens to {1e3 * opening:.0f} mm"
        )
    angle = math.radians(items.yaw_deg)
    c, s = math.cos(angle), math.sin(angle)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    T_world_item = make_pose(R, items.position)
    return Fetch(np.asarray(inverse(T_world_base) @ T_world_item), items.size, opening)
