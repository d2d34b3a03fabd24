"""The training loop: stages, updates, checkpoints; ends, stops and goes on exactly."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from armsight.arrays import Ints, Mask
from armsight.errors import RecognitionError
from armsight.recognition.networks.architecture import Architecture
from armsight.recognition.networks.build import Network
from armsight.recognition.networks.losses import LossWeights, Targets, loss_terms, total_loss
from armsight.recognition.training.augment import Augmentation, Augmenter
from armsight.recognition.training.batches import Batches
from armsight.recognition.training.checkpoint import (
    Progress,
    load_checkpoint,
    remember,
    save_checkpoint,
)
from armsight.recognition.training.config import Stage, TrainingConfig
from armsight.recognition.training.packed_set import PackedSet
from armsight.recognition.training.schedule import Saturation, ramp

CHECKPOINT_SECONDS = 120.0
NOTED = 25
"""Updates between two records of the curve."""
CHECKED = 20
"""Records between two measurements on validation samples."""
VALIDATION_SAMPLES = 128


@dataclass(frozen=True)
class Samples:
    """Samples on the device that trains.

    Attributes:
        images: (n, h, w, 3) uint8.
        targets: their truth.
    """

    images: torch.Tensor
    targets: Targets

    def batch(self, places: Ints) -> tuple[torch.Tensor, Targets]:
        """Images and truth of some of them."""
        k = torch.from_numpy(np.asarray(places, np.int64)).to(self.images.device)
        t = self.targets
        return self.images[k], Targets(t.mask[k], t.joints[k], t.has_joint[k], t.base[k], t.type[k])


def samples_on(
    data: PackedSet, chosen: Ints, architecture: Architecture, device: torch.device
) -> Samples:
    """Some samples of a packed set, as a network of this architecture learns them."""
    joints = torch.from_numpy(data.joints[chosen][:, : architecture.joints].copy())
    order = {name: k for k, name in enumerate(architecture.robots)}
    types = [order[data.robots[int(r)]] for r in data.robot[chosen]]
    targets = Targets(
        torch.from_numpy(data.masks(chosen)).to(device),
        joints.nan_to_num().to(device),
        (~joints.isnan().any(-1)).to(device),
        torch.from_numpy(data.base[chosen]).to(device),
        torch.tensor(types, dtype=torch.int64).to(device),
    )
    return Samples(torch.from_numpy(data.images[chosen]).to(device), targets)


@dataclass(frozen=True)
class Stopped:
    """How far a call of :meth:`Trainer.run` came.

    Attributes:
        finished: every stage is over.
        progress: where the training stands.
    """

    finished: bool
    progress: Progress


class Trainer:
    """Trains one network by a configuration on a packed set.

    A checkpoint in ``folder`` is gone on from. On a CPU the same seed, data, thread count and
    machine give the same weights bit for bit, however often the training was stopped.

    Args:
        config: what to do.
        data: what to learn from.
        network: with the weights that it starts from.
        folder: for checkpoints.
        device: where to compute.
        parent: fingerprint of the weights that a transfer starts from, else empty.

    Raises:
        RecognitionError: data, network and configuration do not fit, or the checkpoint is of
            another training.
    """

    def __init__(
        self,
        config: TrainingConfig,
        data: PackedSet,
        network: Network,
        folder: Path,
        device: torch.device | None = None,
        parent: str = "",
    ) -> None:
        architecture = config.architecture
        if data.size != (architecture.width, architecture.height):
            raise RecognitionError(
                f"the data is packed at {data.size[0]} x {data.size[1]} pixels, the configuration "
                f"wants {architecture.width} x {architecture.height}; pack it at that size"
            )
        self.config, self.data = config, data
        self.device = device or torch.device("cpu")
        self.network = network.to(self.device, memory_format=torch.channels_last)
        self._checkpoint = folder / "checkpoint.safetensors"
        robots = config.trained_robots
        self.chosen = data.select("train", config.split, robots, config.limit, config.seed)
        validation = data.select("validation", config.split, robots)
        rng = np.random.default_rng([config.seed, 37])
        validation = np.sort(rng.permutation(validation)[:VALIDATION_SAMPLES])
        self._train = samples_on(data, self.chosen, architecture, self.device)
        self._validation = samples_on(data, validation, architecture, self.device)
        self.share = _share(data.masks(self.chosen))
        self.progress = Progress()
        self._memory: dict[int, dict[str, Any]] = {}
        self._augmenter: Augmenter | None = None
        self._fingerprint = fingerprint(config, data, self.chosen, parent)
        if self._checkpoint.is_file():
            self.progress, self._memory = load_checkpoint(
                self._checkpoint, self.network, self._fingerprint
            )

    @property
    def precision(self) -> str:
        """What the convolutions compute in."""
        if self.config.precision != "auto":
            return self.config.precision
        return "bfloat16" if self.device.type == "cuda" else "float32"

    def run(
        self,
        minutes: float = math.inf,
        told: Callable[[Progress], None] = lambda progress: None,
    ) -> Stopped:
        """Train until the last stage is over or the time is up; a checkpoint is left either way.

        Args:
            minutes: of wall time, checked between updates.
            told: called at each record of the curve.

        Raises:
            RecognitionError: the loss is no number any more, or a checkpoint cannot be written.
        """
        end = time.monotonic() + 60.0 * minutes
        while self.progress.stage < len(self.config.stages):
            if not self._run_stage(self.config.stages[self.progress.stage], end, told):
                return Stopped(False, self.progress)
        return Stopped(True, self.progress)

    def _run_stage(self, stage: Stage, end: float, told: Callable[[Progress], None]) -> bool:
        """Whether the stage came to its end."""
        at = self.progress
        moving = self._moving(stage)
        optimiser = _optimiser(stage, moving)
        if self._memory:
            remember(optimiser, self._memory)
            self._memory = {}
        self._augmenter = self._augmenter_of(at.stage)
        batches = Batches(len(self.chosen), stage.batch, self.config.seed, at.stage)
        saturation = Saturation(stage.saturation, at.saturation)
        saved = begun = time.monotonic()
        why = "" if at.update < stage.updates else "updates"
        self.network.train()
        while not why:
            if time.monotonic() >= end:
                at.seconds += time.monotonic() - begun
                at.saturation = saturation.state()
                self._save(optimiser)
                return False
            terms = self._update(stage, optimiser, batches, at.update)
            at.update += 1
            at.pending.append(terms)
            if not math.isfinite(terms["loss"]):
                raise RecognitionError(
                    f"the loss is {terms['loss']} at update {at.update} of stage {stage.name}: "
                    "lower its learning rate"
                )
            if saturation.saturated(terms["loss"]):
                why = "saturated"
            elif at.update >= stage.updates:
                why = "updates"
            if at.update % NOTED == 0 or why:
                now = time.monotonic()
                at.seconds += now - begun
                begun = now
                self._note(stage, batches, bool(why))
                told(at)
                # Not at the end: gone on from there, the stage would not know that it is over.
                if not why and now - saved > CHECKPOINT_SECONDS:
                    at.saturation = saturation.state()
                    self._save(optimiser)
                    saved = now
        at.ended.append({"stage": stage.name, "updates": at.update, "why": why})
        at.stage, at.update, at.saturation = at.stage + 1, 0, []
        self._save(None)
        return True

    def _update(
        self, stage: Stage, optimiser: torch.optim.Optimizer, batches: Batches, update: int
    ) -> dict[str, float]:
        """One step; the losses before it."""
        done = update / max(1, stage.updates - 1)
        for group in optimiser.param_groups:
            group["lr"] = group["share"] * ramp(stage.learning_rate, done, stage.fall)
            if stage.optimiser == "nesterov":
                group["momentum"] = ramp(stage.momentum, done)
        images, truth = self._train.batch(batches[update])
        if self._augmenter is not None:
            images, truth = self._augmenter(images, truth, update)
        terms, loss = self._losses(stage, images, truth)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        values = torch.stack([loss.detach(), *(t.detach() for t in terms.values())]).tolist()
        return dict(zip(("loss", *terms), values, strict=True))

    def _augmenter_of(self, stage: int) -> Augmenter | None:
        """What changes the pictures of a stage; None where nothing does."""
        if not self.config.augment:
            return None
        how: dict[str, Any] = dict(self.config.augment)
        K = torch.from_numpy(self.data.mean_K())
        return Augmenter(Augmentation(**how), K, self.config.seed, stage)

    def _losses(
        self, stage: Stage, images: torch.Tensor, truth: Targets
    ) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        mixed = self.precision == "bfloat16"
        with torch.autocast(self.device.type, torch.bfloat16) if mixed else nullcontext():
            outputs = self.network(
                images,
                truth.mask if stage.true_masks else None,
                want_mask="mask" in stage.loss,
                want_rest=any(k != "mask" for k in stage.loss),
            )
        found = loss_terms(outputs, truth, self.share)
        terms = {k: v for k, v in found.items() if k in stage.loss}
        return terms, total_loss(terms, LossWeights(**{**_NO_LOSS, **stage.loss}))

    def _moving(self, stage: Stage) -> list[torch.nn.Parameter]:
        """The weights that a stage trains; the others are frozen."""
        groups = self.network.groups()
        unknown = [g for g in stage.trains if g not in groups]
        if unknown:
            raise RecognitionError(
                f'stage {stage.name} trains "{unknown[0]}", known: {", ".join(groups)}'
            )
        wanted = stage.trains or tuple(groups)
        moving = [p for g in wanted for layer in groups[g] for p in layer.parameters()]
        ids = {id(p) for p in moving}
        for p in self.network.parameters():
            p.requires_grad_(id(p) in ids)
        return moving

    def _note(self, stage: Stage, batches: Batches, last: bool) -> None:
        """One more record of the curve; now and then with figures of validation samples."""
        at = self.progress
        record: dict[str, Any] = {
            "stage": at.stage,
            "update": at.update,
            "epoch": round(batches.epoch(at.update), 3),
            "seconds": round(at.seconds, 1),
        }
        record |= {k: float(np.mean([p[k] for p in at.pending])) for k in at.pending[0]}
        at.pending.clear()
        if last or (at.update // NOTED) % CHECKED == 0:
            record["validation"] = self._validate(stage)
        at.curve.append(record)

    def _validate(self, stage: Stage) -> dict[str, float]:
        """Losses on the validation samples, each frame once."""
        self.network.eval()
        sums: dict[str, float] = {}
        count = len(self._validation.images)
        with torch.no_grad():
            for first in range(0, count, 32):
                places = np.arange(first, min(first + 32, count))
                terms, loss = self._losses(stage, *self._validation.batch(places))
                for name, value in {"loss": loss, **terms}.items():
                    sums[name] = sums.get(name, 0.0) + float(value) * len(places)
        self.network.train()
        return {name: value / count for name, value in sums.items()}

    def _save(self, optimiser: torch.optim.Optimizer | None) -> None:
        save_checkpoint(self._checkpoint, self.network, optimiser, self.progress, self._fingerprint)


_NO_LOSS = {"mask": 0.0, "joints": 0.0, "base": 0.0, "type": 0.0}


def _optimiser(stage: Stage, moving: list[torch.nn.Parameter]) -> torch.optim.Optimizer:
    """The stage's optimiser; ``share`` of a group is of the learning rate."""
    groups: dict[float, list[torch.nn.Parameter]] = {}
    for p in moving:
        wide = stage.wide_inputs and p.dim() == 2
        share = min(1.0, stage.wide_inputs / p.shape[1]) if wide else 1.0
        groups.setdefault(share, []).append(p)
    given = [{"params": params, "share": share} for share, params in groups.items()]
    if stage.optimiser == "adam":
        return torch.optim.Adam(given, lr=stage.learning_rate[0], fused=True)
    return torch.optim.SGD(
        given, lr=stage.learning_rate[0], momentum=stage.momentum[0], nesterov=True, fused=True
    )


