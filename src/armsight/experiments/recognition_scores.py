"""Trained networks and labelled sets found on disk, and how the ones do on the others.

::

    results/recognition/sets/paper-like           armsight dataset generate
    results/recognition/sets/paper-rooms
    results/recognition/sets/wild
    results/recognition/sets/second-paper-like    the second renderer's
    results/recognition/sets/second-wild
    results/recognition/runs/t4, t5, t6, t7       armsight train, armsight transfer
    results/recognition/runs/t6-100, t7-250       the same from fewer or more samples
    results/recognition/runs/t5-rooms             the same on paper-rooms

``ARMSIGHT_RECOGNITION`` names another folder than ``results/recognition``.
"""

from __future__ import annotations

import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import Floats, Ints
from armsight.errors import ArmsightError
from armsight.experiments.frame import Progress
from armsight.recognition.data import LabelledSet
from armsight.recognition.inference.intrinsics import view_through
from armsight.recognition.inference.model import Model
from armsight.recognition.inference.no_robot import robot_share
from armsight.recognition.networks.architecture import Architecture
from armsight.recognition.training.figures import Answer, Scores, score
from armsight.recognition.training.packed_set import PackedSet
from armsight.recognition.training.packing import pack_in_memory
from armsight.recognition.training.tensors_file import Array

RECORDINGS, ROOMS = "paper-like", "paper-rooms"
UNSEEN = "unseen scenes"
SETS = {
    RECORDINGS: "unseen recordings",
    ROOMS: UNSEEN,
    "wild": "wild",
    "second-paper-like": "second renderer, paper-like",
    "second-wild": "second renderer, wild",
}
"""What the frames of each set are to a network that was trained on another one."""
ANY_LENS = ("wild", "second-wild")
"""Sets whose pictures have a lens each: taken through the network's own, as ``recognise`` does."""


def folder() -> Path:
    """Where sets and trained networks lie."""
    return Path(os.environ.get("ARMSIGHT_RECOGNITION", "results/recognition"))


@dataclass(frozen=True)
class Tried:
    """A network on a set.

    Attributes:
        model: the network.
        set: name of the set.
        where: which frames, in words.
        data: they.
        scores: how it did.
        own: they are the test frames of the set that it was trained on.
    """

    model: Model
    set: str
    where: str
    data: PackedSet
    scores: Scores
    own: bool

    @property
    def trained(self) -> str:
        """What it was trained on."""
        return "trained on rooms" if _kind(self.model) == ROOMS else "trained on recordings"

    @property
    def condition(self) -> str:
        """What it was trained on, and on which frames it was tried."""
        return f"{self.trained}; {self.where}"


class Bench:
    """Asks networks about sets; each set is read once a size.

    Args:
        most: frames of each robot, at most.
        seed: of which.
        progress: told what is done.
    """

    def __init__(self, most: int, seed: int, progress: Progress) -> None:
        self._most, self._seed, self._progress = most, seed, progress
        self._sets: dict[str, LabelledSet | None] = {}
        self._packed: dict[tuple[Any, ...], PackedSet] = {}
        self.missing: list[str] = []

    def model(self, name: str) -> Model | None:
        """The network of a training, None where there is none (and that is noted)."""
        file = folder() / "runs" / name / "network.onnx"
        if not file.is_file():
            self.missing.append(f"runs/{name}/network.onnx")
            return None
        return Model(file, threads=1)

    def labelled(self, name: str) -> LabelledSet | None:
        """A set, as far as it is finished; None where there is none (and that is noted)."""
        if name not in self._sets:
            place = folder() / "sets" / name
            try:
                self._sets[name] = LabelledSet.open(place, partial=True)
            except ArmsightError as error:
                why = str(error).removeprefix(f"{place}").lstrip(":/ ")
                self.missing.append(f"sets/{name}: {why}")
                self._sets[name] = None
        return self._sets[name]

    def tries(self, model: Model, robots: tuple[str, ...]) -> list[Tried]:
        """A network on the test frames of the training renderer and on the second renderer."""
        split = str(model.card["data"].get("split", "frame"))
        own = {"scene": UNSEEN, "frame": "frames of seen recordings"}[split]
        found = []
        for name, words in SETS.items():
            labelled = self.labelled(name)
            if labelled is None:
                continue
            mine = name == _kind(model)
            by = split if mine else "scene" if name == ROOMS else ""
            samples = self._samples(labelled, by, robots)
            if not samples:
                self.missing.append(f"{', '.join(robots)} in sets/{name}")
                continue
            a = model.architecture
            K = model.K if name in ANY_LENS else None
            key = (name, by, a.width, a.height, robots, None if K is None else K.tobytes())
            self._progress(f"reading {name}", 0.0)
            if key not in self._packed:
                self._packed[key] = pack_in_memory(labelled, samples, a.width, a.height, K)
            data = self._packed[key]
            self._progress(f"{model.card['paper']} on {name}", 0.0)
            scores = score(_ask(model), a, data, np.arange(len(data)))
            found.append(Tried(model, name, own if mine else words, data, scores, mine))
        return found

    def _samples(self, labelled: LabelledSet, by: str, robots: tuple[str, ...]) -> list[int]:
        """Test frames of a set that is split by something, all frames of another; some a robot."""
        places = np.arange(len(labelled))
        if by:
            places = labelled.split("test", by)  # type: ignore[arg-type]
        chosen: list[int] = []
        for robot in robots:
            mine = np.array([i for i in places if labelled.rows[int(i)].robot == robot], int)
            rng = np.random.default_rng([self._seed, 41])
            chosen += sorted(int(i) for i in rng.permutation(mine)[: self._most])
        return chosen


def mask_shares(model: Model, labelled: LabelledSet, samples: Ints) -> Floats:
    """(n,) share of the network's input that looks like a robot, through its own camera, 0..1."""
    a = model.architecture
    found = []
    for i in samples:
        sample = labelled[int(i)]
        image = view_through(sample.image, sample.camera, model.K, a.width, a.height).image
        found.append(robot_share(model.run(image).mask))
    return np.array(found)


def _kind(model: Model) -> str:
    """The kind of set that a network was trained on."""
    return str(model.card["data"].get("kind", RECORDINGS))


def training_curve(name: str) -> list[dict[str, Any]]:
    """Records of a training's losses; none where there is no readable curve."""
    try:
        text = (folder() / "runs" / name / "curve.json").read_text(encoding="utf-8")
        records = json.loads(text)
        return [r for r in records if isinstance(r["stage"], int) and isinstance(r["update"], int)]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _ask(model: Model) -> Answer:
    def ask(images: Array, samples: Ints) -> dict[str, Array]:
        answers = [model.run(image) for image in images]
        names = ("mask", "joints", "base", "type")
        return {k: np.stack([getattr(a, k) for a in answers]) for k in names}

    return ask


def milliseconds(file_or_bytes: bytes | str, a: Architecture, threads: int) -> tuple[float, float]:
    """Median wall time of one image on some threads, and processor time of one image [ms]."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    session = onnxruntime.InferenceSession(
        file_or_bytes, options, providers=["CPUExecutionProvider"]
    )
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (1, a.height, a.width, 3), dtype=np.uint8)
    for _ in range(3):
        session.run(None, {"image": image})
    walls = []
    cpu = time.process_time()
    for _ in range(21):
        begun = time.perf_counter()
        session.run(None, {"image": image})
        walls.append(time.perf_counter() - begun)
    return 1e3 * float(np.median(walls)), 1e3 * (time.process_time() - cpu) / len(walls)
