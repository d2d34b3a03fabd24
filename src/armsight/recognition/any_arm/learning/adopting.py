"""A training that begins from a finished network: the weights in its ONNX file, by their names."""

from __future__ import annotations

import copy
import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from armsight.errors import RecognitionError
from armsight.recognition.any_arm.learning.network import CropNet
from armsight.recognition.any_arm.model import CropModel

_SHARED = {
    "common_heat": "heat",
    "common_outside": "outside",
    "fine_common_heat": "fine_heat",
}
"""What robots share: a file holds its sum with what is each robot's own."""

_LATER = ("of_links",)
"""What files from before it do not hold: it begins at nothing there."""


@dataclass(frozen=True)
class Origin:
    """The finished network that a training begins from.

    Attributes:
        file: ONNX file that :func:`armsight...export.to_onnx` wrote.
        sha256: of the file.
        updates: that made it; crops: that it learned from.
    """

    file: Path
    sha256: str
    updates: int
    crops: int


def find_origin(file: Path) -> Origin:
    """A finished network's file.

    Raises:
        RecognitionError: it cannot be read, or is no crop network.
    """
    card = CropModel(file, 1).card
    sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
    try:
        crops = sum(int(n) for n in card["data"].values())
        return Origin(file, sha256, int(card["training"]["updates"]), crops)
    except (KeyError, AttributeError, TypeError, ValueError):
        raise RecognitionError(f"{file}: its card does not say how it was trained") from None


def adopt(network: CropNet, origin: Origin) -> None:
    """Give a network the weights of a finished one.

    What robots share and what is each robot's own is one sum in the file; the mean over the robots
    becomes what they share, so that the answers stay as they are.

    Raises:
        RecognitionError: it knows other robots, is of another build, or was written before weights
            had names.
    """
    found = _constants(origin.file)
    with torch.no_grad():
        for name, weight in network.named_parameters():
            part = name.split(".")[0]
            if part in _LATER and name not in found:
                weight.zero_()
            elif part not in _SHARED:
                weight.copy_(_taken(found, name, weight, origin.file))
        for shared, own in _SHARED.items():
            for part in ("weight", "bias"):
                each = [network.get_parameter(f"{own}.{n}.{part}") for n in network.shape.robots]
                mean = torch.stack(list(each)).mean(0)
                network.get_parameter(f"{shared}.{part}").copy_(mean)
                for weight in each:
                    weight.sub_(mean)


def blend(network: CropNet, origin: Origin, share: float) -> None:
    """Leave a network this share of its weights, and the rest of the one that it began from."""
    before = copy.deepcopy(network)
    adopt(before, origin)
    with torch.no_grad():
        for new, old in zip(network.parameters(), before.parameters(), strict=True):
            new.copy_(old.lerp(new, share))


def _taken(found: dict[str, Tensor], name: str, weight: Tensor, file: Path) -> Tensor:
    value = found.get(name)
    if value is None or value.shape != weight.shape or not bool(torch.isfinite(value).all()):
        what = "is missing" if value is None else "has another shape or is not finite"
        raise RecognitionError(
            f'{file}: cannot be begun from: "{name}" {what}; '
            "give a network.onnx of armsight that knows the plan's robots"
        )
    return value


def _constants(file: Path) -> dict[str, Tensor]:
    """The float constants of an ONNX file, by name."""
    try:
        import onnx
    except ImportError:
        raise RecognitionError(
            "to begin from a network's file the package onnx is needed: pip install onnx"
        ) from None
    # Read as bytes: a file of ours holds its weights itself, and no path in it is followed.
    graph = onnx.load_model_from_string(file.read_bytes()).graph
    return {
        t.name: torch.from_numpy(np.array(onnx.numpy_helper.to_array(t)))
        for t in graph.initializer
        if t.data_type == onnx.TensorProto.FLOAT and not t.external_data
    }
