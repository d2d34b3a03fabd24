"""One tick of the guard: what it finds, and what it decides."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armsight.arrays import JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.arm_model import ArmState
from armsight.motion.data import GuardMode, GuardStatus, PlanRequest
from armsight.motion.faults import Verdict
from armsight.motion.nearest import SeparationView


@dataclass(frozen=True)
class GuardDecision:
    """One tick's outcome.

    Attributes:
        command: (n,) joint velocities to send [rad/s].
        status: for everybody.
        request: a new plan request, or None.
        brake: stop the arm as hard as the drives can; ``command`` is zero then.
    """

    command: JointVector
    status: GuardStatus
    request: PlanRequest | None = None
    brake: bool = False


@dataclass
class Tick:
    """What one tick finds and decides.

    Attributes:
        now: [s]; elapsed: since the tick before [s].
        verdict: on the input; snapshot: the map in use.
        here, ahead: the arm now, and when a command sent now begins to act.
        at_rest: it stands, and nothing that was sent will move it.
        near: how far hazards are from the body as it is.
        view: what separation says of the motion (``near`` while there is none).
        command: (n,) [rad/s]; brake: stop as hard as the drives can instead.
        pace: share of the motion under way; scale: share of the wish that is commanded.
        wanted: (n,) what a task's velocity asked of the joints [rad/s], or None.
        mode, reason: what is done, and why.
        request: to the planner, or None.
    """

    now: float
    elapsed: float
    verdict: Verdict
    snapshot: WorkspaceSnapshot | None
    here: ArmState
    ahead: ArmState
    at_rest: bool
    near: SeparationView
    view: SeparationView
    command: JointVector = field(default_factory=lambda: np.zeros(0))
    brake: bool = False
    pace: float = 0.0
    scale: float = 0.0
    wanted: JointVector | None = None
    mode: GuardMode = GuardMode.IDLE
    reason: str = ""
    request: PlanRequest | None = None

    def stop_hard(self) -> None:
        """Brake as hard as the drives can, whatever was decided before."""
        self.brake = True
        self.command = np.zeros(len(self.command))
