"""Weights with their card: what the network is, and what it was trained on, in one file.

The file is of the safetensors format (nothing in it can be run); the card is JSON in its header.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from armsight.errors import RecognitionError
from armsight.recognition.networks.architecture import read_description
from armsight.recognition.networks.build import Network, build_network
from armsight.recognition.training.tensors_file import Array, read_tensors, write_tensors

FORMAT = "armsight-weights-1"
LICENCE = "Apache-2.0"
Card = dict[str, Any]


def arrays_of(network: nn.Module) -> dict[str, Array]:
    """The network's weights as float32 arrays."""
    return {k: v.detach().cpu().numpy() for k, v in network.state_dict().items()}


def set_arrays(network: nn.Module, arrays: Mapping[str, Array]) -> None:
    """Give a network its weights.

    Raises:
        RecognitionError: a weight is missing, too many, of another shape, or not finite.
    """
    own = network.state_dict()
    for name, value in own.items():
        array = arrays.get(name)
        if array is None or array.shape != tuple(value.shape) or array.dtype != np.float32:
            raise RecognitionError(f'the weights "{name}" are missing or of another network')
        if not np.isfinite(array).all():
            raise RecognitionError(f'the weights "{name}" hold a number that is not finite')
    if extra := sorted(set(arrays) - set(own)):
        raise RecognitionError(f'the weights "{extra[0]}" belong to no layer of this network')
    network.load_state_dict({k: torch.from_numpy(np.array(v)) for k, v in arrays.items()})


def save_weights(file: Path, network: Network, card: Card) -> None:
    """Write a network and its card, whole or not at all.

    Raises:
        RecognitionError: the file cannot be written.
    """
    words = {
        "format": FORMAT,
        "architecture": json.dumps(network.architecture.to_json()),
        "card": json.dumps(card, allow_nan=False),
    }
    write_tensors(file, arrays_of(network), words)


def load_weights(file: Path) -> tuple[Network, Card]:
    """The network of a file, with its weights, and its card.

    Raises:
        RecognitionError: the file is missing, damaged, or no network's weights of armsight.
    """
    arrays, words = read_tensors(file)
    if words.get("format") != FORMAT:
        raise RecognitionError(
            f"{file}: holds no weights of armsight's networks; train some with 'armsight train'"
        )
    architecture, card = read_description(file, words, "restore it")
    network = build_network(architecture)
    try:
        set_arrays(network, arrays)
    except RecognitionError as error:
        raise RecognitionError(f"{file}: {error}; restore it") from None
    return network, card
