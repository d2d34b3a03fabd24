"""``dataset.toml``: what a labelled set is, how it was made, and in how many shards it lies.

::

    FOLDER/dataset.toml
    FOLDER/shards/00000/labels.jsonl          one line a picture
    FOLDER/shards/00000/images/000000.jpg     colour
    FOLDER/shards/00000/links/000000.png      8 bit: 0 no robot, i + 1 link i

The mask of the robot is where ``links`` is not 0. A shard appears whole or not at all: it is
written as ``shards/00000.part`` and renamed.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomlkit

from armsight.errors import DatasetError
from armsight.writing import write_text

FORMAT = 1
"""Version of the layout on disk."""
GENERATOR = 2
"""Version of what decides a label or a picture; a set is never continued by another one."""
FILE = "dataset.toml"


@dataclass(frozen=True)
class Manifest:
    """What a labelled set is.

    Attributes:
        kind: ``paper-like``, ``wild``, or what another renderer calls its own.
        renderer: program that drew the pictures, with its version.
        seed: everything in the set follows from it and a sample's index.
        width, height: of the pictures [px].
        counts: samples of each robot, in the order of their indices.
        scenes: rooms of each robot at most; 0 where every sample has its own.
        shard_size: samples in a shard; the last may have fewer.
        meshes: SHA-256 of each robot's drawn surface and of the spheres that keep it free.
        settings: what else the generator was told.
        format, generator: versions.
    """

    kind: str
    renderer: str
    seed: int
    width: int
    height: int
    counts: dict[str, int]
    scenes: int
    shard_size: int
    meshes: dict[str, str] = field(default_factory=dict)
    settings: dict[str, str] = field(default_factory=dict)
    format: int = FORMAT
    generator: int = GENERATOR

    @property
    def count(self) -> int:
        """Samples of the whole set."""
        return sum(self.counts.values())

    @property
    def shards(self) -> int:
        """Shards of the whole set."""
        return -(-self.count // self.shard_size)

    def shard_indices(self, shard: int) -> range:
        """Indices of the samples of a shard."""
        return range(shard * self.shard_size, min((shard + 1) * self.shard_size, self.count))


def shard_folder(folder: Path, shard: int) -> Path:
    """Where a finished shard lies."""
    return folder / "shards" / f"{shard:05d}"


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write ``dataset.toml`` whole or not at all.

    Raises:
        DatasetError: the folder cannot be written.
    """
    document = tomlkit.document()
    for name in _FIELDS:
        value = getattr(manifest, name)
        if isinstance(value, dict):
            table = tomlkit.table()
            table.update(value)
            document[name] = table
        else:
            document[name] = value
    write_text(folder / FILE, tomlkit.dumps(document), DatasetError)


def read_manifest(folder: Path) -> Manifest:
    """What the set in a folder is.

    Raises:
        DatasetError: there is no set, its description is broken, or it is of another version.
    """
    path = folder / FILE
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DatasetError(
            f"{folder}: is no labelled set ({FILE} is missing); "
            "make one with 'armsight dataset generate'"
        ) from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: is not TOML ({error}); restore it") from None
    if data.get("format") != FORMAT:
        raise DatasetError(
            f"{path}: is of format {data.get('format')!r}, this armsight reads {FORMAT}; "
            "generate the set anew"
        )
    return _manifest(path, data)


_FIELDS: dict[str, type] = {
    "format": int,
    "generator": int,
    "kind": str,
    "renderer": str,
    "seed": int,
    "width": int,
    "height": int,
    "scenes": int,
    "shard_size": int,
    "counts": dict,
    "meshes": dict,
    "settings": dict,
}


def _manifest(path: Path, data: dict[str, Any]) -> Manifest:
    for name, kind in _FIELDS.items():
        value = data.get(name)
        if not isinstance(value, kind) or isinstance(value, bool):
            raise DatasetError(f"{path}: {name} is {value!r}, expected {kind.__name__}; restore it")
    counts = data["counts"]
    positive = [data["width"], data["height"], data["shard_size"], *counts.values()]
    if not all(isinstance(n, int) and 0 < n <= 100_000_000 for n in positive):
        raise DatasetError(f"{path}: sizes and counts must be whole numbers above 0; restore it")
    return Manifest(**{name: data[name] for name in _FIELDS})
