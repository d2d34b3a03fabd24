"""Everything that a training needs to go on as if it had never stopped.

Weights, the optimiser's memory, the stage, the update, what the saturation rule remembers, and the
curve so far, in one safetensors file that is replaced as a whole. The order of the batches is no
state (``batches.py``), and the papers' networks draw nothing at random while they train.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from armsight.errors import RecognitionError
from armsight.recognition.training.tensors_file import Array, read_tensors, write_tensors
from armsight.recognition.training.weights import arrays_of, set_arrays

FORMAT = "armsight-checkpoint-1"


@dataclass
class Progress:
    """Where a training stands.

    Attributes:
        stage: number of the stage that is being trained, or as many as there are.
        update: updates of that stage that are over.
        seconds: of computing so far.
        saturation: what the stage's rule remembers.
        ended: for each stage that is over, the updates it took and why it ended.
        curve: one record each time that the loss was noted.
        pending: losses of the updates since the last record.
    """

    stage: int = 0
    update: int = 0
    seconds: float = 0.0
    saturation: list[float] = field(default_factory=list)
    ended: list[dict[str, Any]] = field(default_factory=list)
    curve: list[dict[str, Any]] = field(default_factory=list)
    pending: list[dict[str, float]] = field(default_factory=list)


def save_checkpoint(
    file: Path,
    network: nn.Module,
    optimiser: torch.optim.Optimizer | None,
    progress: Progress,
    fingerprint: str,
) -> None:
    """Write a checkpoint, whole or not at all.

    Raises:
        RecognitionError: the disk is full, or the folder cannot be written.
    """
    tensors = {f"weights/{k}": v for k, v in arrays_of(network).items()}
    if optimiser is not None:
        for number, memory in optimiser.state_dict()["state"].items():
            for name, value in memory.items():
                if value is not None:
                    tensors[f"optimiser/{number}/{name}"] = value.detach().cpu().numpy()
    words = {
        "format": FORMAT,
        "fingerprint": fingerprint,
        "progress": json.dumps(vars(progress)),
    }
    write_tensors(file, tensors, words)


def load_checkpoint(
    file: Path, network: nn.Module, fingerprint: str
) -> tuple[Progress, dict[int, dict[str, Array]]]:
    """Set the network's weights; return where the training stands and the optimiser's memory.

    Raises:
        RecognitionError: the checkpoint is damaged, or of a training with other settings or data.
    """
    arrays, words = read_tensors(file)
    if words.get("format") != FORMAT:
        raise RecognitionError(f"{file}: is no checkpoint; delete it to begin anew")
    if words.get("fingerprint") != fingerprint:
        raise RecognitionError(
            f"{file}: was begun with another configuration, data set or starting weights; "
            "name another --out, or delete it to begin anew"
        )
    try:
        progress = Progress(**json.loads(words["progress"]))
        memory: dict[int, dict[str, Array]] = {}
        weights: dict[str, Array] = {}
        for name, array in arrays.items():
            kind, rest = name.split("/", 1)
            if kind == "weights":
                weights[rest] = array
            else:
                number, key = rest.split("/")
                memory.setdefault(int(number), {})[key] = array
        set_arrays(network, weights)
    except (KeyError, ValueError, TypeError) as error:
        raise RecognitionError(f"{file}: is damaged ({error}); delete it to begin anew") from None
    return progress, memory


def remember(optimiser: torch.optim.Optimizer, memory: dict[int, dict[str, Array]]) -> None:
    """Give an optimiser its memory back, bit for bit.

    Each array gets the memory layout of the weights that it belongs to: the fused optimisers walk
    both side by side.

    Raises:
        RecognitionError: the memory is of other weights.
    """
    moving = [p for group in optimiser.param_groups for p in group["params"]]
    kept: dict[int, dict[str, torch.Tensor]] = {}
    for number, values in memory.items():
        if number >= len(moving):
            raise RecognitionError("the checkpoint's optimiser had other weights; begin anew")
        kept[number] = {}
        for name, value in values.items():
            tensor = torch.from_numpy(np.array(value))
            if tensor.shape == moving[number].shape:
                tensor = torch.empty_like(moving[number], requires_grad=False).copy_(tensor)
            elif tensor.dim():
                raise RecognitionError("the checkpoint's optimiser had other weights; begin anew")
            kept[number][name] = tensor
    state = optimiser.state_dict()
    state["state"] = kept
    optimiser.load_state_dict(state)
