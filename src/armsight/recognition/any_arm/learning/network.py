"""The network that looks at a crop: which arm, which link where, which point of it, key points.

A pretrained trunk, a pyramid fused at a stride of 8 pixels, and heads of one 1 x 1 convolution
whose pixels are shuffled to a stride of 4. A few channels go on to a stride of 4 themselves, where
the trunk still sees edges, and what they say is added to the heads; the type is read off the arm,
the whole, and what is seen of each link. These two additions begin at nothing, so that weights from
before them go on. Fully convolutional, so that the same weights look at a whole frame.
What belongs to one robot is a block of rows of its own in the last layers: another robot adds rows
and changes none.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from armsight.recognition.any_arm.landmarks import SLOTS
from armsight.recognition.any_arm.learning.trunk import TAPS, Trunk, normalised

LINKS = 9
"""Links that are told apart: the base and eight more."""
OTHERS = ("none", "unknown")
"""Types besides the known robots, in this order behind them."""
STRIDE = 4
"""Pixels of the crop a cell of the outputs."""
_WIDTH = 128
_HIDDEN = 128
_FINE = 48
"""Channels at a stride of 4."""


@dataclass(frozen=True)
class Shape:
    """What a network is built for.

    Attributes:
        robots: names, in the order of its outputs.
        points: slots for landmarks of each robot.
    """

    robots: tuple[str, ...]
    points: int = SLOTS

    @property
    def types(self) -> tuple[str, ...]:
        """The robots, then :data:`OTHERS`."""
        return (*self.robots, *OTHERS)


@dataclass(frozen=True)
class Seen:
    """Outputs for n crops of h x w cells, r robots, p points.

    Attributes:
        links: (n, 1 + LINKS, h, w) logits: background, then the links from the base.
        coordinates: (n, 3, h, w) the surface point in its link's box, -1..1.
        spread: (n, h, w) log of the Laplace scale of these.
        heat: (n, r, p, h, w) logits of where each landmark is; r is 1 where one robot was asked
            for.
        outside: (n, r, p) logit of its not being in the crop.
        type: (n, r + 2) logits.
    """

    links: Tensor
    coordinates: Tensor
    spread: Tensor
    heat: Tensor
    outside: Tensor
    type: Tensor


class _Refine(nn.Module):
    """Each channel filtered by 5 x 5, then mixed; added to what came in."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.filter = nn.Conv2d(width, width, 5, padding=2, groups=width)
        self.mix = nn.Conv2d(width, width, 1)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.mix(functional.relu(self.filter(x)))


class _Sharpen(nn.Module):
    """3 x 3, added to what came in."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.filter = nn.Conv2d(width, width, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        return x + functional.relu(self.filter(x))


class CropNet(nn.Module):
    """See the module.

    Args:
        shape: robots and points.
        frozen: see :class:`Trunk`.
    """

    def __init__(self, shape: Shape, frozen: int = 3) -> None:
        super().__init__()
        self.shape = shape
        self.trunk = Trunk(frozen)
        fourth, eighth, sixteenth, last = TAPS.values()
        self.from8 = nn.Conv2d(eighth, _WIDTH, 1)
        self.from16 = nn.Conv2d(sixteenth, _WIDTH, 1)
        self.from32 = nn.Conv2d(last, _WIDTH, 1)
        self.refine = nn.ModuleList(_Refine(_WIDTH) for _ in range(3))
        self.surface = nn.Conv2d(_WIDTH, 4 * (1 + LINKS + 4), 1)
        # What slots have in common on all arms, and what is one robot's own.
        self.common_heat = nn.Conv2d(_WIDTH, 4 * shape.points, 1)
        self.heat = nn.ModuleDict(
            {name: nn.Conv2d(_WIDTH, 4 * shape.points, 1) for name in shape.robots}
        )
        self.hidden = nn.Linear(_WIDTH + 2 * last, _HIDDEN)
        self.of_links = nn.Linear(LINKS * _WIDTH, _HIDDEN, bias=False)
        self.common_outside = nn.Linear(_HIDDEN, shape.points)
        self.outside = nn.ModuleDict(
            {name: nn.Linear(_HIDDEN, shape.points) for name in shape.robots}
        )
        self.names = nn.ModuleDict({name: nn.Linear(_HIDDEN, 1) for name in shape.types})
        self.from4 = nn.Conv2d(fourth, _FINE, 1)
        self.narrow = nn.Conv2d(_WIDTH, _FINE, 1)
        self.sharpen = nn.ModuleList(_Sharpen(_FINE) for _ in range(2))
        self.fine_surface = nn.Conv2d(_FINE, 1 + LINKS + 4, 1)
        self.fine_common_heat = nn.Conv2d(_FINE, shape.points, 1)
        self.fine_heat = nn.ModuleDict(
            {name: nn.Conv2d(_FINE, shape.points, 1) for name in shape.robots}
        )
        _start(self)

    def forward(self, images: Tensor, robot: Tensor | None = None) -> Seen:
        """Of (n, 4 h, 4 w, 3) uint8 RGB; sides are multiples of 32.

        Args:
            images: pictures.
            robot: (n,) whose landmarks are wanted of each; None for those of all.
        """
        c4, c8, c16, c32 = self.trunk(normalised(images))
        x = self.from16(c16) + _grown(self.from32(c32), 2)
        x = functional.relu(self.from8(c8) + _grown(x, 2))
        for refine in self.refine:
            x = refine(x)
        x = functional.relu(x)
        fine = functional.relu(self.from4(c4) + _grown(self.narrow(x), 2))
        for sharpen in self.sharpen:
            fine = sharpen(fine)
        surface = functional.pixel_shuffle(self.surface(x), 2) + self.fine_surface(fine)
        links = surface[:, : 1 + LINKS]
        coarse = _of_robots(self.common_heat, self.heat, x, robot)
        heat = functional.pixel_shuffle(coarse, 2) + _of_robots(
            self.fine_common_heat, self.fine_heat, fine, robot
        )
        # The type is read off where the arm is, and off the whole; it shall not shape the mask.
        seen = torch.softmax(links.detach(), 1)
        arm = 1.0 - seen[:, :1]
        hidden = torch.cat([_weighted(x, arm), _weighted(c32, arm), c32.mean((2, 3))], 1)
        each = _of_each(x, seen[:, 1:])
        hidden = functional.relu(self.hidden(hidden) + self.of_links(each.flatten(1)))
        common = self.common_outside(hidden)
        outside = torch.stack([common + self.outside[n](hidden) for n in self.shape.robots], 1)
        if robot is not None:
            outside = outside[torch.arange(len(outside), device=robot.device), robot][:, None]
        types = torch.cat([self.names[name](hidden) for name in self.shape.types], 1)
        return Seen(
            links,
            surface[:, 1 + LINKS : 4 + LINKS],
            surface[:, 4 + LINKS],
            heat,
            outside,
            types,
        )


def _of_robots(common: nn.Conv2d, own: nn.ModuleDict, x: Tensor, robot: Tensor | None) -> Tensor:
    """(n, r, k, h, w) what all robots share and what is each one's own; r is 1 for a ``robot``."""
    shared = common(x)[:, None]
    if robot is None:
        return shared + torch.stack([layer(x) for layer in own.values()], 1)
    weight = torch.stack([layer.weight.flatten(1) for layer in own.values()])[robot]
    bias = torch.stack([layer.bias for layer in own.values()])[robot]
    mine = torch.baddbmm(bias[:, :, None], weight, x.flatten(2)).unflatten(2, x.shape[2:])
    return shared + mine[:, None]


