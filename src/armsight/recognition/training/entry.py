"""From the words of a command line to a training; shared by ``armsight`` and the bare machine."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from armsight.errors import RecognitionError, UsageError
from armsight.recognition.training.config import TrainingConfig, config_file, read_config
from armsight.recognition.training.packed_set import PackedSet, read_packed_set

TORCH_IS_MISSING = (
    "training needs PyTorch, which armsight does not install by itself: "
    "'.venv/bin/python -m pip install torch' in armsight's folder takes the build for your GPU "
    "(on a machine without one, add --index-url https://download.pytorch.org/whl/cpu)"
)


def read(name: str, seed: int | None, limit: int | None) -> TrainingConfig:
    """A configuration by its name or file, with what the command line says otherwise."""
    config = read_config(config_file(name))
    if seed is not None:
        config = replace(config, seed=checked_seed(seed))
    if limit is not None:
        if limit < 1:
            raise UsageError(f"--samples is {limit}, expected at least 1")
        config = replace(config, limit=limit)
    return config


def checked_seed(seed: int) -> int:
    """The seed.

    Raises:
        UsageError: it is none that a training can begin from.
    """
    if not 0 <= seed <= 2**31:
        raise UsageError(f"--seed is {seed}, expected 0 to 2147483648")
    return seed


def check_machine(minutes: float | None, threads: int) -> None:
    """See that time and threads can be had.

    Raises:
        UsageError: they cannot; so many threads only fill the memory.
    """
    if minutes is not None and not minutes >= 0:  # NaN, too
        raise UsageError(f"--minutes is {minutes:g}, expected 0 or more")
    if not 0 <= threads <= 1024:
        raise UsageError(f"--threads is {threads}, expected 0 (torch's choice) to 1024")


def packed(folder: Path, config: TrainingConfig) -> PackedSet:
    """The data at the network's size: a packed set, or a labelled set that is packed beside it.

    A labelled set is packed once, into ``packed-WIDTHxHEIGHT`` in its own folder.

    Raises:
        RecognitionError: there is neither, or it is damaged.
    """
    if any(folder.glob("pack-*.safetensors")):
        return read_packed_set(folder)
    a = config.architecture
    place = folder / f"packed-{a.width}x{a.height}"
    if any(place.glob("pack-*.safetensors")):
        return read_packed_set(place)
    pack_into(folder, place, a.width, a.height)
    return read_packed_set(place)


def pack_into(source: Path, place: Path, width: int, height: int, partial: bool = False) -> None:
    """Pack a labelled set; the pieces appear together or not at all.

    Raises:
        RecognitionError: no labelled set, or it cannot be written.
    """
    try:
        from armsight.recognition.data.labelled_set import LabelledSet
        from armsight.recognition.training.packing import pack
    except ImportError as error:
        raise RecognitionError(
            f"{source}: has no pack-*.safetensors, and a labelled set cannot be read here "
            f"({error}); pack it on a machine with all of armsight: armsight train --pack"
        ) from None
    if any(place.glob("pack-*.safetensors")):
        raise RecognitionError(f"{place}: holds a packed set already; delete it, or name another")
    part = place.with_name(f"{place.name}.part")
    for old in part.glob("pack-*.safetensors"):
        old.unlink()
    count = pack(LabelledSet.open(source, partial), part, width, height, progress=_packing)
    try:
        if place.is_dir():
            place.rmdir()
        part.rename(place)
    except OSError as error:
        raise RecognitionError(
            f"{place}: cannot be written ({error.strerror}); the pieces are in {part}"
        ) from None
    print(f"packed {count} samples of {width} x {height} px into {place}", file=sys.stderr)


def _packing(done: int, whole: int) -> None:
    if sys.stderr.isatty():
        print(f"\r\x1b[Kpacking {done}/{whole}", end="", file=sys.stderr, flush=True)


def need_torch() -> None:
    """See that torch is there.

    Raises:
        RecognitionError: it is not; says how to get it.
    """
    import importlib.util

    if importlib.util.find_spec("torch") is None:
        raise RecognitionError(TORCH_IS_MISSING)


def say(words: str) -> None:
    """One line of progress that replaces the last one on a terminal."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{words[:200]}", end="", file=sys.stderr, flush=True)
    elif words:
        print(words, file=sys.stderr, flush=True)
