"""A network from its architecture."""

from __future__ import annotations

from typing import TypeAlias

import torch

from armsight.recognition.networks.architecture import Architecture
from armsight.recognition.networks.cascaded import CascadedNet
from armsight.recognition.networks.multi_objective import MultiObjectiveNet

Network: TypeAlias = CascadedNet | MultiObjectiveNet

_NETWORKS: dict[str, type[CascadedNet] | type[MultiObjectiveNet]] = {
    "cascaded": CascadedNet,
    "multi-objective": MultiObjectiveNet,
}


def build_network(architecture: Architecture, seed: int = 0) -> Network:
    """A network whose weights start from a seed, the same on every machine of one torch version."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return _NETWORKS[architecture.kind](architecture)
