"""What V's experiments share: their trials in worker processes, one round of one, the gap to V."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from armsight.arrays import JointVector, Pose
from armsight.devices.data import JointState
from armsight.experiments.episodes import part_of, run_episodes
from armsight.experiments.frame import Progress
from armsight.experiments.rows import Row
from armsight.experiments.servo_cell import SurfaceCell
from armsight.experiments.servo_eyes import Errors, Eyes, Path
from armsight.experiments.servo_world import Setup, set_up
from armsight.motion.data import GuardMode, GuardStatus
from armsight.motion.intents import VelocityIntent
from armsight.motion.task import Observation

Trial = dict[str, Any]
"""What came of one, as JSON values."""
FREE = "ablation_unguarded_paper_"
"""Prefix of V's mode without the guard: is it the guard that keeps it from V's figures?"""
Plan = Sequence[tuple[str, str, Errors, int]]
"""(prefix of the keys, mode, errors, trials) of each row."""


@dataclass(frozen=True)
class Drawn:
    """What a trial draws of its target: alike for the rendered cell and for the one without.

    Attributes:
        T: of the target in ``base``; T_world_target: and in the world, where its path begins.
        path: (3,) of it in ``base`` at a time [m], [s]; speed: its greatest [m/s].
        eyes: what the cameras say of it, without pictures.
        start: (n,) where the arm begins [rad].
        clip: whose recording leads it; empty for none.
    """

    T: Pose
    T_world_target: Pose
    path: Path
    speed: float
    eyes: Eyes
    start: JointVector
    clip: str = ""


def run_plan(
    name: str,
    cell: str,
    plan: Plan,
    one: Callable[[Setup, str, Errors, tuple[int, int]], Trial],
    seed: int,
    progress: Progress,
) -> dict[str, list[Trial]]:
    """All trials of a plan by its prefixes, at full speed and acceleration; kept as they end."""
    results: dict[str, list[Trial]] = {}
    total, done = sum(entry[-1] for entry in plan), 0
    for prefix, mode, errors, count in plan:
        trial = partial(one, set_up(1.0, 1.0, cell), mode, errors)
        told = told_of(prefix or "ours", progress, done / total, count / total)
        part = [mode, asdict(errors)]
        results[prefix] = run_trials(name, part, trial, count, seed, told)
        done += count
    return results


def run_trials(
    name: str,
    part: Sequence[Any],
    trial: Callable[..., Trial],
    count: int,
    seed: int,
    progress: Progress,
) -> list[Trial]:
    """So many trials, ``trial(seed=(seed, k))`` in worker processes; kept as they end."""
    episode = partial(_seeded, trial)
    return run_episodes(name, episode, range(count), seed, progress, part)


def _seeded(trial: Callable[..., Trial], first: int, run: int) -> Trial:
    return trial(seed=(first, run))


def told_of(what: str, progress: Progress, begin: float, part: float) -> Progress:
    """Progress of a part that has a name of its own, see :func:`~.episodes.part_of`."""
    told = part_of(progress, begin, part)
    return lambda say, share: told(f"{what}, {say}", share)


def tick(cell: SurfaceCell, eyes: Any, task: Any, status: GuardStatus | None) -> GuardStatus:
    """One round: the cameras look, the task wishes, the guard decides and the arm moves on."""
    return cell.tick(goal=task.update(_seen(cell, eyes, status))).status


def unguarded(cell: SurfaceCell, eyes: Any, task: Any, status: GuardStatus | None) -> GuardStatus:
    """The same for an arm without a guard, as V's: it is driven as the task wishes."""
    wish = task.update(_seen(cell, eyes, status))
    command = np.zeros(cell.robot.n)
    if isinstance(wish, VelocityIntent):
        most = cell.robot.limits.velocity * cell.config.speed
        command = wish.velocity / max(float((np.abs(wish.velocity) / most).max()), 1.0)
    now = cell.now
    cell.send(command)
    cell.drive(now + cell.config.period)
    return GuardStatus(
        now, GuardMode.VELOCITY, "", task.name, False, command, 1.0, math.inf, 0.0, None, None,
        None, None, -1, 0.0, wanted=command,
    )  # fmt: skip


def _seen(cell: SurfaceCell, eyes: Any, status: GuardStatus | None) -> Observation:
    """What the task is told, the cameras having looked."""
    now = cell.now
    eyes.expose(now, cell.q, lambda _: cell.place(cell.now))
    joints = JointState(now, cell.q.copy(), cell.v.copy())
    return Observation(now, cell.robot, joints, status, perceived=eyes.arrived(now))


def gap_row(good: Sequence[bool], figure: float) -> Row:
    """How far the share of successes of V's mode is from V's figure."""
    share = sum(good) / max(len(good), 1)
    return Row(
        "paper_mode_gap", "share of successes of V's mode less V's figure, absolute",
        "V's errors", abs(share - figure), n=len(good), must=0.10, aim=0.05,
    )  # fmt: skip
