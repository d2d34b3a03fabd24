"""What a session runs on a recording: the same map; no planner; the guard's word as recorded."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Protocol

import numpy as np

from armsight.devices.data import DeclaredSolids, JointState
from armsight.errors import UsageError
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.mapping.workspace_map import WorkspaceMap
from armsight.motion.data import GuardMode, GuardStatus, PlanRequest
from armsight.motion.face import Face
from armsight.motion.intents import Intent
from armsight.motion.plan import Plan
from armsight.motion.task import Observation, Subscriptions, Task
from armsight.motion.tick import GuardDecision
from armsight.recording.playback import Playback
from armsight.runtime.config import SessionConfig
from armsight.runtime.configure import mapping_config
from armsight.runtime.parts import Parts

if TYPE_CHECKING:
    from armsight.workcell import Cell

HOLD_AFTER = 0.06
"""A replay holds this long after its last reading: the map has seen it, no camera is stale [s]."""


class RecordedGuard:
    """Says what the guard said; commands nothing."""

    def __init__(self, playback: Playback, joints: int) -> None:
        self._playback = playback
        self._rest = np.zeros(joints)

    def step(
        self,
        now: float,
        joints: JointState | None,
        snapshot: WorkspaceSnapshot | None,
        intent: Intent | None,
        plan: Plan | None,
    ) -> GuardDecision:
        """The recorded status of this time, or an idle one where none was recorded."""
        status = self._playback.guard or GuardStatus(
            stamp=now,
            mode=GuardMode.IDLE,
            reason="",
            goal="",
            reached=False,
            command=self._rest,
            speed_scale=0.0,
            distance=np.inf,
            protective_distance=np.nan,
            nearest_hazard=None,
            nearest_body=None,
            path=None,
            executed=None,
            snapshot_sequence=-1 if snapshot is None else snapshot.sequence,
            snapshot_age=np.inf if snapshot is None else now - snapshot.oldest,
        )
        return GuardDecision(self._rest, status)


class RecordedTask:
    """Shows what the task of a recording showed; wants nothing, and its buttons are dead."""

    def __init__(self, playback: Playback) -> None:
        self._playback = playback
        self.name = "recorded"
        self.period = 0.05
        self.subscriptions = Subscriptions()

    def update(self, observation: Observation) -> Intent | None:
        """The arm moves as it did; nothing is asked of anybody."""
        return None

    def face(self) -> Face | None:
        """As it was shown at this time of the recording."""
        shown = self._playback.face
        if shown is None:
            return None
        self.name = shown.task
        buttons = tuple(replace(button, enabled=False) for button in shown.face.buttons)
        return replace(shown.face, buttons=buttons)

    def press(self, button: str) -> None:
        """What has happened stays as it is."""


def recorded_task(cell: Cell) -> Task | None:
    """What stands for the task of a recorded cell; None where none showed anything."""
    world = cell.world
    shows = isinstance(world, Playback) and world.source.shows_task
    return RecordedTask(world) if shows and isinstance(world, Playback) else None


class NoPlanner:
    """There is nothing to plan for an arm that moves as it did."""

    def plan(
        self,
        request: PlanRequest,
        snapshot: WorkspaceSnapshot,
        time_limit: float,
        rng: np.random.Generator,
    ) -> Plan:
        """Answer that no path is to be had."""
        none = np.zeros((0, len(request.start)))
        words = "a recording is not planned for"
        return Plan(request.sequence, none, None, np.inf, snapshot.sequence, 0.0, 0.0, words)


def replay_parts(cell: Cell, config: SessionConfig) -> Parts:
    """The parts of a session on a recording: ``Session(cell, None, make=replay_parts)``.

    Raises:
        UsageError: the cell is no recording.
    """
    playback = cell.world
    if not isinstance(playback, Playback):
        raise UsageError(f"{cell.workcell.name} is no recording; open one with open_recording")
    infos = cell.guard_cameras
    mapping = config.mapping or mapping_config(cell.workcell, cell.T_world_base, cell.robot.reach)
    workspace = WorkspaceMap(cell.robot, infos, cell.static, mapping)
    playback.on_empty = workspace.declare_empty
    playback.on_declared = partial(_told, workspace)
    return Parts(workspace, NoPlanner(), RecordedGuard(playback, cell.robot.n))


def _told(workspace: WorkspaceMap, word: DeclaredSolids) -> None:
    """What somebody had declared; in a piece of a recording the beginning may be missing."""
    with contextlib.suppress(UsageError):
        workspace.told(word)


class Holds(Protocol):
    """What :class:`HoldAtEnd` needs of a session."""

    cell: Cell

    def pause(self) -> None:
        """Stand still."""
        ...


class HoldAtEnd:
    """Pauses a session when its recording has come to the end, so that the last map stays."""

    name = "replay"
    period = 0.02

    def __init__(self) -> None:
        self.problem = ""
        self._session: Holds | None = None
        self._held = False

    def attach(self, session: Holds) -> None:
        """The session to pause."""
        self._session = session

    def update(self, now: float) -> None:
        """Look whether it is time."""
        session = self._session
        playback = None if session is None else session.cell.world
        if session is None or not isinstance(playback, Playback):
            return
        end = playback.finished and now >= playback.last + HOLD_AFTER
        if end and not self._held:
            session.pause()
        self._held = end
