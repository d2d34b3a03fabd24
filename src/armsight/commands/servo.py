"""``armsight servo``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from armsight.commands.live import Working


@dataclass(frozen=True)
class Servo(Working):
    """Follow a target that moves, and touch it: drag it on the page, and the arm comes after it.

    Example: armsight servo ur10_servoing --task ball

    Attributes:
        task: what to follow: touch the `ball`, or a `held_ball` in a gloved hand, dock with the
            `bullseye`, bring a `straw` to a mouth, or an item above a `hand`. A task of your own:
            `armsight run WORKCELL --task my_module:MyTask`.
        mode: `ours`; `paper`: the Master and the segments of V; `fixed`: those without the pair.
        standoff: how far before the surface the tip stays [m]; 0 touches.
        patience: an arm whose contact goes on being refused for so long gives up, and says why [s];
            inf: never.
        fetch: before a hand-over the item is taken from where the cell's file says that items lie
            (`[items]`); without, the gripper holds it already.
    """

    task: Literal["ball", "held_ball", "bullseye", "straw", "hand"] = "ball"
    mode: Literal["ours", "paper", "fixed"] = "ours"
    standoff: float = 0.0
    patience: float = 30.0
    fetch: bool = False

    def run(self) -> int:
        """Servo; prints how it went."""
        from armsight.commands.run import run_and_tell
        from armsight.tasks.servo import ServoOptions

        options = ServoOptions(
            self.task, self.mode, self.standoff, patience=self.patience, fetch=self.fetch
        )
        return run_and_tell(self, options.make)
