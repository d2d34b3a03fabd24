"""A recogniser for a network's file: ours, or one of the papers'."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from armsight.arrays import Bytes, ColorImage
from armsight.errors import RecognitionError
from armsight.geometry.camera import PinholeCamera
from armsight.recognition.any_arm import model as crops
from armsight.recognition.any_arm.extension import read_extension
from armsight.recognition.inference.model import Model, read_network
from armsight.recognition.inference.pictures import Picture


@dataclass(frozen=True)
class Shown:
    """What is handed to a user.

    Attributes:
        line: JSON.
        drawing: of what was found over the picture.
        mask: 255 where an arm is.
        warning: to whoever carries the camera; empty where there is nothing to say.
    """

    line: str
    drawing: ColorImage
    mask: Bytes
    warning: str = ""


class Looks(Protocol):
    """Something that looks at pictures."""

    def __call__(self, picture: Picture, camera: PinholeCamera | None) -> Shown:
        """What is seen in a picture through a camera; None where nobody says which."""


def open_recogniser(
    file: Path, threads: int = 0, extensions: Sequence[Path] = (), robots: Sequence[str] = ()
) -> Looks:
    """Whatever can look with the network in a file.

    Args:
        file: of the network.
        threads: of the CPU; 0 for onnxruntime's own choice.
        extensions: files of robots that it learned later.
        robots: the arms in the pictures are among these; else they may be of any type.

    Raises:
        RecognitionError: it is missing, damaged, or no network of armsight's; an extension is
            damaged or belongs to another one; it does not know one of the robots.
    """
    _, words = read_network(file)
    if words.get("format") == crops.FORMAT:
        return _ours(
            crops.CropModel(file, threads, [read_extension(e) for e in extensions]), robots
        )
    if extensions:
        raise RecognitionError(f"{file}: is no crop network of armsight's; only these are extended")
    if robots:
        raise RecognitionError(f"{file}: is no crop network of armsight's; only these are told")
    return _papers(file, threads)


def _ours(model: crops.CropModel, robots: Sequence[str]) -> Looks:
    from armsight.recognition.any_arm.drawing import draw, mask_of
    from armsight.recognition.any_arm.reach import warning_of
    from armsight.recognition.any_arm.recogniser import ArmRecogniser

    recogniser = ArmRecogniser(model, robots)

    def look(picture: Picture, camera: PinholeCamera | None) -> Shown:
        found = recogniser.recognise(picture, camera)
        image = picture.image
        drawing, mask = draw(image, found), mask_of(found, image.shape)
        return Shown(found.as_line(), drawing, mask, warning_of(found))

    return look


def _papers(file: Path, threads: int) -> Looks:
    from armsight.recognition.inference.overlay import draw
    from armsight.recognition.inference.recogniser import Recogniser, as_line

    recogniser = Recogniser(Model(file, threads))

    def look(picture: Picture, camera: PinholeCamera | None) -> Shown:
        found = recogniser.recognise(picture, camera)
        mask = np.asarray(np.round(255.0 * found.mask), np.uint8)
        return Shown(as_line(found), draw(picture.image, found), mask)

    return look
