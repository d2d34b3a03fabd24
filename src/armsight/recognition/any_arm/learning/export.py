"""The crop network as ONNX, with proof that both give the same answers.

Input ``image``: (1, h, w, 3) uint8 RGB, sides multiples of 32. Outputs, logits unless told
otherwise, at a quarter of the side: ``links`` (1, 10, h / 4, w / 4), ``coordinates`` (1, 3, ...)
and ``spread`` (1, 1, ...), see :class:`Seen`; ``heat_ROBOT`` (1, p, ...) and ``outside_ROBOT``
(1, p) of each robot; ``type`` (1, r + 2); and what all of these are read off, ``features``
(1, c, h / 8, w / 8) and ``hidden`` (1, d), for extensions. The card travels inside; weights have
the names that they have in :class:`CropNet`, so that ``adopting.py`` finds them again.
"""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import torch
from torch import nn

from armsight.errors import RecognitionError
from armsight.recognition.any_arm.learning.network import LINKS, CropNet
from armsight.recognition.any_arm.learning.trunk import TAPS, Block
from armsight.recognition.any_arm.model import FORMAT
from armsight.recognition.training.onnx_file import FLOAT, OnnxGraph
from armsight.recognition.training.tensors_file import Array
from armsight.recognition.training.weights import Card

PARITY = 1e-3
"""Largest difference of a logit, of some tens."""


def to_onnx(network: CropNet, card: Card) -> bytes:
    """The network as an ONNX file of open height and width."""
    graph = OnnxGraph("armsight crop")
    build = _Builder(graph, network)
    image = graph.input("image", np.uint8, (1, "height", "width", 3))
    x = graph.node("Cast", image, to=FLOAT)
    x = graph.node("Transpose", x, perm=(0, 3, 1, 2))
    x = graph.node("Sub", x, build.number(127.0))
    x = graph.node("Div", x, build.number(128.0))
    build.network(network, x)
    return graph.encode({"format": FORMAT, "card": json.dumps(card, allow_nan=False)})


