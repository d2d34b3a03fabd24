"""Labelled crops as the network learns them, packed once, shard by shard.

A piece ``arms-NNNNN.safetensors`` for each finished shard of a labelled set: pictures, link ids,
landmarks, and where on its link's surface each second pixel lies. The last is drawn anew from the
robot's meshes at the labels' pose, and kept where the picture shows the same link.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Bytes, Floats32, Ints, Mask
from armsight.errors import RecognitionError
from armsight.machine import begin_worker
from armsight.recognition.any_arm.landmarks import SLOTS, Landmarks, find_landmarks
from armsight.recognition.data.labelled_set import LabelledSet, read_shard
from armsight.recognition.data.manifest import read_manifest, shard_folder
from armsight.recognition.data.order import NO_MESHES
from armsight.recognition.data.sample import NO_ROBOT, Sample
from armsight.recognition.own_arm.surface import ArmSurface, arm_surface, render
from armsight.recognition.training.tensors_file import read_tensors, write_tensors
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import link_poses
from armsight.robots.robot import Robot

UNSEEN = -128
"""Of a coordinate where no surface is known."""
SCALE = 127.0
HALF = 2
"""Pixels of the picture a pixel of the coordinates."""
FORMAT = "armsight-arms-3"
_KEYS = ("images", "links", "coordinates", "points", "robot", "scene")


@dataclass(frozen=True)
class Examples:
    """Labelled crops.

    Attributes:
        names: what the numbers in ``robot`` stand for.
        images: (n, h, w, 3) uint8 RGB.
        links: (n, h, w) uint8, 0 background, link + 1.
        coordinates: (n, h / 2, w / 2, 3) int8 place in the link's box, -127..127; UNSEEN.
        points: (n, SLOTS, 2) float32 landmarks [px]; NaN where there is none.
        robot: (n,) places in ``names``.
        scene: (n,) room of each.
    """

    names: tuple[str, ...]
    images: Bytes
    links: Bytes
    coordinates: NDArray[np.int8]
    points: Floats32
    robot: Ints
    scene: Ints

    def __len__(self) -> int:
        return len(self.images)

    @cached_property
    def empty(self) -> Ints:
        """Indices of the pictures without an arm."""
        return np.flatnonzero(np.array(self.names)[self.robot] == NO_ROBOT).astype(np.int64)

    def part(self, validation: bool) -> Ints:
        """Indices of what is learned from, or of the rooms held back."""
        held = held_back(self.robot, self.scene)
        return np.flatnonzero(held == validation).astype(np.int64)


HELD = 0.08
"""Share of the rooms that is held back."""


def held_back(robot: Ints, scene: Ints) -> Mask:
    """(n,) whether a crop's room is held back from learning: by its numbers alone.

    So a set that grows keeps its parts.
    """
    keys = scene.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    keys ^= (robot.astype(np.uint64) + np.uint64(1)) * np.uint64(0xC2B2AE3D27D4EB4F)
    return np.asarray((keys >> np.uint64(40)).astype(float) / 2.0**24 < HELD)


@dataclass(frozen=True)
class Model:
    """A robot as the labels need it."""

    robot: Robot
    surface: ArmSurface
    landmarks: Landmarks


def model_of(robot: Robot) -> Model:
    """Surface and landmarks of a robot."""
    return Model(robot, arm_surface(robot), find_landmarks(robot))


def surface_coordinates(model: Model, sample: Sample) -> NDArray[np.int8]:
    """(h / 2, w / 2, 3) where on its link's surface each second pixel lies."""
    h, w = sample.link_ids.shape
    small = (w // HALF, h // HALF)
    K = sample.K
    # Pixel centres at whole numbers: the middle of a block of two lies half a pixel on.
    lens = np.array(
        [K[0, 0] / HALF, K[1, 1] / HALF, (K[0, 2] + 0.5) / HALF - 0.5, (K[1, 2] + 0.5) / HALF - 0.5]
        + [0.0] * 5
    )
    corners = model.surface.posed(sample.q)
    drawn = render(model.surface, corners, sample.T_camera_base, lens, small)
    out = np.full((small[1], small[0], 3), UNSEEN, np.int8)
    if len(drawn.at) == 0:
        return out
    T = link_poses(model.robot, sample.q)[drawn.owner]
    local = (np.swapaxes(T[:, :3, :3], 1, 2) @ (drawn.points - T[:, :3, 3])[:, :, None])[..., 0]
    marks = model.landmarks
    scaled = (local - marks.middle[drawn.owner]) / marks.half[drawn.owner]
    ids = sample.link_ids[::HALF, ::HALF][drawn.at[:, 0], drawn.at[:, 1]]
    good = ids == drawn.owner + 1
    value = np.clip(np.round(scaled * SCALE), -SCALE, SCALE).astype(np.int8)
    out[drawn.at[good, 0], drawn.at[good, 1]] = value[good]
    return out


def landmark_pixels(model: Model, sample: Sample) -> Floats32:
    """(SLOTS, 2) where the landmarks lie in the picture [px]."""
    out = np.full((SLOTS, 2), np.nan, np.float32)
    placed = model.landmarks.placed(sample.T_camera_base @ link_poses(model.robot, sample.q))
    front = placed[:, 2] > 0.05
    seen = placed[front] @ sample.K.T
    out[model.landmarks.slot[front]] = seen[:, :2] / seen[:, 2:]
    return out


def pack_shards(
    folder: Path,
    place: Path,
    said: Callable[[int, int], None] = lambda done, whole: None,
    workers: int = 1,
) -> int:
    """Pack the finished shards that are not packed yet; how many pieces there are then.

    Args:
        folder: the labelled set.
        place: for the pieces.
        said: hears how many of all shards are packed.
        workers: processes that pack.

    Raises:
        DatasetError: no labelled set, or a shard is damaged.
        RecognitionError: a piece cannot be written.
    """
    manifest = LabelledSet.open(folder, partial=True).manifest
    there = [k for k in range(manifest.shards) if shard_folder(folder, k).is_dir()]
    missing = [k for k in there if not _piece(place, k).is_file()]
    done = len(there) - len(missing)
    work = (_pack_shard, [folder] * len(missing), [place] * len(missing), missing)
    if workers == 1 or len(missing) < 2:
        for _ in map(*work):
            done += 1
            said(done, manifest.shards)
    else:
        with ProcessPoolExecutor(workers, get_context("spawn"), begin_worker) as pool:
            for _ in pool.map(*work):
                done += 1
                said(done, manifest.shards)
    return done


def _piece(place: Path, shard: int) -> Path:
    return place / f"arms-{shard:05d}.safetensors"


def _pack_shard(folder: Path, place: Path, shard: int) -> None:
    manifest = read_manifest(folder)
    rows = LabelledSet(folder, manifest, read_shard(folder, manifest, shard))
    models = {n: _model_named(n) for n in manifest.counts if n not in NO_MESHES}
    write_pack(_piece(place, shard), [rows[i] for i in range(len(rows))], models)


@cache
def _model_named(robot: str) -> Model:
    return model_of(load_robot(robot))


def write_pack(file: Path, samples: Sequence[Sample], models: dict[str, Model]) -> None:
    """One piece."""
    names = tuple(dict.fromkeys(s.robot for s in samples))
    h, w = samples[0].mask.shape
    blank = np.full((h // HALF, w // HALF, 3), UNSEEN, np.int8)
    nowhere = np.full((SLOTS, 2), np.nan, np.float32)
    known = [models.get(s.robot) for s in samples]
    coordinates = [
        blank if m is None else surface_coordinates(m, s)
        for m, s in zip(known, samples, strict=True)
    ]
    points = [
        nowhere if m is None else landmark_pixels(m, s) for m, s in zip(known, samples, strict=True)
    ]
    tensors = {
        "images": np.stack([s.image for s in samples]),
        "links": np.stack([s.link_ids for s in samples]),
        "coordinates": np.stack(coordinates),
        "points": np.stack(points),
        "robot": np.array([names.index(s.robot) for s in samples], np.int64),
        "scene": np.array([s.scene for s in samples], np.int64),
    }
    file.parent.mkdir(parents=True, exist_ok=True)
    write_tensors(file, tensors, {"format": FORMAT, "names": "\n".join(names)})


def read_examples(place: Path, names: Sequence[str], most: int | None = None) -> Examples:
    """All pieces of a folder, robots numbered by ``names``; others than these are left out.

    Raises:
        RecognitionError: there is none, or one is damaged.
    """
    files = sorted(place.glob("arms-*.safetensors"))[:most]
    if not files:
        raise RecognitionError(f"{place}: holds no packed crops (arms-*.safetensors)")
    pieces: list[dict[str, NDArray[np.generic]]] = []
    for file in files:
        arrays, words = read_tensors(file)
        if words.get("format") != FORMAT or set(arrays) != set(_KEYS):
            raise RecognitionError(f"{file}: is no piece of packed crops; delete it, pack again")
        own = words["names"].split("\n")
        number = np.array([names.index(n) if n in names else -1 for n in own], np.int64)
        robot = number[arrays["robot"]]
        arrays["robot"] = robot
        pieces.append({k: v[robot >= 0] for k, v in arrays.items()})
    joined = {k: np.concatenate([p[k] for p in pieces]) for k in _KEYS}
    return Examples(tuple(names), **joined)
