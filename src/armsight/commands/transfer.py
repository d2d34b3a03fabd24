"""``armsight transfer``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class Transfer:
    """Teach a trained network new robots (T6 in one stage, T7 in two); the same command goes on.

    Examples: armsight transfer --one-stage --from runs/t5/weights.safetensors --data sets/paper
    --out runs/t6; armsight transfer --two-stage --from runs/t5/weights.safetensors
    --data sets/paper --out runs/t7

    Attributes:
        from_: weights to begin with.
        data: folder of a labelled set, or of a packed one.
        out: folder for checkpoint, curves, weights, card and ONNX file.
        one_stage: T6: the dense layers and the mask's last convolutions, on one new robot.
        two_stage: T7: the same on all robots until the loss saturates, then later convolutions too.
        config: a configuration file or a packaged one's name; t6 or t7 if left out.
        minutes: stop after so long; a checkpoint is left to go on from.
        device: where to compute; auto takes a GPU if there is one.
        seed: instead of the configuration's.
        samples: training samples of each robot, at most.
        threads: of the CPU; 0 for torch's own choice.
        half: keep the dense layers' weights in half precision in the ONNX file.
    """

    from_: Annotated[Path, tyro.conf.arg(name="from", metavar="WEIGHTS")]
    data: Path
    out: Path
    one_stage: bool = False
    two_stage: bool = False
    config: str | None = None
    minutes: float | None = None
    device: Literal["auto", "cpu", "cuda"] = "auto"
    seed: int | None = None
    samples: int | None = None
    threads: int = 0
    half: bool = False

    def run(self) -> int:
        """Train to the end, or until the time is up."""
        from armsight.errors import UsageError
        from armsight.recognition.training import entry

        if self.one_stage == self.two_stage:
            raise UsageError("transfer: give one of --one-stage (T6) and --two-stage (T7)")
        entry.check_machine(self.minutes, self.threads)
        config = entry.read(
            self.config or ("t6" if self.one_stage else "t7"), self.seed, self.samples
        )
        stages = 1 if self.one_stage else 2
        if len(config.stages) != stages:
            raise UsageError(
                f"the configuration has {len(config.stages)} stages, expected {stages}"
            )
        entry.need_torch()
        from armsight.recognition.training.run import Wanted, transfer

        minutes = math.inf if self.minutes is None else self.minutes
        wanted = Wanted(self.out, minutes, self.device, self.half, self.threads)
        transfer(config, entry.packed(self.data, config), self.from_, wanted, entry.say)
        print(f"\nwritten to {self.out}: weights.safetensors, network.onnx, CARD.md, curve.png")
        return 0
