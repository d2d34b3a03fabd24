"""How good the crop network is on crops that it has not learned from."""

from __future__ import annotations

import numpy as np
import torch

from armsight.arrays import Ints
from armsight.recognition.any_arm.heat import read_heat
from armsight.recognition.any_arm.learning.changes import STRIDE, Changes, make_batch
from armsight.recognition.any_arm.learning.examples import Examples
from armsight.recognition.any_arm.learning.feeding import Fed
from armsight.recognition.any_arm.learning.losses import loss_terms
from armsight.recognition.any_arm.learning.network import CropNet

_BATCH = 32


def measure(
    network: CropNet, data: Examples, chosen: Ints, device: torch.device, size: int
) -> dict[str, float]:
    """Losses and figures.

    ``mask_iou`` is the mean over crops with an arm, of cells of 4 px; ``keypoint_px`` the median
    over landmarks within the crop that lie on the arm, the robot taken as given; ``type`` the
    share named rightly.
    """
    network.eval()
    robots = len(network.shape.robots)
    sums: dict[str, float] = {}
    iou: list[float] = []
    errors: list[np.ndarray] = []
    right = 0
    for first in range(0, len(chosen), _BATCH):
        batch = make_batch(data, chosen[first : first + _BATCH], None, 0, Changes(size=size))
        with torch.no_grad():
            images, truth = Fed.of(batch).on(device)
            seen = network(images)
            for name, value in loss_terms(seen, truth, robots).items():
                sums[name] = sums.get(name, 0.0) + float(value) * len(batch.images)
        right += int((seen.type.argmax(1) == truth.type).sum())
        arm = (torch.softmax(seen.links.float(), 1)[:, 0] < 0.5).cpu().numpy()
        true = batch.links[:, 0] < 0.5
        both, either = (arm & true).sum((1, 2)), (arm | true).sum((1, 2))
        has = true.any((1, 2))
        iou += list((both[has] / either[has]).tolist())
        for k, robot in enumerate(batch.type):
            if robot >= robots:
                continue
            found = read_heat(
                seen.heat[k, robot].float().cpu().numpy(),
                seen.outside[k, robot].float().cpu().numpy(),
            )
            p = batch.points[k]
            h, w = true.shape[1:]
            cell = np.round(np.nan_to_num(p, nan=-9.0)).astype(int)
            on = (cell >= 0).all(1) & (cell[:, 0] < w) & (cell[:, 1] < h)
            on[on] = true[k][cell[on, 1], cell[on, 0]]
            errors.append(np.linalg.norm(found.mean[on] - p[on], axis=1) * STRIDE)
    every = np.concatenate(errors) if errors else np.array([np.nan])
    figures = {k: v / max(len(chosen), 1) for k, v in sums.items()}
    return figures | {
        "mask_iou": float(np.mean(iou)) if iou else float("nan"),
        "keypoint_px": float(np.median(every)),
        "within_4": float((every < 4).mean()),
        "type_right": right / max(len(chosen), 1),
    }
