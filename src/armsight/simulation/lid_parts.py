"""The finger beside a plug and the lid over a port, as one thing of the world: both or neither."""

from __future__ import annotations

from typing import Any

from armsight.arrays import Pose
from armsight.devices.world import MovingSolid
from armsight.geometry.pose import make_pose
from armsight.geometry.shapes import Solid
from armsight.simulation.finger import NAME, Finger
from armsight.simulation.gripper import SimulatedGripper
from armsight.simulation.lid import HALF, LEAF, THICK, Lid
from armsight.simulation.spec import FingerSpec, LidSpec, WorldSpec

STEEL = (0.55, 0.56, 0.58)


class LidParts:
    """Steps both, and says how they look.

    Args:
        model, data: MuJoCo's; spec: of the cell.

    Attributes:
        lid: the truth about it, or None.
    """

    def __init__(self, model: Any, data: Any, spec: WorldSpec) -> None:
        finger = None if spec.plug is None else spec.plug.finger
        lid = None if spec.socket is None else spec.socket.lid
        self._data = data
        self._finger = None if finger is None else Finger(model, data, finger)
        self.lid = None if lid is None else Lid(model, data, lid)
        self._drawn: list[tuple[str, Solid]] = []
        if finger is not None:
            self._drawn.append((NAME, _rod(finger)))
        if lid is not None and lid.there:
            self._drawn.append((LEAF, _leaf(lid)))

    def reset(self) -> None:
        """Back to time 0."""
        if self.lid is not None:
            self.lid.reset()

    def push(self, gripper: SimulatedGripper | None, now: float) -> None:
        """What acts on them in the next step, besides contact; the gripper drives the finger."""
        if self._finger is not None and gripper is not None:
            self._finger.push(gripper.wanted(now))
            out, speed = self._finger.out
            gripper.feel(0.5 * out, 0.5 * speed)
        if self.lid is not None:
            self.lid.push()

    def drawn(self) -> tuple[MovingSolid, ...]:
        """Both where they are now."""
        return tuple(
            MovingSolid(solid.name, solid, self._pose(body) @ solid.T_frame_solid)
            for body, solid in self._drawn
        )

    def _pose(self, name: str) -> Pose:
        body = self._data.body(name)
        return make_pose(body.xmat.reshape(3, 3), body.xpos)


def _rod(spec: FingerSpec) -> Solid:
    T = make_pose(None, (0.0, 0.0, -0.5 * spec.length))
    return Solid("lid finger", "cylinder", (spec.radius, spec.length, 0.0), T, STEEL)


def _leaf(spec: LidSpec) -> Solid:
    T = make_pose(None, (HALF, 0.0, 0.0))
    return Solid("car/lid", "box", (2.0 * HALF, 2.0 * HALF, THICK), T, spec.color)
