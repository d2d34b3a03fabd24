"""Makes a packed set from a labelled set; needs the whole of armsight, unlike what reads it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from armsight.arrays import Floats
from armsight.errors import RecognitionError
from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.data.sample import Sample
from armsight.recognition.inference.intrinsics import view_through
from armsight.recognition.inference.resample import fit, fit_K
from armsight.recognition.networks.architecture import JOINTS
from armsight.recognition.training.packed_set import (
    COLUMNS,
    FORMAT,
    MOST_JOINTS,
    PARTS,
    PackedSet,
)
from armsight.recognition.training.tensors_file import Array, write_tensors

PIECE_BYTES = 60_000_000
"""A piece stays below 64 MB, what a bare machine may take at once."""


def pack(
    source: LabelledSet,
    folder: Path,
    width: int,
    height: int,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, whole: None,
) -> int:
    """Write a labelled set at a network's size and return how many samples it has.

    Pictures without a robot, or with one that is not in the catalogue, are left out: the papers'
    networks have no answer for them.

    Args:
        source: labelled set.
        folder: where the pieces go; it must not hold a packed set yet.
        width: of the network's input [px].
        height: likewise; pictures of another shape lose their longer sides, about their centre.
        seed: of the split into training, validation and test.
        progress: told how many of how many are done.

    Raises:
        RecognitionError: the folder holds a packed set already, or cannot be written.
        DatasetError: a picture is missing or damaged.
    """
    if any(folder.glob("pack-*.safetensors")):
        raise RecognitionError(f"{folder}: holds a packed set already; delete it, or name another")
    robots = [r for r in JOINTS if any(row.robot == r for row in source.rows)]
    samples = [i for i, row in enumerate(source.rows) if row.robot in JOINTS]
    if not samples:
        raise RecognitionError(f"{source.folder}: shows no robot of the catalogue")
    parts = {by: _parts(source, by, seed) for by in ("frame", "scene")}
    words = {
        "format": FORMAT,
        "count": str(len(samples)),
        "robots": json.dumps(robots),
        "kind": source.manifest.kind,
        "renderer": source.manifest.renderer,
        "seed": str(source.manifest.seed),
    }
    most = max(1, PIECE_BYTES // (width * height * 4))
    for piece, first in enumerate(range(0, len(samples), most)):
        rows: list[list[Array]] = []
        for i in samples[first : first + most]:
            where = [np.array(parts[by][i]) for by in ("frame", "scene")]
            rows.append([*_columns(source[i], robots, width, height), *where])
            progress(first + len(rows), len(samples))
        columns = {
            name: np.stack([row[k] for row in rows]).astype(COLUMNS[name][0])
            for k, name in enumerate(COLUMNS)
        }
        write_tensors(folder / f"pack-{piece:05d}.safetensors", columns, words)
    return len(samples)


def pack_in_memory(
    source: LabelledSet,
    samples: Sequence[int],
    width: int,
    height: int,
    K: Floats | None = None,
) -> PackedSet:
    """Some samples of a labelled set at a network's size, all in the test part; nothing is written.

    Args:
        source: labelled set.
        samples: places in it.
        width: of the network's input [px].
        height: likewise.
        K: (3, 3) camera of the network [px], through which the pictures are then taken as it would
            have taken them; None to cut them to shape.

    Raises:
        RecognitionError: a sample shows no robot of the catalogue.
        DatasetError: a picture is missing or damaged.
    """
    robots = [r for r in JOINTS if any(source.rows[i].robot == r for i in samples)]
    strange = [i for i in samples if source.rows[i].robot not in JOINTS]
    if strange or not samples:
        raise RecognitionError(f"{source.folder}: has samples without a robot of the catalogue")
    part = np.array(PARTS.index("test"))
    rows = [[*_columns(source[i], robots, width, height, K), part, part] for i in samples]
    stacked = {
        name: np.stack([row[k] for row in rows]).astype(COLUMNS[name][0])
        for k, name in enumerate(COLUMNS)
    }
    stacked["images"], stacked["packed_masks"] = stacked.pop("image"), stacked.pop("mask")
    m = source.manifest
    about = {"kind": m.kind, "renderer": m.renderer, "seed": str(m.seed)}
    return PackedSet(**stacked, robots=tuple(robots), source=about)


def _columns(
    sample: Sample, robots: Sequence[str], width: int, height: int, K: Floats | None = None
) -> list[Array]:
    """A sample's entries, in the order of ``COLUMNS``, without the parts."""
    shown = sample.mask.astype(np.uint8) * 255
    rows, columns = sample.image.shape[:2]
    if K is None:
        image, shown = fit(sample.image, width, height), fit(shown, width, height)
        K = fit_K(sample.K, columns, rows, width, height)
    else:
        camera = sample.camera
        image = view_through(sample.image, camera, K, width, height).image
        shown = view_through(shown, camera, K, width, height).image
    mask = shown >= 128
    joints = np.full((MOST_JOINTS, 3), np.nan, np.float32)
    joints[: len(sample.joints_camera)] = sample.joints_camera
    return [
        image,
        np.packbits(mask.reshape(-1)),
        joints,
        np.asarray(sample.base_camera, np.float32),
        np.asarray(K, np.float32),
        np.array(robots.index(sample.robot)),
        np.array(sample.index),
        np.array(sample.scene),
    ]


def _parts(source: LabelledSet, by: str, seed: int) -> dict[int, int]:
    """Place in ``PARTS`` of every sample."""
    found: dict[int, int] = {}
    for k, part in enumerate(PARTS):
        for i in source.split(part, by, seed):  # type: ignore[arg-type]
            found[int(i)] = k
    return found
