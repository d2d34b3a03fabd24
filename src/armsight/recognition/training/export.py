"""A trained network as ONNX, with proof that both give the same answers.

Input ``image``: (1, h, w, 3) uint8 RGB. Outputs: ``mask`` (1, h, w) probability of robot, ``base``
(1, 3) and ``joints`` (1, j, 3) in the camera's frame [m], and of a network that knows several
robots ``type`` (1, r) probabilities. Opset 17, every shape and every padding written out. The card
travels inside, under the names that :mod:`armsight.recognition.inference.model` reads.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from armsight.errors import RecognitionError
from armsight.recognition.networks.build import Network
from armsight.recognition.networks.cascaded import CascadedNet
from armsight.recognition.networks.layers import Dense, SameConv
from armsight.recognition.networks.multi_objective import HEADS, MultiObjectiveNet
from armsight.recognition.training.onnx_file import FLOAT, OnnxGraph
from armsight.recognition.training.tensors_file import Array
from armsight.recognition.training.weights import Card

PARITY = 1e-4
"""[m] and probability; the most by which an output may differ."""
FORMAT = "armsight-network-1"


def to_onnx(network: Network, card: Card, half: bool = False) -> bytes:
    """The network as an ONNX file.

    Args:
        network: trained.
        card: put beside the graph.
        half: keep the dense layers' weights in half precision, which halves the file; the
            computing stays in single precision.

    Raises:
        RecognitionError: it does not fit into such a file.
    """
    a = network.architecture
    graph = OnnxGraph(f"armsight {a.kind}")
    build = _Builder(graph, half)
    image = graph.input("image", np.uint8, (1, a.height, a.width, 3))
    x = graph.node("Cast", image, to=FLOAT)
    x = graph.node("Transpose", x, perm=(0, 3, 1, 2))
    x = graph.node("Div", x, graph.constant(np.array(255.0, np.float32)))
    if isinstance(network, CascadedNet):
        build.cascaded(network, x)
    else:
        build.multi_objective(network, x)
    words = {
        "format": FORMAT,
        "architecture": json.dumps(a.to_json()),
        "card": json.dumps(card, allow_nan=False),
    }
    return graph.encode(words)


class _Builder:
    """Writes layers into a graph."""

    def __init__(self, graph: OnnxGraph, half: bool) -> None:
        self._graph = graph
        self._half = half

    def cascaded(self, network: CascadedNet, x: str) -> None:
        a, graph = network.architecture, self._graph
        mask = x
        for layer in network.mask:
            mask = self._conv(layer, mask)
        mask = graph.node("Sigmoid", mask)
        # Half a probability is robot, as a logit of 0 is in torch.
        above = graph.node("GreaterOrEqual", mask, graph.constant(np.array(0.5, np.float32)))
        masked = graph.node("Mul", x, graph.node("Cast", above, to=FLOAT))
        for k, layer in enumerate(network.convolutions):
            masked = self._conv(layer, masked)
            if k < a.pools:
                masked = self._pool(masked)
        points = self._dense(network.dense, graph.node("Flatten", masked, axis=1))
        points = self._reshape(self._dense(network.output, points), (1, 1 + a.joints, 3))
        self._mask_output(mask, a.height, a.width)
        graph.output(self._rows(points, 0, 1, (1, 3)), "base", (1, 3))
        joints = self._rows(points, 1, 1 + a.joints, (1, a.joints, 3))
        graph.output(joints, "joints", (1, a.joints, 3))

    def multi_objective(self, network: MultiObjectiveNet, x: str) -> None:
        a, graph = network.architecture, self._graph
        common = self._conv(network.common, x)
        side = common
        for layer in network.mask:
            side = self._conv(layer, side)
        mask = graph.node("Sigmoid", self._conv(network.mask_output, side))
        second = self._pool(common)
        for k, layer in enumerate(network.second, 1):
            second = self._conv(layer, second)
            if k in (1, a.pools) and k != 2:
                second = self._pool(second)
        for _ in range(a.pools):
            side = self._pool(side)
        summed = graph.node(
            "Add",
            self._dense(network.dense_second, graph.node("Flatten", second, axis=1)),
            self._dense(network.dense_side, graph.node("Flatten", side, axis=1)),
        )
        joints, base, robot = (
            self._dense(network.outputs[k], self._dense(network.heads[k], summed)) for k in HEADS
        )
        self._mask_output(mask, a.height, a.width)
        graph.output(self._reshape(joints, (1, a.joints, 3)), "joints", (1, a.joints, 3))
        graph.output(base, "base", (1, 3))
        graph.output(graph.node("Softmax", robot, axis=1), "type", (1, len(a.robots)))

    def _conv(self, layer: nn.Module, x: str) -> str:
        assert isinstance(layer, SameConv)
        conv = layer.conv
        before, after = layer.padding
        y = self._graph.node(
            "Conv",
            x,
            self._graph.constant(_array(conv.weight)),
            self._graph.constant(_array(conv.bias)),
            kernel_shape=tuple(conv.kernel_size),
            dilations=tuple(conv.dilation),
            pads=(before, before, after, after),
            strides=(1, 1),
        )
        return y if layer.linear else self._graph.node("Relu", y)

    def _dense(self, layer: nn.Module, x: str) -> str:
        assert isinstance(layer, Dense)
        weight = _array(layer.full.weight)
        if self._half:
            stored = self._graph.constant(weight.astype(np.float16))
            constant = self._graph.node("Cast", stored, to=FLOAT)
        else:
            constant = self._graph.constant(weight)
        bias = self._graph.constant(_array(layer.full.bias))
        y = self._graph.node("Gemm", x, constant, bias, transB=1)
        return y if layer.linear else self._graph.node("Relu", y)

    def _pool(self, x: str) -> str:
        return self._graph.node("MaxPool", x, kernel_shape=(2, 2), strides=(2, 2))

    def _reshape(self, x: str, shape: tuple[int, ...]) -> str:
        return self._graph.node("Reshape", x, self._graph.constant(np.array(shape, np.int64)))

    def _rows(self, x: str, first: int, last: int, shape: tuple[int, ...]) -> str:
        ends = [self._graph.constant(np.array([n], np.int64)) for n in (first, last, 1)]
        return self._reshape(self._graph.node("Slice", x, *ends), shape)

    def _mask_output(self, mask: str, height: int, width: int) -> None:
        self._graph.output(self._reshape(mask, (1, height, width)), "mask", (1, height, width))


def _array(parameter: torch.Tensor) -> Array:
    return np.asarray(parameter.detach().cpu().numpy(), np.float32)


@dataclass(frozen=True)
class Parity:
    """Largest difference between torch and ONNX Runtime, over some images.

    Attributes:
        images: how many.
        metres: of base and joints [m].
        probability: of mask and type.
    """

    images: int
    metres: float
    probability: float


def check_parity(network: Network, file: Path, images: Array, half: bool = False) -> Parity:
    """Compare a network with its ONNX file on (n, h, w, 3) images.

    Raises:
        RecognitionError: they differ by more than 1e-4, or onnxruntime cannot read the file.
    """
    import onnxruntime

    reference = rounded(network) if half else network
    session = onnxruntime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
    names = [o.name for o in session.get_outputs()]
    metres = probability = 0.0
    for image in images:
        found = dict(zip(names, session.run(None, {"image": image[None]}), strict=True))
        # A pixel on the very edge of 0.5 may be masked by one and not by the other: the coordinate
        # network is compared on the same mask.
        seen = found["mask"] >= 0.5
        for name, value in answers(reference, image[None], seen).items():
            difference = float(np.abs(found[name] - value).max())
            if name in ("base", "joints"):
                metres = max(metres, difference)
            else:
                probability = max(probability, difference)
    if not max(metres, probability) <= PARITY:
        raise RecognitionError(
            f"{file}: differs from the trained network by {1e3 * metres:.3f} mm and "
            f"{probability:.2e} of probability, expected at most {PARITY}; it must not be used"
        )
    return Parity(len(images), metres, probability)


def rounded(network: Network) -> Network:
    """A copy whose dense layers' weights are rounded to half precision."""
    from copy import deepcopy

    copy = deepcopy(network)
    with torch.no_grad():
        for module in copy.modules():
            if isinstance(module, Dense):
                module.full.weight.copy_(module.full.weight.half().float())
    return copy


def answers(network: Network, images: Array, mask: Array | None = None) -> dict[str, Array]:
    """What a network says of (n, h, w, 3) images, by the names of the ONNX outputs.

    Args:
        network: to be asked.
        images: uint8 RGB.
        mask: (n, h, w) bool for a cascaded network's coordinates, None for its own mask.
    """
    network.eval()
    device = next(network.parameters()).device
    with torch.no_grad():
        given = None if mask is None else torch.from_numpy(mask).to(device)
        out = network(torch.from_numpy(np.ascontiguousarray(images)).to(device), given)
    assert out.mask is not None
    assert out.base is not None
    assert out.joints is not None
    found = {"mask": torch.sigmoid(out.mask.float()), "base": out.base, "joints": out.joints}
    if out.type is not None:
        found["type"] = torch.softmax(out.type.float(), dim=1)
    return {k: v.float().cpu().numpy() for k, v in found.items()}
