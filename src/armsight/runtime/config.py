"""How a session runs: periods and latencies of its components."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from armsight.mapping.config import MappingConfig
    from armsight.motion.guard_config import GuardConfig
    from armsight.motion.plan import Planner


@dataclass(frozen=True)
class SessionMode:
    """How a session treats its cell.

    Attributes:
        wall: run a simulated cell under the wall clock, in threads. Real cells always are.
        exclusive: refuse to run while another process runs this cell's arm. None: only for a real
            one, whatever cell file names it; simulated ones do not get in each other's way.
        cell_is_empty: somebody has looked, and nobody is in the cell when it starts: what stands
            there is no person, see ``docs/guard.md``.
        look_only: send no command to the arm at all, not even to stop.
        own_process: let the command path (arm, guard) run in a process of its own, as far as the
            arm is behind a driver whose class another process can import. See ``docs/loop.md``.
    """

    wall: bool = False
    exclusive: bool | None = None
    cell_is_empty: bool = False
    look_only: bool = False
    own_process: bool = True


@dataclass(frozen=True)
class SessionConfig:
    """Periods, latencies and the configuration of the parts.

    Attributes:
        sensing_period: between looks at the devices [s].
        mapping_period: between updates without a frame; a frame starts one at once [s].
        guard_period: between guard ticks; a new snapshot starts one at once [s].
        planning_period: between looks for a request; a request starts one at once [s].
        mapping_latency, planning_latency, guard_latency: what a round takes on the simulated
            clock when ``charge`` is ``declared`` [s]. The defaults are a little above what was
            measured on two cores.
        charge: ``declared`` (repeatable bit for bit) or ``measured`` compute time.
        patience: a call of a task or a perceiver that takes longer on the wall clock is given up
            for good [s]; the first one after five times that, since it may compile or load a
            network.
        planning_time: the planner's time limit [s].
        mapping, guard, planner: configuration of the parts; None takes the workcell's or defaults.
    """

    sensing_period: float = 0.004
    mapping_period: float = 0.02
    guard_period: float = 0.008
    planning_period: float = 0.01
    mapping_latency: float = 0.025
    planning_latency: float = 0.1
    guard_latency: float = 0.002
    charge: Literal["declared", "measured"] = "declared"
    patience: float = 60.0
    planning_time: float = 0.05
    mapping: MappingConfig | None = field(default=None)
    guard: GuardConfig | None = field(default=None)
    planner: Planner | None = field(default=None)
