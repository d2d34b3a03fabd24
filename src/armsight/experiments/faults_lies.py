"""Runs in which cameras begin to lie: are they named, does the arm go on afterwards?"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.experiments.episodes import Watch, packaged_cell
from armsight.geometry.pose import make_pose

if TYPE_CHECKING:
    from armsight.runtime.session import Session
    from armsight.simulation.cameras import SimulatedCamera

KINDS = ("far", "old", "mirror", "neighbour", "freeze", "cover", "bump")
FREEING = ("far", "old", "mirror", "neighbour", "freeze")
"""Those that would free space in which somebody is; a covered lens frees nothing."""
LYING = (1, 2, 4)
"""How many of the four cameras lie."""
BEGINS, LASTS, SECONDS = (4.0, 8.0), 2.0, 14.0
"""When the lie begins, how long it lasts, and the run [s]."""
BACK = 4.0
"""The picture that an old one shows again is so much older [s]."""
BUMP_M, BUMP_DEG = 0.03, 3.0
"""A bump of a camera's stand, in some direction."""
HELD = 0.05
"""Slower than this the arm stands [rad/s, greatest joint]."""


class _Blame:
    """Keeps what the map says of the cameras that lie."""

    name = "blame"
    period = 0.005

    def __init__(self, lying: tuple[str, ...], begin: float) -> None:
        self._begin = begin
        self.named = dict.fromkeys(lying, math.inf)
        self.early = 0
        self.sound = False
        self._session: Session | None = None

    def attach(self, session: Session) -> None:
        """Called by the session."""
        self._session = session

    def update(self, now: float) -> None:
        """Look at the newest map."""
        assert self._session is not None
        snapshot = self._session.snapshot()
        if snapshot is None or now < 1.0:
            return
        self.sound = all(c.alive and not c.reason for c in snapshot.cameras)
        for camera in snapshot.cameras:
            if not camera.reason:
                continue
            if now < self._begin:
                self.early += 1
            elif camera.name in self.named:
                self.named[camera.name] = min(self.named[camera.name], now - self._begin)


class _Bump:
    """Somebody who walks into the cameras' stands."""

    name = "bump"
    period = 0.005

    def __init__(
        self, cameras: tuple[SimulatedCamera, ...], begin: float, rng: np.random.Generator
    ) -> None:
        self._cameras, self._begin, self._rng = cameras, begin, rng

    def attach(self, session: Session) -> None:
        """Called by the session."""

    def update(self, now: float) -> None:
        """Once, when it is time."""
        if now < self._begin:
            return
        for camera in self._cameras:
            shift, turn = self._rng.normal(size=(2, 3))
            turn *= np.deg2rad(BUMP_DEG) / np.linalg.norm(turn)
            shift *= BUMP_M / np.linalg.norm(shift)
            camera.bump(make_pose(Rotation.from_rotvec(turn).as_matrix(), shift))
        self._cameras = ()


MEMBERS = len(KINDS) * len(LYING)
"""Runs of a group: each kind of lie by one, two and four cameras."""


def episode(seed: int, run: int) -> dict[str, Any]:
    """One run; module-level, so that worker processes can import it."""
    from armsight.runtime.session import Session
    from armsight.simulation.camera_faults import Fault
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import open_cell, simulated_world

    group, member = divmod(run, MEMBERS)
    kind, count = KINDS[member // len(LYING)], LYING[member % len(LYING)]
    rng = np.random.default_rng((seed, group, member))
    begin = float(rng.uniform(*BEGINS))
    workcell = packaged_cell()
    with open_cell(workcell, seed=int(rng.integers(2**31))) as cell:
        world = simulated_world(cell)
        chosen = [world.cameras[i] for i in rng.permutation(len(world.cameras))[:count]]
        for camera in chosen if kind != "bump" else ():
            camera.faults.add(Fault(kind, begin, begin + LASTS, BACK))  # type: ignore[arg-type]
        bump = _Bump(tuple(chosen) if kind == "bump" else (), begin, rng)
        blame, watch = _Blame(tuple(c.info.name for c in chosen), begin), Watch()
        task = PatrolTask(workcell.goals, workcell.patrol.dwell_s)
        Session(cell, task, seed=group, observers=(bump, blame, watch)).run(SECONDS)
        speed = [(s.stamp - begin, np.abs(s.command).max(initial=0.0)) for s in watch.log]
        moved = any(-0.05 < at <= 0.0 and v >= HELD for at, v in speed)
        stop = min((at for at, v in speed if at > 0.0 and v < HELD), default=math.inf)
        return {
            "kind": kind,
            "count": count,
            "named": list(blame.named.values()),
            "early": blame.early,
            "recovered": blame.sound,
            "stop": stop if moved else None,
            "contacts": len(world.truth.moving_contacts),
        }
