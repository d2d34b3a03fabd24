"""A labelled set at a network's size, in a few files that need nothing but numpy to be read.

``pack-00000.safetensors`` and so on, each below 64 MB: images and masks as the network takes them,
points in the camera's frame, and to which part of the set each sample belongs. ``packing.py``
makes them from a labelled set.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from armsight.arrays import Bytes, Floats, Floats32, Ints, Mask
from armsight.errors import RecognitionError
from armsight.recognition.networks.architecture import JOINTS
from armsight.recognition.training.tensors_file import Array, read_tensors

FORMAT = "armsight-pack-1"
MOST_JOINTS = max(JOINTS.values())
Part = Literal["train", "validation", "test"]
PARTS: tuple[str, ...] = get_args(Part)
By = Literal["frame", "scene"]

COLUMNS: dict[str, tuple[str, tuple[int, ...]]] = {
    "image": ("|u1", (-1, -1, 3)),
    "mask": ("|u1", (-1,)),
    "joints": ("<f4", (MOST_JOINTS, 3)),
    "base": ("<f4", (3,)),
    "K": ("<f4", (3, 3)),
    "robot": ("|u1", ()),
    "index": ("<i4", ()),
    "scene": ("<i4", ()),
    "part_frame": ("|u1", ()),
    "part_scene": ("|u1", ()),
}
"""Type and shape of a sample's entry in each column; -1 where the size of the pictures decides."""


@dataclass(frozen=True)
class PackedSet:
    """Samples at one size.

    Attributes:
        images: (n, h, w, 3) RGB.
        packed_masks: (n, ceil(h w / 8)) bits, where the robot is seen.
        joints: (n, 7, 3) joint origins in the camera's frame [m], NaN where there is no joint.
        base: (n, 3) origin of the robot's base in the camera's frame [m].
        K: (n, 3, 3) camera matrix of the pictures as they are here [px].
        robot: (n,) place in ``robots``.
        index, scene: (n,) of the labelled set.
        part_frame, part_scene: (n,) place in ``PARTS``, split by frame and by scene.
        robots: names.
        source: what the labelled set was: kind, renderer, seed.
    """

    images: Bytes
    packed_masks: Bytes
    joints: Floats32
    base: Floats32
    K: Floats32
    robot: Bytes
    index: Array
    scene: Array
    part_frame: Bytes
    part_scene: Bytes
    robots: tuple[str, ...]
    source: dict[str, str]

    def __len__(self) -> int:
        return len(self.images)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures [px]."""
        return self.images.shape[2], self.images.shape[1]

    def masks(self, samples: Ints) -> Mask:
        """(k, h, w) where the robot is seen in the samples."""
        width, height = self.size
        bits = np.unpackbits(self.packed_masks[samples], axis=1, count=width * height)
        return bits.reshape(-1, height, width).astype(bool)

    def select(
        self,
        part: Part,
        by: By,
        robots: tuple[str, ...],
        limit: int | None = None,
        seed: int = 0,
    ) -> Ints:
        """Samples of some robots in one part of the set, in rising order.

        Args:
            part: train, validation or test.
            by: split by ``frame`` as the papers do, or by ``scene``.
            robots: names.
            limit: at most so many of each robot, drawn at random; None for all.
            seed: of that draw.

        Raises:
            RecognitionError: a robot is not in the set, or has nothing in this part.
        """
        parts = self.part_frame if by == "frame" else self.part_scene
        chosen = []
        for name in robots:
            if name not in self.robots:
                raise RecognitionError(
                    f"the data has no {name} (it has {', '.join(self.robots)}); "
                    "generate some, or leave it out of the configuration's robots"
                )
            mine = (self.robot == self.robots.index(name)) & (parts == PARTS.index(part))
            found = np.flatnonzero(mine)
            if len(found) == 0:
                raise RecognitionError(
                    f"the data has no {name} for {part} when split by {by}; generate more"
                )
            if limit is not None and limit < len(found):
                rng = np.random.default_rng([seed, 31, sorted(JOINTS).index(name)])
                found = rng.permutation(found)[:limit]
            chosen.append(found)
        return np.sort(np.concatenate(chosen))

    def mean_K(self) -> Floats:
        """(3, 3) the mean camera [px], which a network that is not told K silently learns."""
        return np.asarray(self.K.mean(axis=0), np.float64)


def read_packed_set(folder: Path) -> PackedSet:
    """Read every piece of a packed set.

    Raises:
        RecognitionError: there is none, a piece is missing or damaged, or pieces do not belong
            together.
    """
    files = sorted(folder.glob("pack-*.safetensors"))
    if not files:
        raise RecognitionError(
            f"{folder}: has no pack-*.safetensors; make them with 'armsight train --pack'"
        )
    pieces: list[dict[str, Array]] = []
    first: dict[str, str] = {}
    for file in files:
        columns, words = read_tensors(file)
        if words.get("format") != FORMAT:
            raise RecognitionError(f"{file}: is no packed set of this armsight; pack the set anew")
        first = first or words
        if words != first:
            raise RecognitionError(f"{file}: belongs to another set than {files[0]}; pack anew")
        _check_columns(file, columns)
        pieces.append(columns)
    joined = {name: np.concatenate([p[name] for p in pieces]) for name in COLUMNS}
    if str(len(joined["image"])) != first.get("count"):
        raise RecognitionError(
            f"{folder}: has {len(joined['image'])} samples of {first.get('count')}; a piece is "
            "missing, copy it too"
        )
    robots, source = _described(folder, first)
    if len(joined["robot"]) and int(joined["robot"].max()) >= len(robots):
        raise RecognitionError(f"{folder}: a sample shows a robot without a name; pack anew")
    joined["images"], joined["packed_masks"] = joined.pop("image"), joined.pop("mask")
    return PackedSet(**joined, robots=robots, source=source)


def _described(folder: Path, words: dict[str, str]) -> tuple[tuple[str, ...], dict[str, str]]:
    try:
        robots = tuple(str(r) for r in json.loads(words["robots"]))
        source = {k: words[k] for k in ("kind", "renderer", "seed")}
    except (KeyError, ValueError, TypeError, RecursionError):
        raise RecognitionError(f"{folder}: its description is damaged; pack the set anew") from None
    unknown = [r for r in robots if r not in JOINTS]
    if unknown:
        raise RecognitionError(f'{folder}: robot "{unknown[0]}" is unknown; pack the set anew')
    return robots, source


def _check_columns(file: Path, columns: dict[str, Array]) -> None:
    """Every column is there, of its type and shape, and as long as the others."""
    for name, (dtype, shape) in COLUMNS.items():
        column = columns.get(name)
        if (
            column is None
            or column.dtype != np.dtype(dtype)
            or column.ndim != 1 + len(shape)
            or any(w not in (-1, n) for w, n in zip(shape, column.shape[1:], strict=True))
            or len(column) != len(columns.get("image", column))
        ):
            raise RecognitionError(f'{file}: its column "{name}" is missing or wrong; pack anew')
    height, width = columns["image"].shape[1:3]
    if columns["mask"].shape[1] != -(-height * width // 8):
        raise RecognitionError(f"{file}: masks and images differ in size; pack anew")
    if not (np.isfinite(columns["base"]).all() and np.isfinite(columns["K"]).all()):
        raise RecognitionError(f"{file}: holds a number that is not finite; pack anew")
    if max(columns["part_frame"].max(initial=0), columns["part_scene"].max(initial=0)) > 2:
        raise RecognitionError(f"{file}: a sample belongs to no part of the set; pack anew")
