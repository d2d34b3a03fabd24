"""T4: a mask network, then a coordinate network on the masked image; one pair a robot.

What the paper leaves open, and how it is read here:

* The dilations of the mask network are in a figure that the text lost: 2, 3, 5, 3 (those that T5's
  figure begins with) and 1 for the last one of a single filter, which is 3 x 3 as the others.
* Every convolution keeps the size, as a mask of the input's size needs it.
* "Output 21": base and six joints, in this order, in metres in the camera's frame. A network for a
  7-joint robot has 24.
* The masked image is the image where the mask says robot (probability 0.5 or more), black
  elsewhere. The coordinate network is trained on true masks (T4 trains each by itself).
"""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional

from armsight.recognition.networks.architecture import Architecture
from armsight.recognition.networks.layers import Dense, Outputs, SameConv, as_input

MASK_DILATIONS = (2, 3, 5, 3)


class CascadedNet(nn.Module):
    """The mask network and the coordinate network of one robot (T4, figure 4).

    Attributes:
        architecture: what fixes its shapes.
    """

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.architecture = a = architecture
        f32, f64, f128 = (a.scaled_filters(n) for n in (32, 64, 128))
        filters = (3, f32, f32, f32)
        self.mask = nn.Sequential(
            *(SameConv(n, f32, 3, d) for n, d in zip(filters, MASK_DILATIONS, strict=True)),
            SameConv(f32, 1, 3, 1, linear=True),
        )
        self.convolutions = nn.ModuleList(
            [SameConv(3, f32, 3, 2), SameConv(f32, f64, 3, 5), SameConv(f64, f128, 2, 3)]
        )
        height, width = a.pooled()
        self.dense = Dense(f128 * height * width, a.scaled_dense(500))
        self.output = Dense(a.scaled_dense(500), 3 * (1 + a.joints), linear=True)

    def forward(
        self,
        images: Tensor,
        true_mask: Tensor | None = None,
        want_mask: bool = True,
        want_rest: bool = True,
    ) -> Outputs:
        """Answer for (n, h, w, 3) uint8 images.

        Args:
            images: RGB.
            true_mask: (n, h, w) bool, used to mask the image instead of the network's own.
            want_mask: compute the mask.
            want_rest: compute base and joints.
        """
        x = as_input(images)
        mask = self.mask(x)[:, 0] if want_mask or (want_rest and true_mask is None) else None
        if not want_rest:
            return Outputs(mask, None, None, None)
        if true_mask is None:
            assert mask is not None
            true_mask = mask >= 0.0
        x = x * true_mask[:, None].to(x.dtype)
        for k, convolution in enumerate(self.convolutions):
            x = convolution(x)
            if k < self.architecture.pools:
                x = functional.max_pool2d(x, 2)
        points = self.output(self.dense(x.flatten(1))).unflatten(1, (-1, 3))
        return Outputs(mask if want_mask else None, points[:, 1:], points[:, 0], None)

    def groups(self) -> dict[str, list[nn.Module]]:
        """Layers by the names that a training stage gives them."""
        return {
            "mask": [self.mask],
            "coordinates": [self.convolutions, self.dense, self.output],
        }

    def mask_layer(self) -> nn.Conv2d:
        """The convolution whose answer is the mask's logit."""
        last = self.mask[-1]
        assert isinstance(last, SameConv)
        return last.conv

    def regressions(self) -> list[tuple[nn.Linear, slice]]:
        """Final layers and their rows for base, then joints."""
        return [
            (self.output.full, slice(0, 3)),
            (self.output.full, slice(3, 3 + 3 * self.architecture.joints)),
        ]
