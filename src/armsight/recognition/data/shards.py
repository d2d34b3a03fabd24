"""Writes a set on disk, shard by shard; begun again, it goes on after the last finished shard."""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Protocol

from armsight.errors import DatasetError
from armsight.recognition.data.manifest import (
    FILE,
    Manifest,
    read_manifest,
    shard_folder,
    write_manifest,
)
from armsight.recognition.data.rows import Drawn, Row, to_json

BATCH = 20
"""Samples that are drawn in one go."""


class Progress(Protocol):
    """Hears how many samples of the whole are there."""

    def __call__(self, done: int, total: int) -> None:
        """Called after every batch."""


def fill(
    manifest: Manifest,
    folder: Path,
    draw: Callable[[Iterator[range]], Iterator[list[Drawn]]],
    progress: Progress | None = None,
    batch_size: int = BATCH,
) -> int:
    """Make what is missing of a set and return how many samples were drawn.

    Shards that are there are left alone. A shard appears whole or not at all: whatever stops this
    function leaves finished shards and at most folders that end in ``.part``, which the next run
    removes.

    Args:
        manifest: the set.
        folder: where it lies.
        draw: draws batches of indices, each whole, in any order.
        progress: hears how far it is.
        batch_size: samples in a batch.

    Raises:
        DatasetError: the folder holds another set, is being written by somebody else, or the disk
            is full.
    """
    with _held(folder):
        _claim(folder, manifest)
        missing = [k for k in range(manifest.shards) if not shard_folder(folder, k).is_dir()]
        total = manifest.count
        done = total - sum(len(manifest.shard_indices(k)) for k in missing)
        if progress:
            progress(done, total)
        drawn = 0
        writers = {k: _ShardWriter(folder, manifest, k) for k in missing}
        try:
            for batch in draw(_batches(manifest, missing, batch_size)):
                writers[batch[0].row.index // manifest.shard_size].add(batch)
                drawn += len(batch)
                if progress:
                    progress(done + drawn, total)
        except OSError as error:
            raise _disk_error(folder, error) from None
        finally:
            for writer in writers.values():
                writer.drop()
    return drawn


class _ShardWriter:
    """Collects the samples of a shard in ``NAME.part`` and renames it when it has all of them."""

    def __init__(self, folder: Path, manifest: Manifest, shard: int) -> None:
        self._final = shard_folder(folder, shard)
        self._part = self._final.with_suffix(".part")
        self._wanted = len(manifest.shard_indices(shard))
        self._rows: dict[int, Row] = {}

    def add(self, batch: list[Drawn]) -> None:
        if not self._rows:
            shutil.rmtree(self._part, ignore_errors=True)
            (self._part / "images").mkdir(parents=True)
            (self._part / "links").mkdir()
        for drawn in batch:
            (self._part / drawn.row.image).write_bytes(drawn.image)
            (self._part / drawn.row.links).write_bytes(drawn.links)
            self._rows[drawn.row.index] = drawn.row
        if len(self._rows) == self._wanted:
            self._finish()

    def drop(self) -> None:
        """Remove what is not finished."""
        shutil.rmtree(self._part, ignore_errors=True)

    def _finish(self) -> None:
        lines = [to_json(self._rows[i]) + "\n" for i in sorted(self._rows)]
        with open(self._part / "labels.jsonl", "w", encoding="utf-8") as file:
            file.writelines(lines)
            file.flush()
            os.fsync(file.fileno())
        os.replace(self._part, self._final)
        self._rows.clear()


def _batches(manifest: Manifest, shards: list[int], size: int) -> Iterator[range]:
    """Indices of the samples of those shards, a few at a time; no batch crosses shards."""
    for shard in shards:
        indices = manifest.shard_indices(shard)
        for start in range(indices.start, indices.stop, size):
            yield range(start, min(start + size, indices.stop))


def _claim(folder: Path, manifest: Manifest) -> None:
    """Begin a set, or make sure that the one that is there is the same."""
    if not (folder / FILE).exists():
        # Hidden files are our lock, what a kill left of writing, and a file manager's own.
        others = [p for p in folder.iterdir() if not p.name.startswith(".")]
        if others:
            raise DatasetError(f"{folder}: is not empty and holds no set; name a new folder")
        write_manifest(folder, manifest)
    there = read_manifest(folder)
    for field in fields(Manifest):
        old, new = getattr(there, field.name), getattr(manifest, field.name)
        if old != new:
            raise DatasetError(
                f"{folder}: holds a set with {field.name} = {old!r}, not {new!r}; "
                "name another folder, or go on with the settings that it was begun with"
            )
    for part in (folder / "shards").glob("*.part"):
        shutil.rmtree(part, ignore_errors=True)


_LOCK = ".lock"


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Nobody else writes into the folder; the lock goes with the process that holds it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = open(folder / _LOCK, "w")  # noqa: SIM115  # closed below
    except OSError as error:
        raise DatasetError(f"{folder}: cannot be written ({error.strerror})") from None
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DatasetError(
                f"{folder}: is being written by another process; wait for it or name another folder"
            ) from None
        yield
    finally:
        lock.close()


def _disk_error(folder: Path, error: OSError) -> DatasetError:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return DatasetError(
            f"{folder}: the disk is full; finished shards are kept: make room and run the same "
            "command again"
        )
    return DatasetError(f"{folder}: cannot be written ({error.strerror or error})")
