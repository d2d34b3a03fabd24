"""Chooses below which share of a picture a network says "no robot", and writes it into its card.

    python scripts/choose_no_robot.py RUN VALIDATION [HELD_OUT ...]

RUN is the folder of a training (``weights.safetensors``, ``network.onnx``); the sets are labelled
and have pictures without a robot (``armsight dataset generate --set wild``). The share is chosen
on VALIDATION alone; how it does there and on the other sets is printed. Needs torch.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from armsight.arrays import Floats
from armsight.experiments.recognition_scores import mask_shares
from armsight.recognition.data import LabelledSet
from armsight.recognition.data.sample import NO_ROBOT
from armsight.recognition.inference.model import Model
from armsight.recognition.inference.no_robot import choose_share
from armsight.recognition.training.card import card_text
from armsight.recognition.training.export import to_onnx
from armsight.recognition.training.tensors_file import write_whole
from armsight.recognition.training.weights import load_weights, save_weights


def main() -> None:
    """Choose, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("validation", type=Path)
    parser.add_argument("held_out", type=Path, nargs="*")
    parser.add_argument("--half", action="store_true", help="as it was trained with")
    options = parser.parse_args()
    model = Model(options.run / "network.onnx", threads=1)
    without, shown = shares(model, LabelledSet.open(options.validation))
    cut = choose_share(without, shown)
    told(options.validation, cut, without, shown)
    for folder in options.held_out:
        told(folder, cut, *shares(model, LabelledSet.open(folder, partial=True)))
    network, card = load_weights(options.run / "weights.safetensors")
    about = LabelledSet.open(options.validation).manifest
    card["no_robot"] = {
        "share": round(cut, 6),
        "without": len(without),
        "shown": len(shown),
        "said_without": round(float((without < cut).mean()), 4),
        "said_shown": round(float((shown < cut).mean()), 4),
        "set": f"{about.kind}, seed {about.seed}, {about.renderer}",
    }
    save_weights(options.run / "weights.safetensors", network, card)
    write_whole(options.run / "network.onnx", to_onnx(network, card, options.half))
    text = card_text(options.run.name, card, network.architecture)
    write_whole(options.run / "CARD.md", text.encode())


def shares(model: Model, labelled: LabelledSet) -> tuple[Floats, Floats]:
    """Of the pictures without a robot, and of those with one of the catalogue's that it knows."""
    robots = np.array([row.robot for row in labelled.rows])
    without = np.flatnonzero(robots == NO_ROBOT)
    shown = np.flatnonzero(np.isin(robots, model.architecture.robots))
    return mask_shares(model, labelled, without), mask_shares(model, labelled, shown)


def told(folder: Path, cut: float, without: Floats, shown: Floats) -> None:
    """How a cut does on a set."""
    words = f"{folder}: below {100 * cut:.2f} %:"
    if len(without):
        words += f" {100 * (without < cut).mean():.0f} % of {len(without)} without a robot;"
    if len(shown):
        words += f" {100 * (shown < cut).mean():.0f} % of {len(shown)} with one"
    print(words)


if __name__ == "__main__":
    main()
