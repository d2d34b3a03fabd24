"""What the crop network is taught: five terms, each in nats a cell or a point."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from armsight.recognition.any_arm.learning.network import OTHERS, Seen

SPOT = 0.8
"""Standard deviation of a landmark's target [cells]."""
WEIGHTS = {"links": 4.0, "overlap": 0.5, "heat": 0.4, "coordinates": 0.3, "type": 0.7}
_SMOOTH = 0.05


@dataclass(frozen=True)
class Truth:
    """A batch's targets as tensors; see :class:`armsight...changes.Batch`."""

    links: Tensor
    coordinates: Tensor
    known: Tensor
    points: Tensor
    type: Tensor


def loss_terms(seen: Seen, truth: Truth, robots: int) -> dict[str, Tensor]:
    """Each term, averaged.

    Args:
        seen: what the network said.
        truth: what is so.
        robots: how many are known; higher types are ``none`` and ``unknown``.
    """
    log_links = functional.log_softmax(seen.links.float(), 1)
    known = truth.type < robots
    unknown = truth.type == robots + OTHERS.index("unknown")
    named = -(truth.links * log_links).sum(1)
    # Of an arm that nobody knows, the links have no names: arm or not is all that is taught.
    arm = torch.logsumexp(log_links[:, 1:], 1)
    share = 1.0 - truth.links[:, 0]
    plain = -(truth.links[:, 0] * log_links[:, 0] + share * arm)
    links = torch.where(unknown[:, None, None], plain, named).mean()
    p = arm.exp()
    both = (p * share).sum((1, 2))
    overlap = 1.0 - (2.0 * both + 1.0) / (p.sum((1, 2)) + share.sum((1, 2)) + 1.0)
    return {
        "links": links,
        "overlap": overlap.mean(),
        "heat": _heat(seen, truth, known),
        "coordinates": _coordinates(seen, truth),
        "type": functional.cross_entropy(seen.type.float(), truth.type, label_smoothing=_SMOOTH),
    }


def _heat(seen: Seen, truth: Truth, known: Tensor) -> Tensor:
    """Cross-entropy of one softmax over all cells and "outside"."""
    n, _, _, h, w = seen.heat.shape
    robot = whose(truth.type, known)
    if seen.heat.shape[1] == 1:
        robot = torch.zeros_like(robot)
    rows = torch.arange(n, device=robot.device)
    heat = seen.heat[rows, robot].float().flatten(2)
    outside = seen.outside[rows, robot].float()
    log_all = functional.log_softmax(torch.cat([heat, outside[..., None]], 2), 2)
    points = truth.points
    given = torch.isfinite(points).all(-1) & known[:, None]
    x, y = points.nan_to_num(-1e3).unbind(-1)
    inside = (x > -0.5) & (y > -0.5) & (x < w - 0.5) & (y < h - 0.5)
    gx = torch.exp(-0.5 * ((torch.arange(w, device=x.device) - x[..., None]) / SPOT) ** 2)
    gy = torch.exp(-0.5 * ((torch.arange(h, device=x.device) - y[..., None]) / SPOT) ** 2)
    target = (gy[..., :, None] * gx[..., None, :]).flatten(2)
    target = target / target.sum(2, keepdim=True).clamp_min(1e-6)
    on = -(target * log_all[..., :-1]).sum(2)
    each = torch.where(inside, on, -log_all[..., -1])
    return (each * given).sum() / given.sum().clamp_min(1)


def whose(kind: Tensor, known: Tensor) -> Tensor:
    """(n,) the robot whose landmarks are looked at: the right one, or any where there is none."""
    return torch.where(known, kind, 0)


def _coordinates(seen: Seen, truth: Truth) -> Tensor:
    """Laplace's negative log likelihood with the spread that the network states."""
    spread = seen.spread.float().clamp(-4.0, 1.5)
    far = (seen.coordinates.float() - truth.coordinates).abs().sum(1)
    each = far * torch.exp(-spread) + 3.0 * spread
    return (each * truth.known).sum() / truth.known.sum().clamp_min(1)


def total(terms: dict[str, Tensor]) -> Tensor:
    """The weighted sum."""
    return torch.stack([WEIGHTS[k] * v for k, v in terms.items()]).sum()
