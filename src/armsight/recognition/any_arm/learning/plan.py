"""The file that says how the crop network is trained: TOML, every key checked."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from armsight.errors import RecognitionError
from armsight.recognition.data.sample import KNOWN_ROBOTS

KIND = "crop"
"""``network`` of such a file."""


@dataclass(frozen=True)
class Plan:
    """A training.

    Attributes:
        robots: that are told apart.
        updates: in all; the rate falls over the last third of them. A training that was stopped
            may go on with more or fewer.
        size: side of the crops that are learned from [px], a multiple of 32; it may change, too:
            small crops teach more in the same time, large ones find finer places.
        batch: crops an update.
        rate: greatest learning rate of the new layers; trunk_rate: of the pretrained ones.
        decay: of the weights.
        mean: share of the running mean of the weights that an update keeps.
        frozen: so many blocks of the trunk keep their weights, and the stem; -1: none.
        validate: updates between measurements on rooms held back.
        patience: measurements without a gain that end the training; 0: none do.
        blend: share of what was learned in the weights that are written; the rest is of the
            network that the training began from (Wortsman et al. 2022, "Robust fine-tuning of
            zero-shot models"): the two lie in one valley, and what lies between them does
            better on pictures that neither has seen than either.
        precision: ``auto`` (bfloat16 on a GPU), ``float32`` or ``bfloat16``.
        seed: of the start, the order and the changes.
    """

    robots: tuple[str, ...] = KNOWN_ROBOTS
    updates: int = 12000
    size: int = 128
    batch: int = 16
    rate: float = 1e-3
    trunk_rate: float = 3e-4
    decay: float = 1e-4
    mean: float = 0.996
    frozen: int = 3
    validate: int = 500
    patience: int = 12
    blend: float = 1.0
    precision: str = "auto"
    seed: int = 0

    def rate_at(self, update: int) -> float:
        """The share of the greatest rates at an update: a rise, a plain, a fall to 3 %."""
        rise = min((update + 1) / 60, 1.0)
        left = (self.updates - update) / (0.35 * self.updates)
        return rise * max(min(left, 1.0), 0.03)


_RANGES = {
    "updates": (1, 10**8), "size": (32, 1024), "batch": (1, 65536), "rate": (0, 1),
    "trunk_rate": (0, 1), "decay": (0, 1), "mean": (0, 0.99999), "blend": (0, 1),
    "frozen": (-1, 16), "validate": (1, 10**8), "patience": (0, 10**6), "seed": (0, 2**31),
}  # fmt: skip


def is_plan(file: Path) -> bool:
    """Whether a configuration is one of the crop network (and not of a paper's)."""
    return _read(file).get("network") == KIND


def read_plan(file: Path) -> Plan:
    """Read a plan.

    Raises:
        RecognitionError: it cannot be read, or a key is unknown or out of range.
    """
    data = _read(file)
    if data.pop("network", None) != KIND:
        raise RecognitionError(f'{file}: network is not "{KIND}"')
    known = {f.name: type(f.default) for f in fields(Plan)}
    for key, value in data.items():
        if key not in known:
            raise RecognitionError(f'{file}: unknown key "{key}", known: {", ".join(known)}')
        if key in _RANGES:
            low, high = _RANGES[key]
            real = isinstance(value, float) and known[key] is float
            number = isinstance(value, int) or real
            if not number or isinstance(value, bool) or not low <= value <= high:
                raise RecognitionError(f"{file}: {key} is {value!r}, expected {low} to {high}")
    robots = data.pop("robots", list(KNOWN_ROBOTS))
    if (
        not isinstance(robots, list)
        or not robots
        or not all(isinstance(r, str) and r.isidentifier() for r in robots)
        or len(set(robots)) != len(robots)
    ):
        raise RecognitionError(f"{file}: robots is {robots!r}, expected names, each once")
    if int(str(data.get("size", 128))) % 32:
        raise RecognitionError(f"{file}: size is {data['size']}, expected a multiple of 32")
    if data.get("precision", "auto") not in ("auto", "float32", "bfloat16"):
        raise RecognitionError(f"{file}: precision is neither auto, float32 nor bfloat16")
    plan = Plan(robots=tuple(robots), **data)
    assert all(math.isfinite(v) for v in (plan.rate, plan.trunk_rate))
    return plan


def _read(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_bytes().decode())
    except OSError as error:
        raise RecognitionError(f"{file}: cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise RecognitionError(f"{file}: is no TOML file ({error})") from None
