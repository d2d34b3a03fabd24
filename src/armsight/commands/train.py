"""``armsight train``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class Train:
    """Train our network or one of the papers' on a labelled set; the same command goes on.

    Examples: armsight train --config ours --data sets/crops --out runs/ours;
    armsight train --network multi-objective --config t5-small --data sets/paper --out runs/t5;
    armsight train --config t5 --data sets/paper --pack packed --out runs/t5

    Attributes:
        config: a configuration file, or the name of a packaged one (docs/recognition.md).
        data: folder of a labelled set, or of a packed one.
        out: folder for checkpoint, curves, weights, card and ONNX file.
        from_: what our network begins from instead of the pretrained trunk: a network.onnx of a
            training, or arms, which comes with armsight.
        tuning: folder of a labelled set of whole pictures of another renderer: how far our network
            is trusted is chosen on these as well; report no figure on them.
        network: checked against the configuration's, where it is given.
        minutes: stop after so long; a checkpoint is left to go on from.
        device: where to compute; auto takes a GPU if there is one.
        seed: instead of the configuration's.
        samples: at most so many training samples of each robot.
        threads: of the CPU; 0 for torch's own choice.
        half: keep the dense layers' weights in half precision in the ONNX file.
        pack: only pack the labelled set at the network's size into this folder (for a bare
            machine), and stop.
    """

    config: str
    data: Path
    out: Path = Path("training")
    from_: Annotated[str | None, tyro.conf.arg(name="from", metavar="NETWORK")] = None
    tuning: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None
    network: Literal["cascaded", "multi-objective"] | None = None
    minutes: float | None = None
    device: Literal["auto", "cpu", "cuda"] = "auto"
    seed: int | None = None
    samples: int | None = None
    threads: int = 0
    half: bool = False
    pack: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None

    def run(self) -> int:
        """Train to the end, or until the time is up."""
        from armsight.errors import UsageError
        from armsight.recognition.any_arm.learning.plan import is_plan
        from armsight.recognition.training import entry
        from armsight.recognition.training.config import config_file

        entry.check_machine(self.minutes, self.threads)
        if is_plan(config_file(self.config)):
            return self._crops(config_file(self.config))
        if self.from_ is not None:
            raise UsageError("--from is for our network; the papers' begin from one by transfer")
        if self.tuning is not None:
            raise UsageError("--tuning is for our network; the papers' are not judged")
        config = entry.read(self.config, self.seed, self.samples)
        a = config.architecture
        if self.network is not None and a.kind != self.network:
            raise UsageError(f"--network is {self.network}, the configuration's is {a.kind}")
        if self.pack is not None:
            entry.pack_into(self.data, self.pack, a.width, a.height)
            return 0
        entry.need_torch()
        from armsight.recognition.training.run import Wanted, train

        minutes = math.inf if self.minutes is None else self.minutes
        wanted = Wanted(self.out, minutes, self.device, self.half, self.threads)
        train(config, entry.packed(self.data, config), wanted, entry.say)
        print(f"\nwritten to {self.out}: weights.safetensors, network.onnx, CARD.md, curve.png")
        return 0

    def _crops(self, file: Path) -> int:
        """Train the crop network."""
        from dataclasses import replace

        from armsight.errors import UsageError
        from armsight.recognition.any_arm.learning.plan import read_plan
        from armsight.recognition.inference.model import network_file
        from armsight.recognition.training import entry

        for name in ("network", "samples", "pack"):
            if getattr(self, name) is not None:
                raise UsageError(f"--{name} is for the papers' networks, not for {self.config}")
        plan = read_plan(file)
        if self.seed is not None:
            plan = replace(plan, seed=entry.checked_seed(self.seed))
        entry.need_torch()
        from armsight.recognition.any_arm.learning.run import train_crops
        from armsight.recognition.training.run import Wanted

        minutes = math.inf if self.minutes is None else self.minutes
        wanted = Wanted(self.out, minutes, self.device, self.half, self.threads)
        begun = None if self.from_ is None else network_file(self.from_)
        finished = train_crops(plan, self.data, wanted, entry.say, begun, self.tuning)
        state = "finished" if finished else "not finished; the same command goes on"
        print(f"\n{state}; {self.out}: network.onnx, CARD.md, curve.png")
        return 0
