"""Stands for the guard in a session whose command path runs in a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from armsight.errors import LoopError
from armsight.motion.intents import JointIntent, PoseIntent, Rest, VelocityIntent
from armsight.motion.plan import Plan
from armsight.runtime.channels import Channels, TaskWord
from armsight.runtime.command_link import CommandLink
from armsight.runtime.command_messages import Begin, News, State
from armsight.runtime.snapshot_memory import SnapshotWriter
from armsight.runtime.view import ComponentHealth
from armsight.runtime.wire import understood

if TYPE_CHECKING:
    from armsight.mapping.snapshot import WorkspaceSnapshot

PERIOD = 0.004
"""Between two looks for news [s]; a new map or plan is passed on at once."""
INTENTS = (JointIntent, PoseIntent, VelocityIntent, Rest, type(None))
"""What a task may want; anything else stays here."""
NOT_PLAIN = (
    "the planner's answer holds what the guard's process cannot take over (a class or function of "
    "its own, a lambda); a planner returns armsight.motion.plan.Plan with a Trajectory"
)


class CommandRelay:
    """Passes news to the guard's process, and what it says on to the session.

    Attributes:
        held: see :class:`~armsight.runtime.components.GuardComponent`; on_request: likewise.

    Args:
        channels: of the session.
        link: to the process.
        order: how the guard is made there.
        now: the session's time.
    """

    name = "guard"
    period = PERIOD

    def __init__(
        self, channels: Channels, link: CommandLink, order: Begin, now: Callable[[], float]
    ) -> None:
        self.held = False
        self.on_request: Callable[[float], None] = lambda at: None
        self._channels, self._link, self._order, self._now = channels, link, order, now
        self._writer = SnapshotWriter()
        self._word: TaskWord | None = None
        self._plan: Plan | None = None
        self._unsaid = ""
        self._snapshot: WorkspaceSnapshot | None = None
        self._was_held: bool | None = None
        self._state = State(None, None)

    @property
    def problem(self) -> str:
        """The guard's, in words."""
        return "; ".join(p for p in (self._unsaid, self._state.problem) if p)

    def report(self) -> ComponentHealth | None:
        """Health of the guard itself; None before its first word."""
        return self._state.health

    @property
    def priority(self) -> str:
        """With which the guard runs, in words; empty before it does."""
        return self._state.priority

    def begin(self) -> None:
        """Have the guard made and warmed up, beside whatever is prepared here."""
        self._link.begin(self._order)

    def wait_ready(self) -> None:
        """Wait for it; errors as of :meth:`.CommandLink.wait_ready`."""
        self._link.wait_ready()

    @contextmanager
    def running(self) -> Iterator[None]:
        """The guard commands the arm."""
        self._link.on_state = self._hear
        self._link.run()
        try:
            yield
        finally:
            self._link.end()
            self._link.on_state = lambda state: None
            self._writer.close()
            self._snapshot = None

    def update(self, now: float) -> None:
        """Pass on what is new.

        Raises:
            LoopError: the guard commands no more.
        """
        ended = self._link.ended
        if ended is not None:
            raise LoopError(ended or "the guard's process has ended its run")
        if self._link.slow:
            return
        channels = self._channels
        word, plan = channels.word.read(now), channels.plan.read(now)
        snapshot, wrenches = channels.snapshot.read(now), channels.readings.take_wrenches()
        new_word = word if word is not None and word is not self._word else None
        new_plan = plan if plan is not self._plan else None
        mapped = snapshot is not None and snapshot is not self._snapshot
        if new_word or new_plan or mapped or wrenches or self.held != self._was_held:
            self._link.tell(
                News(
                    self.held,
                    None if new_word is None else _plain(new_word),
                    None if new_plan is None else self._sendable(new_plan),
                    tuple(wrenches),
                    self._writer.write(snapshot) if mapped and snapshot is not None else None,
                )
            )
        self._word, self._plan, self._snapshot = word, plan, snapshot
        self._was_held = self.held

    def _sendable(self, plan: Plan) -> Plan:
        """A plan that the guard's process can understand; else one that says why there is none."""
        good = type(plan) is Plan and understood(plan)
        self._unsaid = "" if good else f"no path: {NOT_PLAIN}"
        if good:
            return plan
        asked = self._state.request
        number = asked.sequence if asked is not None else 0
        return Plan(number, np.zeros((0, 0)), None, np.inf, 0, 0.0, 0.0, NOT_PLAIN)

    def _hear(self, state: State) -> None:
        """In the link's thread: a word of the guard."""
        self._state = replace(state, health=state.health or self._state.health)
        now = self._now()
        if state.status is not None:
            self._channels.status.publish(state.status, now)
        if state.request is not None:
            self._channels.request.publish(state.request, now)
            self.on_request(now)


def _plain(word: TaskWord) -> TaskWord:
    """A word that the guard's process can understand, whatever a stranger's task has said."""
    wanted = word.intent
    if type(wanted) in INTENTS and understood(wanted):
        return word
    kind = type(wanted).__name__
    reason = (
        f"a task wants a {kind} that is no intent, or holds what is no number (a function, a class "
        "of its own)"
    )
    return replace(word, intent=Rest(reason, fault=True))
