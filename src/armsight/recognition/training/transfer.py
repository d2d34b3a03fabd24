"""T6 and T7: a trained network learns new robots; what it knows stays where it can.

The convolutions, the hidden dense layers and the outputs of what the old network knew are taken
over. New are only the output rows of joints that no old robot had (T6's seventh) and of types that
it did not know. T6 then trains the dense layers and the mask branch's last two convolutions on the
new robot; T7 does the same on all robots until the loss saturates, then the later convolutions too.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from armsight.arrays import Ints
from armsight.errors import RecognitionError
from armsight.recognition.networks.architecture import Architecture
from armsight.recognition.networks.build import build_network
from armsight.recognition.networks.multi_objective import MultiObjectiveNet
from armsight.recognition.training.packed_set import PackedSet

_SAME = ("kind", "width", "height", "filters", "dense", "pools")


def extend(old: MultiObjectiveNet, wanted: Architecture, seed: int = 0) -> MultiObjectiveNet:
    """A network for more robots that begins with everything the old one knows.

    Before it is trained it gives the old outputs for the old joints, the base and the old types
    (the types' logits), bit for bit.

    Raises:
        RecognitionError: the two differ in more than the robots, or the new one lacks an old robot.
    """
    known = old.architecture
    differs = [f for f in _SAME if getattr(known, f) != getattr(wanted, f)]
    if differs or not isinstance(old, MultiObjectiveNet):
        name = differs[0] if differs else "kind"
        raise RecognitionError(
            f"the weights' network has {name} {getattr(known, name)}, the configuration wants "
            f"{getattr(wanted, name)}; a transfer changes the robots only"
        )
    lost = [r for r in known.robots if r not in wanted.robots]
    if lost:
        raise RecognitionError(
            f"the weights know {lost[0]} and the configuration's robots do not; name all old ones"
        )
    new = build_network(wanted, seed)
    assert isinstance(new, MultiObjectiveNet)
    state, mine = old.state_dict(), new.state_dict()
    for name, value in state.items():
        if mine[name].shape == value.shape:
            mine[name].copy_(value)
    places = [wanted.robots.index(r) for r in known.robots]
    _take_rows(new.outputs["robot"].full, old.outputs["robot"].full, places)
    rows = list(range(3 * known.joints))
    _take_rows(new.outputs["joints"].full, old.outputs["joints"].full, rows)
    return new


def _take_rows(new: nn.Linear, old: nn.Linear, places: list[int]) -> None:
    """Row k of the old layer becomes row ``places[k]`` of the new one."""
    with torch.no_grad():
        new.weight[places] = old.weight
        new.bias[places] = old.bias


def start_new_joints(
    network: MultiObjectiveNet, old: Architecture, data: PackedSet, chosen: Ints
) -> None:
    """Let joints that the old network had not begin at their mean over the training samples."""
    joints = data.joints[chosen][:, old.joints : network.architecture.joints]
    if joints.shape[1] == 0 or np.isnan(joints).all():
        return
    mean = torch.from_numpy(np.nanmean(joints.astype(np.float64), axis=0).astype(np.float32))
    with torch.no_grad():
        network.outputs["joints"].full.bias[3 * old.joints :] = mean.reshape(-1)
