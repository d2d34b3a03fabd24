"""``bump``: a calibrated camera of a running cell is walked into; the arm's own work places it."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.experiments.episodes import Watch, packaged_cell, run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, wilson
from armsight.geometry.pose import inverse, make_pose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from armsight.runtime.session import Session
    from armsight.simulation.cameras import SimulatedCamera
    from armsight.simulation.world import SimulatedWorld
    from armsight.workcell import Workcell

SHIFT, TURN_DEG = 0.03, 3.0
"""A bump [m, deg], in some direction."""
CALIBRATED = (0.0015, 0.0008)
"""Standard deviation of the calibration that the cell begins with [m, rad], each axis."""
BEGINS, SECONDS = (4.0, 7.0), 75.0
"""When it happens, and the longest run [s]."""
AFTER = 5.0
"""The run goes on for so long once the camera counts again [s]."""

ABOUT = """
The packaged cell `ur5_four_cameras` with its person and all sensor errors, its cameras calibrated
(1.5 mm, 0.8 mrad off in each axis). Somewhere between 4 and 7 s on, one camera's stand is walked
into and stays so: 30 mm and 3 deg, in some direction. The arm goes on with its patrol. `bump_s`
counts from there until the camera counts again, from its new pose; one that does not within the
run counts as infinite. `bump_mm` is the true error of points 1.0 to 1.5 m from the camera
by that pose, the depth's own bias left out; `before_mm` that of the calibration it began with.
"""


class _Bump:
    """Walks into a camera's stand, and keeps what the map says of it."""

    name = "bump"
    period = 0.02

    def __init__(self, world: SimulatedWorld, camera: SimulatedCamera, moved: Any, at: float):
        self._world, self._camera, self._moved, self._at = world, camera, moved, at
        self.before = self.error = self.named = self.again = math.inf
        self._session: Session | None = None

    def attach(self, session: Session) -> None:
        """Called by the session."""
        self._session = session

    def update(self, now: float) -> None:
        """Bump it when it is time, then watch it."""
        assert self._session is not None
        snapshot = self._session.snapshot()
        if snapshot is None or now < self._at:
            return
        name = self._camera.info.name
        correction = next(c for c in snapshot.corrections if c.name == name)
        T, gain = correction.T_believed_corrected, correction.gain
        if self._moved is not None:
            self.before = self._world.camera_error(name, T, gain) or math.inf
            self._camera.bump(self._moved)
            self._moved = None
            return
        status = next(c for c in snapshot.cameras if c.name == name)
        if math.isinf(self.named):
            self.named = now - self._at if status.excluded else math.inf
        elif math.isinf(self.again) and status.alive and not status.excluded:
            self.again = now - self._at
            self.error = self._world.camera_error(name, T, gain) or math.inf
        elif now > self._at + self.again + AFTER:
            self._session.stop("calibrated again")


def calibrated(workcell: Workcell, folder: Path, seed: int) -> Workcell:
    """The cell with a calibration file in a folder: the truth, a little off."""
    from armsight.workcell import load_workcell, open_cell, simulated_world
    from armsight.workcell.calibration_file.store import store
    from armsight.workcell.calibration_file.writing import camera_entry

    rng = np.random.default_rng([seed, 7])
    file = folder / "cell.toml"
    file.write_text(workcell.text, encoding="utf-8")
    own = load_workcell(file)
    with open_cell(own, seed=seed, calibrated=False) as cell:
        entries = []
        for camera in simulated_world(cell).cameras:
            info = camera.info
            if info.mounted_on != "base":
                continue
            T = inverse(cell.T_world_base) @ camera.T_mount_camera
            turn = Rotation.from_rotvec(CALIBRATED[1] * rng.normal(size=3)).as_matrix()
            off = make_pose(turn, CALIBRATED[0] * rng.normal(size=3))
            C = np.diag([CALIBRATED[0] ** 2] * 3 + [CALIBRATED[1] ** 2] * 3)
            section = next(c for c in own.camera if c.name == info.name)
            entries.append(
                camera_entry(
                    own, section, T @ off, C, info.depth, info.color, info.T_depth_color, None,
                    source="the experiment bump",
                )
            )  # fmt: skip
    store(own, entries)
    return load_workcell(file)


