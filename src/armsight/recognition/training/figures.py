"""Figures of a network on samples of a packed set, whoever computes its answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Ints, Mask
from armsight.recognition.metrics import (
    add_auc,
    frame_errors,
    mask_accuracy,
    mask_iou,
    point_errors,
    share_over,
)
from armsight.recognition.networks.architecture import Architecture
from armsight.recognition.training.packed_set import MOST_JOINTS, PackedSet
from armsight.recognition.training.tensors_file import Array

Answer = Callable[[Array, Ints], dict[str, Array]]
"""From (n, h, w, 3) uint8 images, and their places in the packed set, to the outputs that
``export.py`` names."""
_BATCH = 16


@dataclass(frozen=True)
class Scores:
    """How a network did on each of n frames; the frames of ``samples``, in that order.

    Attributes:
        samples: (n,) places in the packed set.
        robot: (n,) names.
        said: (n,) names of the types that it answered; its only robot where it knows one.
        accuracy, iou: (n,) of the mask.
        joints: (n, 7) error of each joint [m]; NaN where there is none.
        base: (n,) error of the base [m].
        distance: (n,) of the base from the camera [m].
    """

    samples: Ints
    robot: Array
    said: Array
    accuracy: Floats
    iou: Floats
    joints: Floats
    base: Floats
    distance: Floats

    @property
    def add(self) -> Floats:
        """(n,) mean joint error of each frame [m]."""
        return frame_errors(self.joints)

    def of(self, chosen: Mask) -> Scores:
        """Some of the frames."""
        return Scores(**{k: v[chosen] for k, v in vars(self).items()})

    def summary(self) -> dict[str, float]:
        """The figures of a card; lengths in mm, shares in 0..1, failures counted."""
        add = self.add
        return {
            "frames": len(add),
            "mask_accuracy": float(self.accuracy.mean()),
            "mask_iou": float(self.iou.mean()),
            "type_accuracy": float((self.said == self.robot).mean()),
            "joint_mean_mm": 1e3 * float(np.mean(add)),
            "joint_median_mm": 1e3 * float(np.median(add)),
            "base_mean_mm": 1e3 * float(np.mean(self.base)),
            "base_median_mm": 1e3 * float(np.median(self.base)),
            "add_auc": add_auc(add),
            "over_100_mm": share_over(add),
        }


def score(answer: Answer, architecture: Architecture, data: PackedSet, samples: Ints) -> Scores:
    """Ask a network about samples and compare with the truth."""
    estimates: dict[str, list[Array]] = {"joints": [], "base": [], "type": []}
    accuracy, iou = [], []
    for first in range(0, len(samples), _BATCH):
        part = samples[first : first + _BATCH]
        said = answer(data.images[part], part)
        mask, truth = said["mask"] >= 0.5, data.masks(part)
        accuracy.append(mask_accuracy(mask, truth))
        iou.append(mask_iou(mask, truth))
        for name in estimates:
            if name in said:
                estimates[name].append(said[name])
    joints = np.full((len(samples), MOST_JOINTS, 3), np.nan)
    joints[:, : architecture.joints] = np.concatenate(estimates["joints"])
    base = np.concatenate(estimates["base"])
    robots = np.array([data.robots[int(r)] for r in data.robot[samples]])
    names = np.array(architecture.robots)
    types = estimates["type"]
    chosen = np.concatenate(types).argmax(axis=1) if types else np.zeros(len(samples), int)
    return Scores(
        samples,
        robots,
        names[chosen],
        np.concatenate(accuracy),
        np.concatenate(iou),
        point_errors(joints, data.joints[samples].astype(float)),
        point_errors(base[:, None], data.base[samples][:, None].astype(float))[:, 0],
        np.linalg.norm(data.base[samples].astype(float), axis=1),
    )
