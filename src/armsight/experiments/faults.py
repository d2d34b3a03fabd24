"""``faults``: cameras of a running cell begin to lie; are they named, does the arm go on after?"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.experiments.episodes import Watch, packaged_cell, run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, wilson
from armsight.geometry.pose import make_pose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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

ABOUT = """
The packaged cell `ur5_four_cameras` with its person and all sensor errors. For 2 s, from
somewhere between 4 and 8 s on, one, two or all four cameras lie with fresh stamps: everything at
nine tenths of the range with noise (`far`), the picture of 4 s ago (`old`), left and right
exchanged (`mirror`), another camera's picture (`neighbour`), the last picture again and again
(`freeze`), half of the lens covered (`cover`); or their stands are bumped, by 30 mm and 3 deg,
and stay so (`bump`). Named is a camera when the map gives a reason for it; `named_s` counts from
the beginning of the lie. Recovered is a run in which every camera is believed again at the end
and none is blamed; a bumped one is aligned again, or not used until it has been calibrated.
`stop_s`, where all four lie and the arm was moving, counts until it stands.
"""


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


def episode(seed: int, run: int) -> dict[str, Any]:
    """One run; module-level, so that worker processes can import it."""
    from armsight.runtime.session import Session
    from armsight.simulation.camera_faults import Fault
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import open_cell, simulated_world

    group, member = divmod(run, len(KINDS) * len(LYING))
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


def settings() -> dict[str, Any]:
    """All that changes a run, besides its seed."""
    return {"times": [*BEGINS, LASTS, SECONDS, BACK], "bump": [BUMP_M, BUMP_DEG], "version": 4}


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` groups: each kind of lie by one, two and four cameras."""
    members = len(KINDS) * len(LYING)
    results = run_episodes("faults", episode, range(runs * members), seed, settings(), progress)
    named = np.array([t for r in results for t in r["named"]])
    found = np.isfinite(named)
    stops = [r["stop"] for r in results if r["count"] == 4 and r["kind"] in FREEING]
    stops = [stop for stop in stops if stop is not None]
    missed = int((~found).sum())
    lies = [r for r in results if r["kind"] != "bump"]
    rows = [
        _share("unnoticed", "lying cameras that nobody named", missed, len(named), 0.0),
        Row(
            "named_s",
            "from the first lying exposure until the camera is named, 95th percentile",
            "one, two or four of four cameras",
            float(np.percentile(named[found], 95)) if found.any() else math.inf,
            "s",
            n=len(named),
            must=0.3,
            aim=0.15,
            why="no camera was named",
        ),
        *(_kind(kind, results) for kind in KINDS),
        Row(
            "stop_s",
            "from the first lying exposure until the arm stands, all cameras lie, greatest",
            ", ".join(FREEING),
            max(stops, default=math.inf),
            "s",
            n=len(stops),
            why="no arm was moving, or one went on",
        ),
        Row(
            "faults_contacts",
            "contacts of the moving arm with anything",
            f"{len(results)} runs",
            sum(r["contacts"] for r in results),
            n=len(results),
            must=0.0,
            aim=0.0,
        ),
        Row(
            "false_blame",
            "runs in which an honest picture was blamed before the lie",
            f"{len(results)} runs",
            sum(r["early"] > 0 for r in results),
            n=len(results),
        ),
        _share(
            "recovered",
            "runs with lies in which all cameras are believed again at the end",
            sum(r["recovered"] for r in lies),
            len(lies),
            0.98,
            higher=True,
        ),
    ]
    return Outcome(tuple(rows), {"named": lambda: _plot(results)})


def _share(key: str, what: str, count: int, of: int, must: float, higher: bool = False) -> Row:
    low, high = wilson(count, of)
    better = {"better": "higher"} if higher else {}
    aim = 1.0 if higher else 0.0
    return Row(key, what, "", count / of, n=of, low=low, high=high, must=must, aim=aim, **better)  # type: ignore[arg-type]


def _kind(kind: str, results: list[dict[str, Any]]) -> Row:
    times = [t for r in results if r["kind"] == kind for t in r["named"]]
    known = [t for t in times if math.isfinite(t)]
    return Row(
        f"{kind}_named_s",
        "the same, of one kind of lie, median",
        f"{len(known)} of {len(times)} were named",
        float(np.median(times)),
        "s",
        n=len(times),
        why="most were not named",
    )


def _plot(results: list[dict[str, Any]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3))
    axes = figure.subplots()
    for i, kind in enumerate(KINDS):
        times = [t for r in results if r["kind"] == kind for t in r["named"] if math.isfinite(t)]
        axes.plot(np.full(len(times), i), times, "o", color="C0", alpha=0.5)
    axes.axhline(0.3, color="C3", linewidth=1.0)
    axes.set_xticks(range(len(KINDS)), KINDS)
    axes.set(ylabel="s until named", ylim=(0, None))
    return figure


EXPERIMENT = Experiment(
    name="faults",
    title="Cameras that lie with fresh stamps",
    run=run,
    runs=3,
    about=ABOUT,
)
