"""Layers that the papers' networks share: convolutions that keep the size, and how they start."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional


def same_padding(side: int, dilation: int) -> tuple[int, int]:
    """Zeros before and after, so that a dilated filter keeps the size of its input.

    A 2 x 2 filter of dilation 3 covers 4 pixels and needs 3 zeros: 1 before, 2 after. ONNX
    Runtime refuses automatic padding together with dilation, so both write it out.
    """
    total = dilation * (side - 1)
    return total // 2, total - total // 2


class SameConv(nn.Module):
    """A dilated convolution that keeps the size, then ReLU (unless ``linear``)."""

    def __init__(
        self, inputs: int, outputs: int, side: int, dilation: int, linear: bool = False
    ) -> None:
        super().__init__()
        self.padding = same_padding(side, dilation)
        symmetric = self.padding[0] == self.padding[1]
        self.before = None if symmetric else self.padding
        self.conv = nn.Conv2d(
            inputs, outputs, side, dilation=dilation, padding=self.padding[0] if symmetric else 0
        )
        self.linear = linear
        start(self.conv, linear)

    def forward(self, x: Tensor) -> Tensor:
        """(n, inputs, h, w) to (n, outputs, h, w)."""
        if self.before is not None:
            x = functional.pad(x, self.before + self.before)
        x = self.conv(x)
        return x if self.linear else functional.relu(x)


class Dense(nn.Module):
    """A fully connected layer, then ReLU (unless ``linear``)."""

    def __init__(self, inputs: int, outputs: int, linear: bool = False) -> None:
        super().__init__()
        self.full = nn.Linear(inputs, outputs)
        self.linear = linear
        start(self.full, linear)

    def forward(self, x: Tensor) -> Tensor:
        """(n, inputs) to (n, outputs)."""
        x = self.full(x)
        return x if self.linear else functional.relu(x)


def start(layer: nn.Conv2d | nn.Linear, linear: bool) -> None:
    """He's start before a ReLU, Glorot's before a linear output; no bias.

    The papers do not say how their weights start; ReLU, too, is our reading.
    """
    if linear:
        nn.init.xavier_uniform_(layer.weight)
    else:
        nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
    nn.init.zeros_(layer.bias)


@dataclass
class Outputs:
    """What a network says of a batch of n images; None for what was not asked.

    Attributes:
        mask: (n, h, w) logits of robot against background.
        joints: (n, j, 3) joint origins in the camera's frame [m].
        base: (n, 3) origin of the robot's base in the camera's frame [m].
        type: (n, r) logits of the robot's type; None of a network that knows one robot only.
    """

    mask: Tensor | None
    joints: Tensor | None
    base: Tensor | None
    type: Tensor | None


def as_input(images: Tensor) -> Tensor:
    """(n, h, w, 3) uint8 RGB to (n, 3, h, w) in 0..1, as T4 to T7 scale it."""
    return images.permute(0, 3, 1, 2).to(torch.float32) / 255.0
