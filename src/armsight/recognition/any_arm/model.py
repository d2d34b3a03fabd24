"""The crop network in an ONNX file, opened with suspicion and run by onnxruntime alone."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import ColorImage, Floats, Floats32
from armsight.errors import RecognitionError
from armsight.recognition.any_arm.heat import Places, read_heat
from armsight.recognition.any_arm.landmarks import SLOTS, Landmarks
from armsight.recognition.inference.model import open_session, read_network

FORMAT = "armsight-crop-1"
STRIDE = 4
"""Pixels a cell of the outputs."""
GRAIN = 32
"""Sides of a picture that the network takes are multiples of this."""
_MOST_ROBOTS = 64


@dataclass(frozen=True)
class Look:
    """What the network says of a picture of its own making; cells are of 4 pixels.

    Attributes:
        links: (10, h, w) probability of background, link 0, link 1 ...
        coordinates: (h, w, 3) place in its link's box, -1..1; spread: (h, w) of these.
        types: probability of each type by its name.
        places: landmarks of each robot [cells].
    """

    links: Floats32
    coordinates: Floats32
    spread: Floats32
    types: dict[str, float]
    places: dict[str, Places]

    @property
    def arm(self) -> Floats32:
        """(h, w) probability of any arm."""
        return np.asarray(1.0 - self.links[0])


class CropModel:
    """A network ready to look.

    Attributes:
        name: of the file, without its ending.
        card: what it was trained on and how good it is.
        robots: names of the robots that it knows.
        landmarks: of each.
    """

    def __init__(self, file: Path, threads: int = 0) -> None:
        """Open a file.

        Args:
            file: ONNX, as ``armsight train --config ours`` writes it.
            threads: of the CPU; 0 for onnxruntime's own choice.

        Raises:
            RecognitionError: it is missing, damaged, or no crop network of armsight's.
        """
        data, words = read_network(file)
        if words.get("format") != FORMAT:
            raise RecognitionError(f"{file}: is no crop network of armsight's")
        self.name = file.stem
        self.card, self.landmarks = _card(file, words)
        self.robots = tuple(self.landmarks)
        self._session = open_session(file, data, threads)
        self._names = [o.name for o in self._session.get_outputs()]
        wanted = {"links", "coordinates", "spread", "type"}
        wanted |= {f"{k}_{name}" for name in self.robots for k in ("heat", "outside")}
        inputs = [(i.name, i.type) for i in self._session.get_inputs()]
        if set(self._names) != wanted or inputs != [("image", "tensor(uint8)")]:
            raise RecognitionError(f"{file}: does not fit its own card; take the original")

    def look(self, image: ColorImage) -> Look:
        """At an (h, w, 3) picture whose sides are multiples of 32.

        Raises:
            RecognitionError: the network answers with something that is no number, or not of the
                size that it should.
        """
        found = dict(zip(self._names, self._session.run(None, {"image": image[None]}), strict=True))
        h, w = image.shape[0] // STRIDE, image.shape[1] // STRIDE
        shapes: dict[str, tuple[int, ...]] = {
            "links": (1, 10, h, w),
            "coordinates": (1, 3, h, w),
            "spread": (1, 1, h, w),
        }
        shapes["type"] = (1, len(self.robots) + 2)
        for name in self.robots:
            p = SLOTS
            shapes |= {f"heat_{name}": (1, p, h, w), f"outside_{name}": (1, p)}
        if any(found[k].shape != s for k, s in shapes.items()):
            raise RecognitionError(f"{self.name}: answers in another size; take the original")
        if not all(np.isfinite(v).all() for v in found.values()):
            raise RecognitionError(f"{self.name}: answers with something that is no number")
        places = {}
        for name in self.robots:
            slot = self.landmarks[name].slot
            places[name] = read_heat(
                found[f"heat_{name}"][0, slot], found[f"outside_{name}"][0, slot]
            )
        types = _softmax(found["type"][0].astype(np.float64), 0)
        return Look(
            _softmax(found["links"][0], 0).astype(np.float32),
            np.ascontiguousarray(found["coordinates"][0].transpose(1, 2, 0)),
            np.exp(np.clip(found["spread"][0, 0], -4.0, 1.5)),
            dict(zip((*self.robots, "none", "unknown"), map(float, types), strict=True)),
            places,
        )


def _softmax(x: Floats, axis: int) -> Floats:
    e = np.exp(x - x.max(axis=axis, keepdims=True))
    return np.asarray(e / e.sum(axis=axis, keepdims=True))


def _card(file: Path, words: dict[str, str]) -> tuple[dict[str, Any], dict[str, Landmarks]]:
    try:
        card = json.loads(words["card"])
        given = card["landmarks"]
        if not 0 < len(given) <= _MOST_ROBOTS:
            raise ValueError
        return card, {str(name): _landmarks(entry) for name, entry in given.items()}
    except (KeyError, ValueError, TypeError, AttributeError, RecursionError):
        raise RecognitionError(f"{file}: its card is damaged; take the original") from None


def _landmarks(entry: dict[str, Any]) -> Landmarks:
    slot, link = (np.array(entry[k], np.int64) for k in ("slot", "link"))
    point, middle, half = (np.array(entry[k], np.float64) for k in ("point", "middle", "half"))
    good = (
        link.ndim == 1
        and 0 < len(link) <= SLOTS
        and slot.shape == link.shape
        and bool(((slot >= 0) & (slot < SLOTS)).all())
        and point.shape == (len(link), 3)
        and middle.ndim == 2
        and middle.shape == half.shape
        and middle.shape[1] == 3
        and bool(((link >= 0) & (link < len(middle))).all())
        and all(bool(np.isfinite(v).all()) for v in (point, middle, half))
    )
    if not good:
        raise ValueError
    return Landmarks(slot, link, point, middle, half)
