"""Bodies that give way: people's hands and faces, what they hold, balls on stands.

Each follows a leader, which is where its own motion or its stand would have it, by a spring that a
muscle or a stand is (``hold``), and has the region's mass; on it sits its skin, a light body on
the spring of the region's surface. What pushes the skin moves it, and pushes the rest away.

Surfaces and masses are ISO/TS 15066's (:mod:`armsight.geometry.body_regions`). How firmly muscles
hold is not in there: a relaxed hand resists with 200-800 N/m (Mussa-Ivaldi, Hogan and Bizzi 1985),
a head by the neck with some thousands (assumption).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armsight.arrays import Floats, Ints, Pose, Vector3
from armsight.geometry.body_regions import BODY_REGIONS
from armsight.simulation.gl import mujoco
from armsight.simulation.kernels import follow_leaders
from armsight.simulation.model_parts import set_inertia

SKIN = (0.3, 0.1, 860.0)
"""Mass of a skin: a share of the body's, the most [kg], and no more than what swings this fast on
its spring [rad/s], which steps of 1 ms resolve: a heavy skin would strike by itself, and one of
0.1 kg on the 300 N/m of a brush struck with 5 N where the spring says 3."""
DENT = 0.05
"""No skin is dented by more along an axis [m]: a straw that bends on has its cup before it."""
SKIN_DAMPING = 0.5
"""Damping ratio of a skin on its spring."""
GYRATION = 0.05
"""Radius of gyration of a giving body [m]."""
JUMP = 0.25
"""A leader that is this far from where it was a moment ago [m] was put there, and its body with it:
led there in no time it would swing out beyond."""
TURN_RATE = 40.0
"""Natural frequency with which a body is turned back to its leader [rad/s]."""


@dataclass(frozen=True)
class Give:
    """How a body gives way.

    Attributes:
        mass: [kg]; surface: stiffness of its skin [N/m].
        hold: of the spring that leads it [N/m]; damping: ratio of that spring.
    """

    mass: float
    surface: float
    hold: float
    damping: float = 0.7


def _of_region(name: str, hold: float) -> Give:
    region = BODY_REGIONS[name]
    return Give(region.mass, region.stiffness, hold)


GIVING: dict[str, Give] = {
    "left_hand": _of_region("hand", 400.0),
    "right_hand": _of_region("hand", 400.0),
    "head": _of_region("face", 3000.0),
}
"""Parts of people that give way in cells where contact pushes; the others are noticed only."""


@dataclass(frozen=True)
class Giver:
    """A giving body in the model.

    Attributes:
        leader: mocap index of its leader.
        body: MuJoCo's name of the body that is led.
        give: how it gives way; center: (3,) centre of mass in the leader's frame [m].
    """

    leader: int
    body: str
    give: Give
    center: Vector3


def add_giving(world: Any, name: str, give: Give, center: Vector3, T: Pose) -> tuple[Any, Any]:
    """The two bodies of one that gives way: the led one, and the skin to hang shapes on.

    Args:
        world: MuJoCo's world body.
        name: of the leader.
        give: how it gives way.
        center: (3,) centre of mass in its frame [m].
        T: where it is at the start, in world.
    """
    body = world.add_body(name=f"{name}/led", pos=T[:3, 3], gravcomp=1.0)
    body.add_freejoint(name=f"{name}/led")
    light = min(SKIN[0] * give.mass, SKIN[1], give.surface / SKIN[2] ** 2)
    mass = give.mass - light
    set_inertia(body, mass, np.asarray(center, float), np.eye(3) * mass * GYRATION**2)
    skin = body.add_body(name=f"{name}/skin", gravcomp=1.0)
    set_inertia(skin, light, np.asarray(center, float), np.eye(3) * light * GYRATION**2)
    for k in range(3):
        skin.add_joint(
            name=f"{name}/skin/{k}",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=np.eye(3)[k],
            stiffness=give.surface,
            damping=2.0 * SKIN_DAMPING * np.sqrt(give.surface * light),
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            range=(-DENT, DENT),
        )
    return body, skin


class Followers:
    """Leads all giving bodies of a world, step by step."""

    def __init__(self, model: Any, givers: Sequence[Giver]) -> None:
        self._model = model
        joint = [int(model.body(g.body).jntadr[0]) for g in givers]
        self._leader: Ints = np.array([g.leader for g in givers], np.int64)
        rows = [
            (model.jnt_qposadr[j], model.jnt_dofadr[j], model.body(g.body).id)
            for j, g in zip(joint, givers)
        ]
        self._index: Ints = np.array(rows, np.int64).reshape(-1, 3)
        self._center = np.array([g.center for g in givers], float).reshape(-1, 3)
        mass = np.array([g.give.mass for g in givers])
        hold = np.array([g.give.hold for g in givers])
        ratio = np.array([g.give.damping for g in givers])
        turning = mass * GYRATION**2
        self._gains: Floats = np.stack(
            [
                hold,
                2.0 * ratio * np.sqrt(hold * mass),
                turning * TURN_RATE**2,
                2.0 * turning * TURN_RATE,
            ],
            axis=-1,
        ).reshape(-1, 4)
        count = len(givers)
        self._leaders = np.zeros((2, count, 7))
        self._span = (0.0, 1.0)

    def reset(self, data: Any) -> None:
        """Put every body where its leader is, at rest."""
        for k in range(len(self._leader)):
            self._put(data, k)
        self._look(data)
        self._leaders[0] = self._leaders[1]
        self._span = (0.0, 1.0)

    def note(self, data: Any, now: float, seconds: float) -> None:
        """The leaders have moved on at ``now`` [s]: bodies follow in the next ``seconds``."""
        self._leaders[0] = self._leaders[1]
        self._look(data)
        before, after = self._leaders
        for k in np.flatnonzero(np.linalg.norm(after[:, :3] - before[:, :3], axis=1) > JUMP):
            self._put(data, int(k))
            before[k] = after[k]
        self._span = (now, max(seconds, 1e-6))

    def push(self, data: Any, now: float) -> None:
        """Write the forces with which leaders pull their bodies in the step that begins now."""
        began, seconds = self._span
        share = min(max((now - began) / seconds, 0.0), 1.0)
        follow_leaders(
            self._leaders, share, seconds, self._index, self._center, self._gains,
            data.qpos, data.qvel, data.xfrc_applied,
        )  # fmt: skip

    def _put(self, data: Any, k: int) -> None:
        q, v, _ = self._index[k]
        data.qpos[q : q + 3] = data.mocap_pos[self._leader[k]]
        data.qpos[q + 3 : q + 7] = data.mocap_quat[self._leader[k]]
        data.qvel[v : v + 6] = 0.0

    def _look(self, data: Any) -> None:
        self._leaders[1, :, :3] = data.mocap_pos[self._leader]
        self._leaders[1, :, 3:] = data.mocap_quat[self._leader]
