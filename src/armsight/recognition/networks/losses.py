"""The losses of T4 to T7 (their equations 1 to 8).

The logarithm's arguments of the mask's cross-entropy are T7's (estimate inside the logarithm); T4
to T6 print them the other way round, which has no finite value. The papers clip what stands inside
it against zero; here it is computed from the logit, which needs no clipping.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from armsight.recognition.networks.layers import Outputs

_TINY = 1e-12
"""[m^2]; keeps the gradient of a distance of zero finite."""


@dataclass(frozen=True)
class Targets:
    """The truth of a batch of n images.

    Attributes:
        mask: (n, h, w) bool, where the robot is.
        joints: (n, j, 3) joint origins in the camera's frame [m]; anything where there is no joint.
        has_joint: (n, j) bool.
        base: (n, 3) base origin in the camera's frame [m].
        type: (n,) index of the robot's type.
    """

    mask: Tensor
    joints: Tensor
    has_joint: Tensor
    base: Tensor
    type: Tensor


@dataclass(frozen=True)
class LossWeights:
    """Weights of the four losses in the sum (equation 8); those of T5 and T6."""

    mask: float = 1.0
    joints: float = 1.5
    base: float = 1.5
    type: float = 0.3


def mask_loss(logits: Tensor, truth: Tensor, share: float) -> Tensor:
    """Cross-entropy a pixel, weighted by inverse class probability, mean over pixels and images.

    ``-w_fg i_gt log(i_est) - w_bg (1 - i_gt) log(1 - i_est)`` (T7, equations 1 to 4).

    These weights make an estimate right whose odds are w_fg / w_bg times the true ones: where 4 %
    of the pixels are robot, one that is robot with 4 % counts as robot, and masks come out several
    times too large. So the network answers true odds, and the loss multiplies them by w_fg / w_bg:
    the same minimum, with the weights taken back where the mask is cut.

    Args:
        logits: (n, h, w) of the true odds.
        truth: (n, h, w) bool.
        share: P(fg) in 0..1; the papers do not say over what: here over the training set.
    """
    weight = torch.where(truth, 1.0 / share, 1.0 / (1.0 - share))
    weighted = logits.float() + math.log((1.0 - share) / share)
    return functional.binary_cross_entropy_with_logits(
        weighted, truth.to(torch.float32), weight=weight
    )


def distance(estimate: Tensor, truth: Tensor) -> Tensor:
    """(...) Euclidean distances [m] of (..., 3) points."""
    return ((estimate.float() - truth).square().sum(-1) + _TINY).sqrt()


def joints_loss(estimate: Tensor, truth: Tensor, has_joint: Tensor) -> Tensor:
    """Mean distance over the joints that each robot has, mean over images [m] (equation 5)."""
    present = has_joint.to(torch.float32)
    total = (distance(estimate, torch.where(has_joint[..., None], truth, 0.0)) * present).sum(-1)
    return (total / present.sum(-1)).mean()


def loss_terms(outputs: Outputs, truth: Targets, share: float) -> dict[str, Tensor]:
    """The losses of what the network answered, by the names of :class:`LossWeights`."""
    terms: dict[str, Tensor] = {}
    if outputs.mask is not None:
        terms["mask"] = mask_loss(outputs.mask, truth.mask, share)
    if outputs.joints is not None and outputs.base is not None:
        terms["joints"] = joints_loss(outputs.joints, truth.joints, truth.has_joint)
        terms["base"] = distance(outputs.base, truth.base).mean()
    if outputs.type is not None:
        terms["type"] = functional.cross_entropy(outputs.type.float(), truth.type)
    return terms


def total_loss(terms: dict[str, Tensor], weights: LossWeights) -> Tensor:
    """The weighted sum (equation 8)."""
    parts = [getattr(weights, name) * value for name, value in terms.items()]
    return torch.stack(parts).sum()
