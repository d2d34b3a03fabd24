"""Joint limits over a million ticks: all tasks before targets that jump, teleport and vanish."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from armsight.arrays import Floats, Mask, Vector3
from armsight.experiments.episodes import run_episodes
from armsight.experiments.frame import Progress
from armsight.experiments.quick_cell import QuickCell, felt
from armsight.experiments.servo_ball import path_of
from armsight.experiments.servo_cell import SurfaceCell, plate
from armsight.experiments.servo_eyes import Errors, Path
from armsight.experiments.servo_trials import tick
from armsight.experiments.servo_world import (
    Setup,
    Trial,
    make_eyes,
    make_task,
    set_up,
    world_to_base,
)
from armsight.geometry.pose import inverse
from armsight.motion.guard_config import GuardConfig
from armsight.robots.robot import JointLimits
from armsight.servoing.docking import facing_pose

CELLS = {
    "ball": "ur10_servoing", "bullseye": "ur10_servoing", "straw": "ur10_straw",
    "hand": "ur10_handover",
}  # fmt: skip
"""Cell of each task."""
SECONDS = 20.0
"""A run lasts so long [s]."""
BOX = ((0.70, -0.30, 1.05), (0.95, 0.30, 1.35))
"""Where targets begin, in the cell's world [m]."""
ANYWHERE = ((-0.6, -1.2, 0.7), (2.2, 1.2, 2.2))
"""Where they teleport to: out of reach, out of the map and into the arm, too [m]."""
SURFACES = {
    "bullseye": (0.16, 0.16, 0.01), "straw": (0.24, 0.24, 0.12), "hand": (0.095, 0.085, 0.028),
}  # fmt: skip
"""Edges of flat targets [m]."""


def bulk(runs: int, seed: int, progress: Progress) -> list[dict[str, Any]]:
    """So many runs, a quarter of each task; kept as they end."""
    return run_episodes("servo-limits", _episode, range(runs), seed, progress)


def _episode(seed: int, run: int) -> dict[str, Any]:
    name = tuple(CELLS)[run % len(CELLS)]
    return one(set_up(1.0, 1.0, CELLS[name]), name, (seed, run))


def one(setup: Setup, name: str, seed: tuple[int, int]) -> dict[str, Any]:
    """One run; what was counted, as JSON values."""
    rng = np.random.default_rng((*seed, 41))
    path, jumps = restless(setup, rng)
    eyes = make_eyes(setup, Errors(), rng)
    begins = rng.uniform(1.0, SECONDS, 3)
    eyes.hidden = [("all", float(t), float(t + rng.uniform(0.3, 2.0))) for t in begins]
    task = make_task(setup, "ours", dock=name)
    cell, step = (before_ball if name == "ball" else before_plate)(
        setup, name, eyes, task, path, seed[1]
    )
    joints = []
    while cell.now < SECONDS:
        step()
        joints.append(cell.q.copy())
        if getattr(task, "phase", "") == "done":
            task.reset()  # it brings the next item
    sent = np.array(cell.commands)
    found = beyond(
        setup.robot.limits, setup.guard, sent[:, :-1], sent[:, -1] > 0.0, np.array(joints)
    )
    return {"task": name, "ticks": len(joints), "jumps": jumps, **found}


def restless(setup: Setup, rng: np.random.Generator) -> tuple[Path, int]:
    """A target's path that wanders at up to 0.4 m/s, jumps and teleports; and how often it did."""
    place = world_to_base(setup, [list(rng.uniform(*BOX))])[0]
    smooth = path_of(place, float(rng.uniform(0.0, 0.4)), rng)
    times, offs = [0.0], [np.zeros(3)]
    while times[-1] < SECONDS:
        times.append(times[-1] + float(rng.uniform(0.4, 3.0)))
        which = rng.integers(3)
        if which == 0:
            off = offs[-1] + rng.uniform(-0.25, 0.25, 3)
        elif which == 1:
            off = world_to_base(setup, [list(rng.uniform(*ANYWHERE))])[0] - place
        else:
            off = np.zeros(3)
        offs.append(off)

    def path(time: float) -> Vector3:
        return np.asarray(smooth(time) + offs[int(np.searchsorted(times, time, "right")) - 1])

    return path, len(times) - 2


def before_ball(
    setup: Setup, name: str, eyes: Any, task: Any, path: Path, seed: int
) -> tuple[QuickCell, Callable[[], None]]:
    """A cell with a ball, and one round in it."""
    trial = Trial(setup, eyes, task, path, setup.robot.home, seed=seed)
    return trial.cell, trial.step


def before_plate(
    setup: Setup, name: str, eyes: Any, task: Any, path: Path, seed: int
) -> tuple[QuickCell, Callable[[], None]]:
    """A cell with a flat target that faces the arm, or lies, and one round in it."""
    T = np.asarray(inverse(setup.workcell.robot.T_world_base))
    up, front = T[:3, 2], T[:3, 0]
    normal = up if name == "hand" else 0.35 * up - front
    eyes.normal = np.asarray(normal / np.linalg.norm(normal))
    eyes.along = front if name == "hand" else None
    eyes.marked = False
    *size, thick = SURFACES[name]
    R = facing_pose(np.zeros(3), eyes.normal)[:3, :3]
    surface = plate((size[0], size[1]), thick, R, -0.5 * thick * eyes.normal)
    cell = SurfaceCell(setup, surface, path, setup.robot.home, seed=seed)
    status: Any = None

    def step() -> None:
        nonlocal status
        cell.guard.feel(felt(cell))
        status = tick(cell, eyes, task, status)

    return cell, step


def beyond(
    limits: JointLimits, guard: GuardConfig, commands: Floats, stops: Mask, joints: Floats
) -> dict[str, int]:
    """Ticks in which a command or a joint was beyond its limits.

    A stop tells the drives to brake as hard as they can, and names no velocity; what follows it
    goes on from wherever that has led.

    Args:
        limits: the arm's own.
        guard: its configuration.
        commands: (k, n) joint velocities sent [rad/s].
        stops: (k,) where it was a stop.
        joints: (k, n) where the joints were after each [rad].
    """
    brake = limits.acceleration * max(guard.brake, guard.acceleration)
    fast = (np.abs(commands) > limits.velocity * (1.0 + 1e-6)).any(axis=1)
    change = np.abs(np.diff(commands, axis=0, prepend=commands[:1])) / guard.period
    told = ~(stops | np.concatenate([[False], stops[:-1]]))
    hard = (change > brake * 1.01 + 1e-6).any(axis=1) & told
    out = ((joints < limits.lower - 1e-6) | (joints > limits.upper + 1e-6)).any(axis=1)
    return {
        "speed": int(fast.sum()),
        "acceleration": int(hard.sum()),
        "position": int(out.sum()),
        "violations": int((fast | hard | out).sum()),
        "stops": int(stops.sum()),
    }