def episode(seed: int, run: int) -> dict[str, Any]:
    """One run; module-level, so that worker processes can import it."""
    from armsight.runtime.session import Session
    from armsight.tasks.arm_watch import arm_watch
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import open_cell, simulated_world

    rng = np.random.default_rng((seed, run, 29))
    begin, cell_seed = float(rng.uniform(*BEGINS)), int(rng.integers(2**31))
    shift, turn = rng.normal(size=(2, 3))
    turn *= np.deg2rad(TURN_DEG) / np.linalg.norm(turn)
    shift *= SHIFT / np.linalg.norm(shift)
    moved = make_pose(Rotation.from_rotvec(turn).as_matrix(), shift)
    with tempfile.TemporaryDirectory() as folder:
        workcell = calibrated(packaged_cell(), Path(folder), cell_seed)
        with open_cell(workcell, seed=cell_seed) as cell:
            world = simulated_world(cell)
            fixed = [c for c in world.cameras if c.info.mounted_on == "base"]
            bump = _Bump(world, fixed[run % len(fixed)], moved, begin)
            watch = Watch()
            task = PatrolTask(workcell.goals, workcell.patrol.dwell_s)
            Session(cell, task, seed=run, perceivers=arm_watch(cell), observers=(bump, watch)).run(
                SECONDS
            )
            return {
                "camera": fixed[run % len(fixed)].info.name,
                "named": bump.named,
                "again": bump.again,
                "error": 1e3 * bump.error,
                "before": 1e3 * bump.before,
                "visits": task.visits,
                "contacts": len(world.truth.moving_contacts),
            }


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` bumps, each of the cell's fixed cameras in turn."""
    results = run_episodes("bump", episode, range(runs), seed, progress)
    again = np.array([r["again"] for r in results])
    error = np.array([r["error"] for r in results])
    named = np.array([r["named"] for r in results])
    back = int(np.isfinite(again).sum())
    low, high = wilson(back, len(results))
    where = f"{len(results)} runs, 30 mm and 3 deg"
    rows = (
        Row("bump_s", "from the bump until the camera counts again, median", where,
            float(np.median(again)), "s", len(results), must=60.0, aim=20.0,
            why="most were not placed again"),
        Row("bump_mm", "true error by the new pose, median; one that was not placed is infinite",
            where, float(np.median(error)), "mm", len(results), must=8.0, aim=4.0,
            why="most were not placed again"),
        Row("bump_worst_mm", "the same, greatest of those that were placed", where,
            float(error[np.isfinite(error)].max(initial=0.0)), "mm", back),
        Row("bump_contacts", "contacts of the moving arm with anything", where,
            sum(r["contacts"] for r in results), "", len(results), must=0.0, aim=0.0),
        Row("bump_placed", "cameras that count again within the run", where, back / len(results),
            "", len(results), low=low, high=high, better="higher"),
        Row("bump_named_s", "from the bump until the map names the camera, median", where,
            float(np.median(named)), "s", len(results), why="most were not named"),
        Row("before_mm", "true error by the calibration before the bump, median", where,
            float(np.median([r["before"] for r in results])), "mm", len(results)),
        Row("bump_visits", "goals that the arm reached in a run, least", where,
            min(r["visits"] for r in results), "", len(results), better="higher"),
    )  # fmt: skip
    return Outcome(rows, {"runs": lambda: _plot(results)})


def _plot(results: list[dict[str, Any]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 3))
    axes = figure.subplots()
    for name in sorted({r["camera"] for r in results}):
        mine = [r for r in results if r["camera"] == name and math.isfinite(r["again"])]
        axes.plot([r["again"] for r in mine], [r["error"] for r in mine], "o", label=name)
    axes.axhline(8.0, color="C3", linewidth=1.0)
    axes.set(xlabel="s from the bump until it counts again", ylabel="mm off", ylim=(0, None))
    axes.set_xlim(left=0)
    axes.legend(fontsize=7)
    figure.tight_layout()
    return figure


EXPERIMENT = Experiment(
    "bump", "A camera is walked into: the arm's own work calibrates it again", run, 12, ABOUT
)
