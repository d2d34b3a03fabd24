"""A network file made without torch: its mask is where the image is bright."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armsight.recognition.networks.architecture import Architecture
from armsight.recognition.training.onnx_file import FLOAT, OnnxGraph

ARCHITECTURE = Architecture("multi-objective", ("ur5", "iiwa"), 64, 53)
K = [[48.0, 0.0, 31.5], [0.0, 48.0, 26.0], [0.0, 0.0, 1.0]]
BASE = [0.1, 0.2, 1.5]
JOINTS = [[0.1 + 0.02 * k, 0.2 - 0.08 * k, 1.5] for k in range(7)]


def card(joint_mean_mm: float = 25.0) -> dict[str, Any]:
    figures = {"joint_mean_mm": joint_mean_mm}
    return {
        "camera": {"K": K}, "paper": "T5", "finished": True,
        "validation": {"ur5": figures, "iiwa": figures},
    }  # fmt: skip


def network(
    words: dict[str, Any] | None = None,
    about: dict[str, Any] | None = None,
    base: list[float] = BASE,
    size: tuple[int, int] = (64, 53),
) -> bytes:
    """A graph of the shapes that an exported network has; answers what is written above."""
    graph = OnnxGraph("bright")
    width, height = size
    x = graph.node("Cast", graph.input("image", np.uint8, (1, height, width, 3)), to=FLOAT)
    mean = graph.node("ReduceMean", x, axes=(3,), keepdims=0)
    shifted = graph.node("Sub", mean, graph.constant(np.array(128.0, np.float32)))
    graph.output(graph.node("Sigmoid", shifted), "mask", (1, height, width))
    graph.output(graph.constant(np.array([JOINTS], np.float32)), "joints", (1, 7, 3))
    graph.output(graph.constant(np.array([base], np.float32)), "base", (1, 3))
    graph.output(graph.constant(np.array([[0.9, 0.1]], np.float32)), "type", (1, 2))
    described = {
        "format": "armsight-network-1",
        "architecture": json.dumps(ARCHITECTURE.to_json()),
        "card": json.dumps(about or card()),
    }
    return graph.encode(described if words is None else words)


@pytest.fixture
def network_file(tmp_path: Path) -> Path:
    file = tmp_path / "network.onnx"
    file.write_bytes(network())
    return file