def _grown(x: Tensor, times: int) -> Tensor:
    return functional.interpolate(x, scale_factor=times, mode="nearest")


def _weighted(x: Tensor, arm: Tensor) -> Tensor:
    """(n, c) mean of (n, c, h, w) features over the arm, whose (n, 1, H, W) is finer."""
    weight = functional.avg_pool2d(arm, arm.shape[-1] // x.shape[-1])
    return (x * weight).sum((2, 3)) / (weight.sum((2, 3)) + 0.5)


def _of_each(x: Tensor, links: Tensor) -> Tensor:
    """(n, k, c) mean of (n, c, h, w) features over each of k links of (n, k, 2 h, 2 w) shares."""
    weight = functional.avg_pool2d(links, 2).flatten(2)
    return (weight @ x.flatten(2).transpose(1, 2)) / (weight.sum(2, keepdim=True) + 0.5)


def _start(network: CropNet) -> None:
    """He's start of what is not pretrained; last layers small, the refinement close to nothing."""
    parts = (network.from8, network.from16, network.from32, network.hidden)
    for part in (*parts, network.from4, network.narrow):
        nn.init.kaiming_normal_(part.weight, nonlinearity="relu", mode="fan_in")
        nn.init.zeros_(part.bias)
    with torch.no_grad():
        for part in (network.from8, network.from16, network.from32):
            part.weight.mul_(0.5)
    for sharpen in network.sharpen:
        assert isinstance(sharpen, _Sharpen)
        nn.init.zeros_(sharpen.filter.bias)
        sharpen.filter.weight.data.mul_(0.5)
    for part in (network.fine_surface, network.fine_common_heat, *network.fine_heat.values()):
        assert isinstance(part, nn.Conv2d)
        nn.init.zeros_(part.weight)
        nn.init.zeros_(part.bias)
    nn.init.zeros_(network.of_links.weight)
    for refine in network.refine:
        assert isinstance(refine, _Refine)
        nn.init.zeros_(refine.mix.bias)
        refine.mix.weight.data.mul_(0.5)
    shared = (network.surface, network.common_heat, network.common_outside)
    own = (*network.heat.values(), *network.outside.values(), *network.names.values())
    for part in (*shared, *own):
        assert isinstance(part, nn.Conv2d | nn.Linear)
        nn.init.normal_(part.weight, std=0.02 if part in shared else 0.004)
        nn.init.zeros_(part.bias)


def build(shape: Shape, seed: int, frozen: int = 3) -> CropNet:
    """A network whose new layers start from a seed; the trunk's weights are still to be loaded."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return CropNet(shape, frozen)