class _Builder:
    """Writes layers into a graph."""

    def __init__(self, graph: OnnxGraph, network: CropNet) -> None:
        self._graph = graph
        self._names = {layer: name for name, layer in network.named_modules()}

    def number(self, value: float) -> str:
        return self._graph.constant(np.array(value, np.float32))

    def network(self, net: CropNet, x: str) -> None:
        graph = self._graph
        c4, c8, c16, c32 = self._trunk(net, x)
        x = graph.node(
            "Add", self._plain(net.from16, c16), self._grown(self._plain(net.from32, c32))
        )
        x = graph.node("Add", self._plain(net.from8, c8), self._grown(x))
        x = graph.node("Relu", x)
        for refine in net.refine:
            y = self._plain(refine.filter, x)
            x = graph.node("Add", x, self._plain(refine.mix, graph.node("Relu", y)))
        x = graph.node("Relu", x)
        graph.output(x, "features", (1, net.surface.in_channels, "eighths", "of_columns"))
        fine = self._fine(net, c4, x)
        surface = graph.node(
            "Add", self._shuffled(self._plain(net.surface, x)), self._plain(net.fine_surface, fine)
        )
        links = self._channels(surface, 0, 1 + LINKS)
        cells = ("rows", "columns")
        graph.output(links, "links", (1, 1 + LINKS, *cells))
        graph.output(self._channels(surface, 1 + LINKS, 4 + LINKS), "coordinates", (1, 3, *cells))
        graph.output(self._channels(surface, 4 + LINKS, 5 + LINKS), "spread", (1, 1, *cells))
        seen = graph.node("Softmax", links, axis=1)
        arm = graph.node("Sub", self.number(1.0), self._channels(seen, 0, 1))
        parts = [self._weighted(x, arm, 2), self._weighted(c32, arm, 8), self._mean(c32)]
        hidden = self._dense(net.hidden, graph.node("Concat", *parts, axis=1))
        each = self._of_each(x, self._channels(seen, 1, 1 + LINKS), net.surface.in_channels)
        hidden = graph.node("Relu", graph.node("Add", hidden, self._dense(net.of_links, each)))
        graph.output(hidden, "hidden", (1, net.hidden.out_features))
        p = net.shape.points
        for name in net.shape.robots:
            heat = self._shuffled(self._both(net.common_heat, net.heat[name], x))
            more = self._both(net.fine_common_heat, net.fine_heat[name], fine)
            graph.output(graph.node("Add", heat, more), f"heat_{name}", (1, p, *cells))
            outside = self._both(net.common_outside, net.outside[name], hidden)
            graph.output(outside, f"outside_{name}", (1, p))
        types = [self._dense(net.names[name], hidden) for name in net.shape.types]
        graph.output(graph.node("Concat", *types, axis=1), "type", (1, len(types)))

    def _fine(self, net: CropNet, c4: str, x: str) -> str:
        graph = self._graph
        narrow = self._grown(self._plain(net.narrow, x))
        fine = graph.node("Relu", graph.node("Add", self._plain(net.from4, c4), narrow))
        for sharpen in net.sharpen:
            y = graph.node("Relu", self._plain(sharpen.filter, fine))
            fine = graph.node("Add", fine, y)
        return fine

    def _trunk(self, net: CropNet, x: str) -> list[str]:
        x = self._clipped(self._conv(net.trunk.stem, x))
        taps = []
        for k, block in enumerate(net.trunk.blocks):
            assert isinstance(block, Block)
            y = x if block.expand is None else self._clipped(self._conv(block.expand, x))
            y = self._conv(block.project, self._clipped(self._conv(block.depthwise, y)))
            x = self._graph.node("Add", x, y) if block.adds else y
            if k in TAPS:
                taps.append(x)
        return taps

    def _conv(self, layer: nn.Module, x: str) -> str:
        before, after = layer.before, layer.after
        return self._written(layer.conv, x, (before, before, after, after))

    def _plain(self, layer: nn.Module, x: str) -> str:
        pad = layer.kernel_size[0] // 2
        return self._written(layer, x, (pad, pad, pad, pad))

    def _written(self, conv: nn.Module, x: str, pads: tuple[int, ...]) -> str:
        assert isinstance(conv, nn.Conv2d)
        return self._graph.node(
            "Conv",
            x,
            *self._weights(conv),
            kernel_shape=tuple(conv.kernel_size),
            group=conv.groups,
            pads=pads,
            strides=tuple(conv.stride),
        )

    def _dense(self, layer: nn.Module, x: str) -> str:
        assert isinstance(layer, nn.Linear)
        return self._graph.node("Gemm", x, *self._weights(layer), transB=1)

    def _weights(self, layer: nn.Conv2d | nn.Linear) -> list[str]:
        name = self._names[layer]
        return [
            self._graph.constant(_array(value), f"{name}.{part}")
            for part, value in layer.named_parameters(recurse=False)
        ]

    def _both(self, common: nn.Module, own: nn.Module, x: str) -> str:
        """What all robots share and what is one's own, as one layer: their sum, by its own name."""
        assert isinstance(common, nn.Conv2d | nn.Linear)
        assert isinstance(own, nn.Conv2d | nn.Linear)
        summed = copy.deepcopy(own)
        self._names[summed] = self._names[own]
        assert summed.bias is not None
        assert common.bias is not None
        with torch.no_grad():
            summed.weight.add_(common.weight)
            summed.bias.add_(common.bias)
        return self._plain(summed, x) if isinstance(own, nn.Conv2d) else self._dense(summed, x)

    def _clipped(self, x: str) -> str:
        return self._graph.node("Clip", x, self.number(0.0), self.number(6.0))

    def _grown(self, x: str) -> str:
        scales = self._graph.constant(np.array([1, 1, 2, 2], np.float32))
        return self._graph.node(
            "Resize", x, "", scales, mode="nearest",
            coordinate_transformation_mode="asymmetric", nearest_mode="floor",
        )  # fmt: skip

    def _shuffled(self, x: str) -> str:
        return self._graph.node("DepthToSpace", x, blocksize=2, mode="CRD")

    def _channels(self, x: str, first: int, last: int) -> str:
        ends = [self._graph.constant(np.array([n], np.int64)) for n in (first, last, 1)]
        return self._graph.node("Slice", x, *ends)

    def _weighted(self, x: str, arm: str, times: int) -> str:
        graph = self._graph
        size = (times, times)
        weight = graph.node("AveragePool", arm, kernel_shape=size, strides=size)
        over = graph.node("Add", self._sum(weight), self.number(0.5))
        return graph.node("Div", self._sum(graph.node("Mul", x, weight)), over)

    def _of_each(self, x: str, links: str, width: int) -> str:
        """(1, LINKS * width) features averaged over each link."""
        graph = self._graph
        weight = graph.node("AveragePool", links, kernel_shape=(2, 2), strides=(2, 2))
        weight = self._shaped(weight, 1, LINKS, -1)
        flat = graph.node("Transpose", self._shaped(x, 1, width, -1), perm=(0, 2, 1))
        axes = graph.constant(np.array([2], np.int64))
        over = graph.node("ReduceSum", weight, axes, keepdims=1)
        over = graph.node("Add", over, self.number(0.5))
        each = graph.node("Div", graph.node("MatMul", weight, flat), over)
        return self._shaped(each, 1, LINKS * width)

    def _shaped(self, x: str, *shape: int) -> str:
        return self._graph.node("Reshape", x, self._graph.constant(np.array(shape, np.int64)))

    def _sum(self, x: str) -> str:
        axes = self._graph.constant(np.array([2, 3], np.int64))
        return self._graph.node("ReduceSum", x, axes, keepdims=0)

    def _mean(self, x: str) -> str:
        return self._graph.node("ReduceMean", x, axes=(2, 3), keepdims=0)


def _array(parameter: torch.Tensor | None) -> Array:
    assert parameter is not None
    return np.asarray(parameter.detach().cpu().numpy(), np.float32)


def answers(network: CropNet, image: Array) -> dict[str, Array]:
    """What a network says of an (h, w, 3) image, by the names of the ONNX outputs."""
    network.eval()
    with torch.no_grad():
        seen = network(torch.from_numpy(np.ascontiguousarray(image[None])))
    found = {
        "links": seen.links,
        "coordinates": seen.coordinates,
        "spread": seen.spread[:, None],
        "type": seen.type,
    }
    for k, name in enumerate(network.shape.robots):
        found |= {f"heat_{name}": seen.heat[:, k], f"outside_{name}": seen.outside[:, k]}
    return {k: v.numpy() for k, v in found.items()}


def check_parity(network: CropNet, file: Path, images: Array) -> float:
    """Largest difference between torch and ONNX Runtime over (n, h, w, 3) images.

    Raises:
        RecognitionError: it is larger than :data:`PARITY`, or the file cannot be read.
    """
    import onnxruntime

    session = onnxruntime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
    names = [o.name for o in session.get_outputs()]
    worst = 0.0
    for image in images:
        found = dict(zip(names, session.run(None, {"image": image[None]}), strict=True))
        for name, value in answers(network, image).items():
            worst = max(worst, float(np.abs(found[name] - value).max()))
    if not worst <= PARITY:
        raise RecognitionError(
            f"{file}: differs from the trained network by {worst:.2e}, expected at most {PARITY}; "
            "it must not be used"
        )
    return worst
