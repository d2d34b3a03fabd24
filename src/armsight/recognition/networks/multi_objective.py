"""T5: one network for mask, joints, base and type; T6 and T7 keep its structure.

T5's figure 3 has five convolutions of 32 filters (dilations 2, 5, 3, 5, 3 in the order of its
text), one of 64, one of 128, four poolings, two dense layers of 1024 that are summed, and three of
512. Its arrows are lost to us. How it is read here:

* The first convolution (32 filters, 3 x 3, dilation 2) is common: both networks of T4 begin so.
* The mask branch goes on with dilations 3, 5, 3, so that it has T4's four convolutions of 32, and
  ends in T4's one filter of 3 x 3. "The 4th convolutional layer towards the mask", where the side
  branch leaves, is then the last of 32 filters.
* The second branch: pool, 32 of dilation 5, pool, 64 of dilation 5, 128 of 2 x 2 and dilation 3,
  dense 1024. The side branch: the same poolings, dense 1024.
* Two poolings in each use up the figure's four, and need 560 million weights. ``pools = 3`` (one
  more before each dense layer: 138 million) is the other reading, which a GTX 1080 could train.
* ReLU behind each of the two dense layers before they are summed.
"""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional

from armsight.recognition.networks.architecture import Architecture
from armsight.recognition.networks.layers import Dense, Outputs, SameConv, as_input

MASK_DILATIONS = (3, 5, 3)
HEADS = ("joints", "base", "robot")


class MultiObjectiveNet(nn.Module):
    """The network of T5 (figure 3), T6 and T7.

    Attributes:
        architecture: what fixes its shapes.
    """

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.architecture = a = architecture
        f32, f64, f128 = (a.scaled_filters(n) for n in (32, 64, 128))
        self.common = SameConv(3, f32, 3, 2)
        self.mask = nn.ModuleList([SameConv(f32, f32, 3, d) for d in MASK_DILATIONS])
        self.mask_output = SameConv(f32, 1, 3, 1, linear=True)
        self.second = nn.ModuleList(
            [SameConv(f32, f32, 3, 5), SameConv(f32, f64, 3, 5), SameConv(f64, f128, 2, 3)]
        )
        height, width = a.pooled()
        units, head = a.scaled_dense(1024), a.scaled_dense(512)
        self.dense_second = Dense(f128 * height * width, units)
        self.dense_side = Dense(f32 * height * width, units)
        self.heads = nn.ModuleDict({k: Dense(units, head) for k in HEADS})
        self.outputs = nn.ModuleDict(
            {
                "joints": Dense(head, 3 * a.joints, linear=True),
                "base": Dense(head, 3, linear=True),
                "robot": Dense(head, len(a.robots), linear=True),
            }
        )

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
            true_mask: not used: this network masks nothing.
            want_mask: compute the mask.
            want_rest: compute joints, base and type.
        """
        common = self.common(as_input(images))
        side = common
        for convolution in self.mask:
            side = convolution(side)
        mask = self.mask_output(side)[:, 0] if want_mask else None
        if not want_rest:
            return Outputs(mask, None, None, None)
        features = self._features(common, side)
        joints, base, kind = (self.outputs[k](self.heads[k](features)) for k in HEADS)
        return Outputs(mask, joints.unflatten(1, (-1, 3)), base, kind)

    def _features(self, common: Tensor, side: Tensor) -> Tensor:
        """(n, 1024) sum of the second and the side branch."""
        pools = self.architecture.pools
        x = functional.max_pool2d(common, 2)
        for k, convolution in enumerate(self.second, 1):
            x = convolution(x)
            if k in (1, pools) and k != 2:
                x = functional.max_pool2d(x, 2)
        for _ in range(pools):
            side = functional.max_pool2d(side, 2)
        summed: Tensor = self.dense_second(x.flatten(1)) + self.dense_side(side.flatten(1))
        return summed

    def groups(self) -> dict[str, list[nn.Module]]:
        """Layers by the names that a training stage gives them, from the input to the outputs.

        ``mask-last`` are the mask branch's last two convolutions (T6), ``dense`` every fully
        connected layer.
        """
        return {
            "common": [self.common],
            "mask-early": [self.mask[0]],
            "mask-middle": [self.mask[1]],
            "second": [self.second],
            "mask-last": [self.mask[2], self.mask_output],
            "dense": [self.dense_second, self.dense_side, self.heads, self.outputs],
        }

    def mask_layer(self) -> nn.Conv2d:
        """The convolution whose answer is the mask's logit."""
        return self.mask_output.conv

    def regressions(self) -> list[tuple[nn.Linear, slice]]:
        """Final layers and their rows for base, then joints."""
        base, joints = self.outputs["base"].full, self.outputs["joints"].full
        return [(base, slice(0, 3)), (joints, slice(0, 3 * self.architecture.joints))]
