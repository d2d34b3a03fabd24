"""Many seeded runs of a rendered cell in worker processes, resumable, told as plain numbers."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armsight.errors import ArmsightError
from armsight.experiments.cache import RunCache
from armsight.experiments.code_digest import code_digest
from armsight.experiments.frame import Progress
from armsight.machine import end_with_parent
from armsight.motion.data import GuardMode, GuardStatus

if TYPE_CHECKING:
    from armsight.runtime.session import Session
    from armsight.workcell import Cell, Workcell

CELL = "ur5_four_cameras"
"""The packaged cell of these experiments."""
WORKERS = int(os.environ.get("ARMSIGHT_WORKERS", "2"))
"""Processes that run episodes at the same time."""
FRESH = 20
"""Workers are replaced after about so many episodes: each leaves about 50 MB of memory behind."""

Episode = Callable[[int, int], dict[str, Any]]
"""``episode(seed, run)`` does one run and returns JSON values; a module-level function."""


def run_episodes(
    name: str,
    episode: Episode,
    runs: Sequence[int],
    seed: int,
    progress: Progress,
    part: Any = None,
) -> list[dict[str, Any]]:
    """Results of the runs, in order; those finished earlier are remembered.

    Args:
        name: of the experiment, for the cache.
        episode: what one run does.
        runs: their numbers.
        seed: of the experiment.
        progress: told after each run.
        part: as of :class:`~armsight.experiments.cache.RunCache`.

    Raises:
        ArmsightError: the package has been changed since this process began.
    """
    cache = RunCache(name, seed, part)
    results: dict[int, dict[str, Any]] = {}
    for run in runs:
        with contextlib.suppress(LookupError):
            results[run] = cache.get(run, _not_yet)
    missing = [run for run in runs if run not in results]
    progress(f"{name}: {len(results)} of {len(runs)}", len(results) / max(1, len(runs)))
    context = multiprocessing.get_context("spawn")
    workers = max(1, min(WORKERS, len(missing)))
    # A new pool a batch: one that replaces its workers itself (max_tasks_per_child) hangs for ever
    # in Python 3.11 when a worker's last task was the only one under way.
    for begin in range(0, len(missing), FRESH * workers):
        batch = missing[begin : begin + FRESH * workers]
        with ProcessPoolExecutor(workers, context, initializer=end_with_parent) as pool:
            waiting = {pool.submit(_one, code_digest(), episode, seed, run): run for run in batch}
            try:
                for future in as_completed(waiting):
                    run, result = waiting[future], future.result()
                    results[run] = cache.get(run, lambda result=result: result)  # type: ignore[misc]
                    progress(f"{name}: {len(results)} of {len(runs)}", len(results) / len(runs))
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    return [results[run] for run in runs]


def part_of(progress: Progress, begin: float, part: float) -> Progress:
    """Progress of a part that begins at a share of the whole, and is a share of it."""
    return lambda what, share: progress(what, begin + part * share)


def _one(asked_by: str, episode: Episode, seed: int, run: int) -> dict[str, Any]:
    """An episode, by the code that asked for it, and nothing of it left.

    A worker loads the package as it is when the worker starts. And a session refers to itself in
    circles, and Python looks for those ever more rarely the more modules are loaded: after 18
    episodes a worker had 5.8 GB and 102 threads.
    """
    if code_digest() != asked_by:
        raise ArmsightError(
            "armsight's own files have changed since this experiment began: start it again"
        )
    try:
        return episode(seed, run)
    finally:
        gc.collect()


def _not_yet() -> dict[str, Any]:
    raise LookupError


def packaged_cell() -> Workcell:
    """The cell of these experiments as its file has it."""
    from armsight.workcell import load_workcell
    from armsight.workcell.packaged import packaged

    return load_workcell(packaged()[CELL])


def with_simulation(workcell: Workcell, **changes: Any) -> Workcell:
    """The same cell with other people, objects or sensor errors."""
    simulation = workcell.simulation.model_copy(update=changes)
    return workcell.model_copy(update={"simulation": simulation})


class Watch:
    """An observer that keeps what the guard said, 50 times a second.

    Attributes:
        log: the statuses; times: when they were looked at [s].
    """

    name = "watch"
    period = 0.02

    def __init__(self) -> None:
        self._session: Session | None = None
        self.log: list[GuardStatus] = []

    def attach(self, session: Session) -> None:
        """Called by the session that is watched."""
        self._session = session

    def update(self, now: float) -> None:
        """Keep the newest status, without its paths."""
        assert self._session is not None
        status = self._session.status()
        if status is not None:
            self.log.append(replace(status, path=None, executed=None))

    def share(self, *modes: GuardMode) -> float:
        """Share of the looks in these modes."""
        return sum(s.mode in modes for s in self.log) / max(1, len(self.log))


def least_moving_distance(cell: Cell) -> float:
    """Least true distance to a person while the arm moved faster than 0.05 m/s [m]; 3 if none."""
    from armsight.workcell import simulated_world

    return min(simulated_world(cell).truth.min_moving_distance, 3.0)


def find_clips() -> list[Path]:
    """The recorded motion clips beside the repository, in the order of their names; maybe none."""
    for parent in Path(__file__).resolve().parents:
        folder = parent.parent / "shared" / "data" / "motion" / "human_motion"
        if folder.is_dir():
            return sorted(folder.glob("*/*.csv.gz"))
    return []