def _share(masks: Mask) -> float:
    """P(fg) over the training set, kept off 0 and 1 (the papers clip, too)."""
    mean = float(masks.mean())
    return min(max(mean, 1e-4), 1.0 - 1e-4)


def fingerprint(config: TrainingConfig, data: PackedSet, chosen: Ints, parent: str) -> str:
    """What a training is: another one must not go on from its checkpoint."""
    whole = hashlib.sha256()
    whole.update(json.dumps([config.to_json(), data.source, parent], sort_keys=True).encode())
    for array in (chosen, data.images[chosen], data.base[chosen]):
        whole.update(np.ascontiguousarray(array).data)
    return whole.hexdigest()[:32]


def start_at_mean(network: Network, data: PackedSet, chosen: Ints) -> None:
    """Let base, joints and mask begin at their mean over the training samples.

    The papers say nothing about how outputs start; from zero, metres take thousands of updates.
    """
    joints = data.joints[chosen][:, : network.architecture.joints].astype(np.float64)
    starts = (data.base[chosen].mean(axis=0), np.nanmean(joints, axis=0).reshape(-1))
    with torch.no_grad():
        for (layer, rows), values in zip(network.regressions(), starts, strict=True):
            layer.bias[rows] = torch.from_numpy(np.asarray(values, np.float32)).to(
                layer.bias.device
            )
        share = _share(data.masks(chosen))
        network.mask_layer().bias.fill_(math.log(share / (1.0 - share)))
