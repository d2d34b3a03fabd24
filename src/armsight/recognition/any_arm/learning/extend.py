"""Adds a robot to a trained network from some hundred rendered crops, without touching it.

No torch: the network runs in onnxruntime, what it sees of each crop is kept, and only the rows of
:mod:`armsight.recognition.any_arm.extension` are fitted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armsight.arrays import Floats32, Ints
from armsight.errors import RecognitionError, UsageError
from armsight.recognition.any_arm.evidence import STRIDE
from armsight.recognition.any_arm.extension import (
    Extension,
    Seen,
    apply,
    joints_of,
    mark_of,
    write_extension,
)
from armsight.recognition.any_arm.heat import read_heat
from armsight.recognition.any_arm.landmarks import find_landmarks
from armsight.recognition.any_arm.learning.changes import Batch, Changes, make_batch
from armsight.recognition.any_arm.learning.examples import Examples, pack_shards, read_examples
from armsight.recognition.any_arm.learning.rows import Shots, fit_rows
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.any_arm.views import SIDE
from armsight.recognition.data.crews import Crew
from armsight.recognition.data.generate import generate
from armsight.recognition.data.manifest import FILE, read_manifest
from armsight.recognition.data.order import make_order
from armsight.recognition.data.recipe import CROPS
from armsight.recognition.data.sample import NO_ROBOT, UNKNOWN_ROBOT
from armsight.robots.catalogue import load_robot

Say = Callable[[str], None]
SHOWN = 6
"""Times that each crop is shown, changed each time."""
UPDATES = 600
FEWEST = 50
_CROP = 256
"""Side of the crops that are rendered [px]."""
_SHARD = 100
"""Crops that are kept or lost together when the rendering is stopped."""


@dataclass(frozen=True)
class Wish:
    """What is to be added to what.

    Attributes:
        robot: name of the catalogue, or path of a user's own arm.
        network: file of the trained network.
        out: folder for the crops and the extension.
        samples: crops of the robot; of others there are about as many.
        seed: of crops, changes and order.
    """

    robot: str
    network: Path
    out: Path
    samples: int = 300
    seed: int = 0


def extend(wish: Wish, crew: Crew | None, say: Say) -> Path:
    """Render, look, fit, measure, write; the extension's file. Goes on with crops that are there.

    Raises:
        UsageError: too few samples.
        RecognitionError, RobotError, DatasetError: the network knows the robot already, the robot's
            files are broken, or something cannot be written.
    """
    views = CROPS.views
    if not FEWEST <= wish.samples <= 100_000:
        raise UsageError(f"--samples {wish.samples}: expected {FEWEST} to 100000")
    model = CropModel(wish.network)
    if wish.robot in model.robots:
        raise RecognitionError(f"{wish.network} knows {wish.robot} already")
    robot = load_robot(wish.robot)
    if not robot.meshes:
        raise RecognitionError(
            f"{wish.robot}: has no meshes, so there is nothing to draw; give its links visual "
            "meshes (STL, OBJ, DAE) in the URDF"
        )
    marks = find_landmarks(robot)
    kinds = (*model.robots, NO_ROBOT, UNKNOWN_ROBOT)
    each = -(-wish.samples // len(kinds) // views) * views
    counts = {wish.robot: -(-wish.samples // views) * views} | dict.fromkeys(kinds, each)
    folder = wish.out / "crops"
    # A set that was begun in other shards or with smaller crops is gone on with as it is.
    side, shard = _CROP, _SHARD
    if (folder / FILE).is_file():
        there = read_manifest(folder)
        side, shard = there.width, there.shard_size
    order = make_order("crops", counts, wish.seed, (side, side), shard)
    say(f"rendering {order.manifest.count} crops")
    generate(order, folder, crew)
    pack_shards(folder, folder / "packed-arms")
    data = read_examples(folder / "packed-arms", tuple(counts))
    learned, held = data.part(validation=False), data.part(validation=True)
    mine = data.robot == 0
    say(f"looking at {len(learned)} of them {SHOWN} times")
    shots, margin = _shots(model, data, np.repeat(learned[mine[learned]], SHOWN), wish.seed)
    others, margins = _hidden(model, data, np.repeat(learned[~mine[learned]], SHOWN), wish.seed)
    say(f"fitting to {len(shots.features)} of the robot, {len(others)} of others")
    rows = fit_rows(shots, others, np.r_[margin, margins], UPDATES, wish.seed)
    card: dict[str, object] = {
        "samples": int(mine[learned].sum()),
        "others": int((~mine[learned]).sum()),
        "seed": wish.seed,
    }
    mark = mark_of(wish.network.read_bytes())
    found = Extension(wish.robot, mark, marks, rows, card, joints_of(robot))
    card |= _measured(model, data, held, found)
    file = wish.out / "extension.safetensors"
    write_extension(file, found)
    return file


def _shots(model: CropModel, data: Examples, chosen: Ints, seed: int) -> tuple[Shots, Floats32]:
    batch = make_batch(data, chosen, np.arange(len(chosen)), seed, Changes(size=SIDE))
    looks = [model.beneath(image) for image in batch.images]
    features = np.stack([look.features.astype(np.float16) for look in looks])
    hidden = np.stack([look.hidden for look in looks])
    shots = Shots(features, hidden, batch.links, batch.coordinates, batch.known, batch.points)
    return shots, np.array([look.margin for look in looks], np.float32)


def _hidden(model: CropModel, data: Examples, chosen: Ints, seed: int) -> tuple[Floats32, Floats32]:
    batch = make_batch(data, chosen, np.arange(len(chosen)), seed + 1, Changes(size=SIDE))
    looks = [model.beneath(image) for image in batch.images]
    return (
        np.stack([look.hidden for look in looks]),
        np.array([look.margin for look in looks], np.float32),
    )


def _measured(
    model: CropModel, data: Examples, held: Ints, extension: Extension
) -> dict[str, object]:
    """Figures on rooms that were held back: of landmarks, and of who is taken for whom."""
    errors: list[float] = []
    claimed = np.zeros(len(held), bool)
    mine = data.robot[held] == 0
    for k in range(len(held)):
        batch = make_batch(data, held[k : k + 1], None, 0, Changes(size=SIDE))
        look = model.beneath(batch.images[0])
        seen = apply(extension.rows, look.features, look.hidden)
        claimed[k] = seen.type > look.margin
        if mine[k]:
            errors += _landmark_errors(seen, batch)
    return {
        "held_back": int(mine.sum()),
        "recognised": float(claimed[mine].mean()) if mine.any() else None,
        "others_held_back": int((~mine).sum()),
        "others_claimed": float(claimed[~mine].mean()) if (~mine).any() else None,
        "keypoint_px": round(float(np.median(errors)), 2) if errors else None,
        "crop_px": SIDE,
    }


def _landmark_errors(seen: Seen, batch: Batch) -> list[float]:
    """Of landmarks that lie on the arm of a batch's one crop [px]."""
    places = read_heat(seen.heat, seen.outside)
    arm = batch.links[0, 0] < 0.5
    cell = np.round(np.nan_to_num(batch.points[0], nan=-9.0)).astype(int)
    on = (cell >= 0).all(1) & (cell[:, 0] < arm.shape[1]) & (cell[:, 1] < arm.shape[0])
    on[on] = arm[cell[on, 1], cell[on, 0]]
    away = np.linalg.norm(places.mean[on] - batch.points[0][on], axis=1)
    return [float(v) for v in STRIDE * away]
