"""The crop network in an ONNX file, opened with suspicion and run by onnxruntime alone."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import ColorImage, Floats, Floats32
from armsight.errors import RecognitionError
from armsight.recognition.any_arm.evidence import (
    STRIDE,
    Evidence,
    Surface,
    log_places,
    surface_of,
    together,
)
from armsight.recognition.any_arm.extension import Extension, apply, mark_of
from armsight.recognition.any_arm.heat import Places, read_heat
from armsight.recognition.any_arm.landmarks import SLOTS, Landmarks, read_landmarks
from armsight.recognition.inference.model import open_session, read_network, run_session

FORMAT = "armsight-crop-1"
GRAIN = 32
"""Sides of a picture that the network takes are multiples of this."""
BENEATH = ("features", "hidden")
"""Outputs that extensions read from."""
NONE, UNKNOWN = 0.5, 0.3
"""Probabilities of "none" and of "unknown" from which it is said; on 70 frames of the training's
renderer 0.3 finds two unknown arms in five and gives one known one in fifty away."""
_MOST_ROBOTS = 64


@dataclass(frozen=True)
class Look:
    """What the network says of a picture of its own making.

    Attributes:
        surface: of the robots that it was trained on; own: of those that were added to it.
        types: probability of each type by its name.
        places: landmarks of each robot [cells].
        alike: robots that were added and that it may as well be, the likeliest first, though the
            network itself names another type.
    """

    surface: Surface
    own: dict[str, Surface]
    types: dict[str, float]
    places: dict[str, Places]
    alike: tuple[str, ...] = ()

    @property
    def empty(self) -> bool:
        """Whether it says that there is no arm."""
        return self.types["none"] > NONE

    @property
    def stranger(self) -> bool:
        """Whether it says that there is an arm that is none of those that it knows."""
        unknown = self.types["unknown"]
        added = max((self.types[name] for name in self.own), default=0.0)
        return not self.empty and unknown > UNKNOWN and unknown >= added

    def surface_of(self, robot: str) -> Surface:
        """What it says if the arm is of a robot."""
        return self.own.get(robot, self.surface)

    @property
    def arm(self) -> Floats32:
        """(h, w) probability of any arm."""
        return np.asarray(1.0 - self.surface.links[0])


@dataclass(frozen=True)
class Beneath:
    """What extensions read from.

    Attributes:
        features: (c, h / 8, w / 8); hidden: (d,).
        margin: log of the sum of the exponentials of the network's own types.
    """

    features: Floats32
    hidden: Floats32
    margin: float


class CropModel:
    """A network ready to look.

    Attributes:
        name: of the file, without its ending.
        card: what it was trained on and how good it is.
        robots: names of the robots that it knows, those that were added behind the others.
        landmarks: of each.
        threads: of the CPU that it runs on; 0 for onnxruntime's own choice.
    """

    def __init__(self, file: Path, threads: int = 0, extensions: Sequence[Extension] = ()) -> None:
        """Open a file.

        Args:
            file: ONNX, as ``armsight train --config ours`` writes it.
            threads: of the CPU; 0 for onnxruntime's own choice.
            extensions: robots that it learned later.

        Raises:
            RecognitionError: it is missing, damaged, or no crop network of armsight's; or an
                extension belongs to another one, or its robot has other joints now.
            RobotError: the robot of an extension is not where it was.
        """
        data, words = read_network(file)
        if words.get("format") != FORMAT:
            raise RecognitionError(f"{file}: is no crop network of armsight's")
        self.name = file.stem
        self.card, self.landmarks = _card(file, words)
        self._trained = tuple(self.landmarks)
        self._extensions = tuple(extensions)
        for extension in extensions:
            if extension.network != mark_of(data):
                raise RecognitionError(
                    f"the extension for {extension.robot} belongs to another network than {file}; "
                    "name the network that it was made for, or run 'armsight extend' again"
                )
            if extension.robot in self.landmarks:
                raise RecognitionError(f"{file} knows {extension.robot} already")
            extension.check_robot()
            self.landmarks[extension.robot] = extension.landmarks
        self.robots = tuple(self.landmarks)
        self.threads = threads
        self._session = open_session(file, data, threads)
        self._names = [o.name for o in self._session.get_outputs()]
        self._read = [n for n in self._names if self._extensions or n not in BENEATH]
        wanted = {"links", "coordinates", "spread", "type"}
        wanted |= {f"{k}_{name}" for name in self._trained for k in ("heat", "outside")}
        wanted |= {"features", "hidden"}
        inputs = [(i.name, i.type) for i in self._session.get_inputs()]
        if set(self._names) != wanted or inputs != [("image", "tensor(uint8)")]:
            raise RecognitionError(f"{file}: does not fit its own card; take the original")

    def arm(self, image: ColorImage) -> Floats32:
        """(h / 4, w / 4) probability of any arm in an (h, w, 3) picture, sides multiples of 32.

        Raises:
            RecognitionError: see :meth:`look`.
        """
        links = self._run(image, ["links"])["links"][0]
        blank = np.zeros((3, *links.shape[1:]), np.float32)
        return np.asarray(1.0 - surface_of(links, blank, blank[0]).links[0])

    def look(self, image: ColorImage) -> Look:
        """At an (h, w, 3) picture whose sides are multiples of 32.

        Raises:
            RecognitionError: the network answers with something that is no number, or not of the
                size that it should.
        """
        return self.read(self.evidence(image))

    def look_again(self, first: Evidence, image: ColorImage, H: Floats) -> Look:
        """At a picture of what another one showed, both together.

        Args:
            first: what was said of the other one.
            image: (h, w, 3), sides multiples of 32.
            H: (3, 3) from its pixels to the other one's.

        Raises:
            RecognitionError: see :meth:`look`.
        """
        return self.read(together(first, self.evidence(image), H))

    def evidence(self, image: ColorImage) -> Evidence:
        """What all is read off, of an (h, w, 3) picture whose sides are multiples of 32.

        Raises:
            RecognitionError: see :meth:`look`.
        """
        found = self._run(image, self._read)
        heat, outside = {}, {}
        for name in self._trained:
            slot = self.landmarks[name].slot
            heat[name], outside[name] = log_places(
                found[f"heat_{name}"][0, slot], found[f"outside_{name}"][0, slot]
            )
        logits = found["type"][0].astype(np.float64)
        own, strength = {}, {}
        for extension in self._extensions:
            seen = apply(extension.rows, found["features"][0], found["hidden"][0])
            name, slot = extension.robot, extension.landmarks.slot
            own[name] = surface_of(seen.surface[:10], seen.surface[10:13], seen.surface[13])
            heat[name], outside[name] = log_places(seen.heat[slot], seen.outside[slot])
            strength[name] = float(seen.type - _log_sum(logits))
        return Evidence(
            surface_of(found["links"][0], found["coordinates"][0], found["spread"][0, 0]),
            own,
            heat,
            outside,
            logits - _log_sum(logits),
            strength,
        )

    def _run(self, image: ColorImage, wanted: list[str]) -> dict[str, Floats32]:
        """What the network answers, checked."""
        answers = run_session(self.name, self._session, wanted, image)
        found = dict(zip(wanted, answers, strict=True))
        h, w = image.shape[0] // STRIDE, image.shape[1] // STRIDE
        shapes: dict[str, tuple[int, ...]] = {
            "links": (1, 10, h, w),
            "coordinates": (1, 3, h, w),
            "spread": (1, 1, h, w),
        }
        shapes["type"] = (1, len(self._trained) + 2)
        for name in self._trained:
            p = SLOTS
            shapes |= {f"heat_{name}": (1, p, h, w), f"outside_{name}": (1, p)}
        if any(found[k].shape != s for k, s in shapes.items() if k in found):
            raise RecognitionError(f"{self.name}: answers in another size; take the original")
        if not all(np.isfinite(v).all() for v in found.values()):
            raise RecognitionError(f"{self.name}: answers with something that is no number")
        return found

    def beneath(self, image: ColorImage) -> Beneath:
        """What all that is said of an (h, w, 3) picture is read off."""
        names = [*BENEATH, "type"]
        features, hidden, kind = run_session(self.name, self._session, names, image)
        return Beneath(features[0], hidden[0], _log_sum(kind[0].astype(np.float64)))

    def read(self, evidence: Evidence) -> Look:
        """What follows from evidence.

        Extensions speak for what the network calls unknown, and take their share of that alone.
        Where it names a type, its answer stays bit for bit, and an extension that claims the arm is
        ``alike``.
        """
        places = {
            name: read_heat(heat, evidence.outside[name]) for name, heat in evidence.heat.items()
        }
        share = {
            name: float(1.0 / (1.0 + np.exp(-np.clip(strength, -30, 30))))
            for name, strength in evidence.strength.items()
        }
        names = (*self._trained, "none", "unknown")
        types = dict(zip(names, map(float, np.exp(evidence.types)), strict=True))
        types |= dict.fromkeys(share, 0.0)
        look = Look(evidence.surface, evidence.own, types, places)
        claimed = sorted((n for n in share if share[n] > 0.5), key=lambda n: -share[n])
        if claimed and look.stranger:
            first, rest = claimed[0], look.types["unknown"]
            types = types | {first: share[first] * rest, "unknown": (1.0 - share[first]) * rest}
        alike = () if look.stranger or look.empty else tuple(claimed)
        return Look(look.surface, look.own, types, places, alike)


def _log_sum(logits: Floats) -> float:
    top = float(logits.max())
    return top + float(np.log(np.exp(logits - top).sum()))


def _card(file: Path, words: dict[str, str]) -> tuple[dict[str, Any], dict[str, Landmarks]]:
    try:
        card = json.loads(words["card"])
        given = card["landmarks"]
        if not 0 < len(given) <= _MOST_ROBOTS:
            raise ValueError
        return card, {str(name): read_landmarks(entry) for name, entry in given.items()}
    except (
        KeyError, ValueError, TypeError, AttributeError, OverflowError, RecursionError,
    ):  # fmt: skip
        raise RecognitionError(f"{file}: its card is damaged; take the original") from None
