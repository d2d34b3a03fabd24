"""Trains the crop network: batches, the running mean of the weights, checkpoints, an early end."""

from __future__ import annotations

import copy
import hashlib
import json
import math
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from armsight.arrays import Ints
from armsight.errors import RecognitionError
from armsight.recognition.any_arm.learning.adopting import Origin
from armsight.recognition.any_arm.learning.examples import Examples
from armsight.recognition.any_arm.learning.feeding import Fed, feed, killed_in_words
from armsight.recognition.any_arm.learning.losses import loss_terms, total, whose
from armsight.recognition.any_arm.learning.measure import measure
from armsight.recognition.any_arm.learning.network import CropNet, Shape, build
from armsight.recognition.any_arm.learning.plan import Plan
from armsight.recognition.training.checkpoint import (
    Progress,
    load_checkpoint,
    remember,
    save_checkpoint,
)

CHECKPOINT_SECONDS = 240.0
NOTED = 25
"""Updates between two records of the curve."""
MEASURED = 320
"""Crops held back that a measurement looks at, spread over all."""
_CLIP = 5.0
_BETTER = 0.002
"""Share by which the loss of a measurement is below the best one to be a gain."""


class CropTrainer:
    """Trains one network.

    On a CPU the same plan, data and machine give the same weights bit for bit, however often the
    training was stopped. A checkpoint in ``folder`` is gone on from, also with other data, which
    may have grown since.

    Args:
        plan: what to do.
        data: crops.
        folder: for checkpoints.
        device: where to compute.
        start: gives the new network its first weights.
        workers: processes that make batches ahead; 0 makes them in between.
        origin: the network that these weights are of, where it is a finished one.

    Raises:
        RecognitionError: too few crops, or the checkpoint is damaged or of another plan.
    """

    def __init__(
        self,
        plan: Plan,
        data: Examples,
        folder: Path,
        device: torch.device,
        start: Callable[[CropNet], None],
        workers: int = 0,
        origin: Origin | None = None,
    ) -> None:
        self.plan, self.data, self.device, self._workers = plan, data, device, workers
        self.origin = origin
        self.learned, self.held = data.part(validation=False), data.part(validation=True)
        if not len(self.learned) or not len(self.held):
            raise RecognitionError(
                f"{len(data)} crops are too few: {len(self.learned)} of them are learned from and "
                f"{len(self.held)} of other rooms held back; generate more"
            )
        network = build(Shape(plan.robots), plan.seed, plan.frozen)
        self._file = folder / "checkpoint.safetensors"
        self.progress = Progress()
        self._memory: dict[int, dict[str, Any]] = {}
        both = nn.ModuleDict({"now": network, "mean": copy.deepcopy(network)})
        if self._file.is_file():
            self.progress, self._memory = load_checkpoint(self._file, both, self._mark())
        else:
            start(network)
            both["mean"].load_state_dict(network.state_dict())
        both["mean"].requires_grad_(False)
        self._both = both.to(device, memory_format=torch.channels_last)
        self._optimiser = self._make_optimiser()
        if self._memory:
            remember(self._optimiser, self._memory)

    @property
    def network(self) -> CropNet:
        """The network that learns."""
        found = self._both["now"]
        assert isinstance(found, CropNet)
        return found

    @property
    def mean(self) -> CropNet:
        """The running mean of its weights: what is measured and written out."""
        found = self._both["mean"]
        assert isinstance(found, CropNet)
        return found

    @property
    def some_held(self) -> Ints:
        """The crops held back that a measurement looks at."""
        return self.held[:: max(len(self.held) // MEASURED, 1)][:MEASURED]

    @property
    def precision(self) -> str:
        """What the convolutions compute in."""
        if self.plan.precision != "auto":
            return self.plan.precision
        return "bfloat16" if self.device.type == "cuda" else "float32"

    def run(
        self, minutes: float = math.inf, told: Callable[[Progress], None] = lambda progress: None
    ) -> bool:
        """Train until the plan is over, nothing is gained any more, or the time is up.

        Returns:
            whether it is finished; a checkpoint is left either way.

        Raises:
            RecognitionError: the loss is no number any more, a process that makes batches was
                killed, or a checkpoint cannot be written.
        """
        with killed_in_words():
            self._go_on(minutes, told)
        self._save()
        return self.progress.update >= self.plan.updates or self._idle()

    def _go_on(self, minutes: float, told: Callable[[Progress], None]) -> None:
        begun = saved = time.monotonic()
        spent = self.progress.seconds
        fed = feed(
            self.data,
            self.learned,
            self.plan,
            self.progress.update,
            workers=self._workers,
            pinned=self.device.type == "cuda",
        )
        for batch in fed:
            now = time.monotonic()
            if now - begun > 60.0 * minutes or self._idle():
                break
            if now - saved > CHECKPOINT_SECONDS:
                self._save()
                saved = now
            self._step(batch)
            self.progress.seconds = spent + time.monotonic() - begun
            if self.progress.update % self.plan.validate == 0:
                self._check()
            if self.progress.update % NOTED == 0:
                told(self.progress)

    def _step(self, batch: Fed) -> None:
        plan, at = self.plan, self.progress
        self.network.train()
        share = plan.rate_at(at.update)
        for group, rate in zip(
            self._optimiser.param_groups, (plan.trunk_rate, plan.rate), strict=True
        ):
            group["lr"] = share * rate
        context = (
            torch.autocast(self.device.type, torch.bfloat16)
            if self.precision == "bfloat16"
            else nullcontext()
        )
        images, truth = batch.on(self.device)
        robot = whose(truth.type, truth.type < len(plan.robots))
        with context:
            seen = self.network(images, robot)
        terms = loss_terms(seen, truth, len(plan.robots))
        loss = total(terms)
        self._optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(self._moving(), _CLIP)
        self._optimiser.step()
        # Early on the mean follows closely, so that the start is soon forgotten.
        kept = min(plan.mean, (1 + at.update) / (10 + at.update))
        with torch.no_grad():
            for slow, fast in zip(self.mean.parameters(), self.network.parameters(), strict=True):
                if fast.requires_grad:
                    slow.lerp_(fast, 1.0 - kept)
        # A GPU is asked once an update, when all of it is under way: each question makes it wait.
        said = torch.stack([loss.detach(), *(v.detach() for v in terms.values())]).tolist()
        if not math.isfinite(said[0]):
            raise RecognitionError(
                f"the loss is {said[0]} at update {at.update + 1}: lower rate and "
                f"trunk_rate; {self._file.name} is of an earlier update"
            )
        at.update += 1
        at.pending.append(dict(zip(("loss", *terms), said, strict=True)))
        if at.update % NOTED == 0:
            names = at.pending[0]
            record: dict[str, Any] = {
                k: round(float(np.mean([r[k] for r in at.pending])), 5) for k in names
            }
            at.curve.append({"stage": 0, "update": at.update} | record)
            at.pending.clear()

    def _check(self) -> None:
        figures = measure(self.mean, self.data, self.some_held, self.device, self.plan.size)
        figures["loss"] = sum(_weighted(figures).values())
        figures["size"] = self.plan.size
        rounded = {k: round(v, 5) for k, v in figures.items()}
        if self.progress.curve:
            self.progress.curve[-1]["validation"] = rounded

    def _idle(self) -> bool:
        """Whether the last ``patience`` measurements brought nothing."""
        losses = [r["validation"]["loss"] for r in self.progress.curve if "validation" in r]
        n = self.plan.patience
        return 0 < n < len(losses) and min(losses[-n:]) > (1 - _BETTER) * min(losses[:-n])

    def _moving(self) -> list[nn.Parameter]:
        return [p for p in self.network.parameters() if p.requires_grad]

    def _make_optimiser(self) -> torch.optim.Optimizer:
        trunk = [p for p in self.network.trunk.parameters() if p.requires_grad]
        of_trunk = {id(p) for p in self.network.trunk.parameters()}
        rest = [p for p in self._moving() if id(p) not in of_trunk]
        groups = [{"params": trunk}, {"params": rest}]
        return torch.optim.AdamW(groups, lr=1e-4, weight_decay=self.plan.decay, fused=True)

    def _save(self) -> None:
        save_checkpoint(self._file, self._both, self._optimiser, self.progress, self._mark())

    def _mark(self) -> str:
        """Of what has to stay the same when a training goes on."""
        fixed = asdict(self.plan)
        for free in ("updates", "size", "validate", "patience", "blend", "precision"):
            del fixed[free]
        if self.origin is not None:
            fixed["origin"] = self.origin.sha256
        return hashlib.sha256(json.dumps(fixed, sort_keys=True).encode()).hexdigest()[:16]


def _weighted(figures: dict[str, float]) -> dict[str, float]:
    from armsight.recognition.any_arm.learning.losses import WEIGHTS

    return {k: w * figures[k] for k, w in WEIGHTS.items()}
