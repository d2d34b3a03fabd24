"""Who comes in an episode of ``approach``, from where, and whose hand goes for the arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Vector3
from armsight.experiments.episodes import find_clips

if TYPE_CHECKING:
    from pathlib import Path

    from armsight.workcell import Cell
    from armsight.workcell.schema_things import PersonSection

SECONDS = 4.0
"""Length of an episode [s]; the arm is under way from 0.4 s on."""
SCRIPTS = ("reach_in", "walk_in", "wave", "walk_by")
FROM_AFAR = 2.2
"""Who is not there when an episode begins walks up from this much farther away [m]."""
VISITOR = "visitor"
LOOK = 0.02
"""A led hand is aimed anew this often [s]."""


@dataclass(frozen=True)
class Lead:
    """A hand that goes for the arm.

    Attributes:
        begins: when [s].
        part: which of the body's spheres, as a share of their number, 0..1.
        ahead: aims at where that part will be after this time [s].
        follows: keeps aiming; else it goes on to where it aimed first.
    """

    begins: float
    part: float
    ahead: float
    follows: bool


class LedHand:
    """Leads the right hand of the cell's person; an observer that knows the truth, as eyes do."""

    name = "led hand"
    period = LOOK

    def __init__(self, cell: Cell, lead: Lead) -> None:
        spheres = cell.robot.spheres
        moving = np.flatnonzero(np.asarray(spheres.link) > 0)
        chosen = moving[min(int(lead.part * len(moving)), len(moving) - 1)]
        self._cell, self._lead = cell, lead
        self._link = int(spheres.link[chosen])
        self._local = np.append(np.asarray(spheres.center[chosen], float), 1.0)
        self._before: Vector3 | None = None
        self._aimed = False

    def update(self, now: float) -> None:
        """Aim."""
        from armsight.workcell import simulated_world

        world = simulated_world(self._cell)
        place = (world.truth.link_poses()[self._link] @ self._local)[:3]
        if self._before is not None and now >= self._lead.begins:
            if self._lead.follows or not self._aimed:
                velocity = (place - self._before) / LOOK
                world.drag(VISITOR, place + self._lead.ahead * velocity)
            self._aimed = True
        self._before = place


def from_afar(run: int) -> bool:
    """Whether nobody is near when an episode begins: every second of the runs."""
    return run // 8 % 2 == 1


def visitor(rng: np.random.Generator, run: int, cap: float) -> PersonSection:
    """Who comes in this episode, and from where."""
    from armsight.workcell.schema_things import PersonSection

    clips = find_clips()
    around = float(rng.uniform(-75.0, 75.0))
    direction = np.array([np.cos(np.deg2rad(around)), np.sin(np.deg2rad(around))])
    common: dict[str, Any] = {
        "name": VISITOR,
        "max_hand_speed": cap,
        "mirror": bool(rng.random() < 0.5),
        "height": float(rng.uniform(1.55, 1.90)),
        "start_s": float(rng.uniform(0.3, 1.5)),
    }
    if from_afar(run):
        x, y = (rng.uniform(1.0, 1.4) + FROM_AFAR) * direction
        return PersonSection(
            motion="script",
            script="walk_in",
            position=(float(x), float(y), 0.0),
            yaw_deg=around + 180.0,
            period_s=float(rng.uniform(4.0, 6.0)),
            distance=FROM_AFAR,
            speed_scale=float(rng.uniform(1.0, 3.0)),
            **common,
        )
    if clips and run // 2 % 2 == 0:
        clip = clips[int(rng.integers(len(clips)))]
        scale = float(rng.uniform(0.8, 2.5))
        played = (SECONDS - common["start_s"]) * scale
        inwards = _hands_reach(clip, played) - float(rng.uniform(0.15, 0.65))
        x, y = -inwards * direction
        return PersonSection(
            motion="clip",
            clip=str(clip),
            position=(float(x), float(y), 0.0),
            yaw_deg=around,
            speed_scale=scale,
            **common,
        )
    script = SCRIPTS[int(rng.integers(len(SCRIPTS)))]
    scale = float(rng.uniform(1.0, 3.0))
    common |= {"motion": "script", "script": script, "speed_scale": scale}
    if script == "walk_by":  # past the bench, a metre and more from the arm's base
        aside = np.array([-direction[1], direction[0]])
        x, y = rng.uniform(0.9, 1.2) * direction - 1.2 * aside
        facing = around + 90.0
    else:
        walk = 1.0 if script == "walk_in" else 0.0
        x, y = direction * (rng.uniform(1.0, 1.4) + walk)
        facing = around + 180.0
    return PersonSection(
        position=(float(x), float(y), 0.0),
        yaw_deg=facing,
        period_s=float(rng.uniform(4.0, 6.0)),
        distance=1.0 if script == "walk_in" else 2.5,
        **common,
    )


def _hands_reach(clip: Path, played: float) -> float:
    """How near a clip's hands come to its robot's axis in the part that is played [m]."""
    from armsight.simulation.clips import load_clip
    from armsight.simulation.skeleton import INDEX

    motion = load_clip(clip)
    joints = motion.joints[: max(2, int(played * motion.rate))]
    hands = joints[:, [INDEX["left_hand"], INDEX["right_hand"]], :2]
    return float(np.linalg.norm(hands, axis=2).min())
