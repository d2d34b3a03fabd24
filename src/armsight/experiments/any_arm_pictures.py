"""The first frames of each robot with the skeletons that were found: none is chosen by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from armsight.experiments.any_arm_frames import NOTHING, given_box, joint_error
from armsight.recognition.any_arm.drawing import draw
from armsight.recognition.any_arm.recogniser import ArmRecogniser
from armsight.recognition.data import LabelledSet
from armsight.recognition.data.sample import KNOWN_ROBOTS, Sample
from armsight.recognition.drawing import draw_skeleton
from armsight.recognition.inference.intrinsics import project
from armsight.recognition.inference.pictures import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EACH = 2
"""Frames of each robot."""
WRONG_MM = 100.0


def skeletons(recogniser: ArmRecogniser, held: LabelledSet, chosen: Sequence[int]) -> Figure:
    """Of each robot the first frames of a choice: angles unknown, and below with these given.

    Titles of answers that are wrong (another type, or off by more than 100 mm) are red.
    """
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(3.2 * len(KNOWN_ROBOTS), 2 * EACH * 2.6))
    axes = drawn.subplots(2 * EACH, len(KNOWN_ROBOTS), squeeze=False)
    for column, robot in enumerate(KNOWN_ROBOTS):
        mine = [i for i in chosen if held.rows[i].robot == robot][:EACH]
        for k, i in enumerate(mine):
            _unknown(axes[2 * k, column], recogniser, held[i])
            _known(axes[2 * k + 1, column], recogniser, held[i])
    for ax in axes.ravel():
        ax.axis("off")
    drawn.tight_layout()
    return drawn


def _unknown(ax: Axes, recogniser: ArmRecogniser, sample: Sample) -> None:
    found = recogniser.recognise(Picture("", sample.image), sample.camera)
    error, _ = joint_error(found, sample)
    said = found.arms[0].robot if found.arms else "none"
    sure = bool(found.arms) and found.arms[0].believed
    words = f"{sample.robot}: {said}, {_millimetres(error)}{'' if sure else ', not believed'}"
    _shown(ax, draw(sample.image, found), words, said == sample.robot and error <= WRONG_MM)


def _known(ax: Axes, recogniser: ArmRecogniser, sample: Sample) -> None:
    given = given_box(recogniser, sample, sample.camera)
    image = np.ascontiguousarray(sample.image).copy()
    if given.places is not None:
        draw_skeleton(
            image, project(given.places, np.asarray(sample.K, np.float64), sample.distortion)
        )
    error = given.error(sample)
    _shown(ax, image, f"angles and box given: {_millimetres(error)}", error <= WRONG_MM)


def _shown(ax: Axes, image: np.ndarray, words: str, right: bool) -> None:
    ax.imshow(image)
    ax.set_title(words, fontsize=8, color="black" if right else "red")


def _millimetres(error: float) -> str:
    return "no pose" if error >= NOTHING else f"{error:.0f} mm off"
