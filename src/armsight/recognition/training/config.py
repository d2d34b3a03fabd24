"""The file that says what is trained, on what, and how: TOML, every key checked.

::

    paper = "T5"
    network = "multi-objective"
    robots = ["ur3", "ur5", "ur10"]
    seed = 0
    precision = "auto"

    [size]
    width = 256
    height = 212

    [data]
    split = "frame"

    [[stage]]
    name = "all"
    batch = 64
    updates = 8000
    learning_rate = [1e-3, 1e-6]
    loss = { mask = 1.0, joints = 1.5, base = 1.5, type = 0.3 }
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

from armsight.errors import RecognitionError
from armsight.recognition.networks.architecture import Architecture
from armsight.recognition.training.packed_set import By
from armsight.recognition.training.schedule import FALLS, Fall, SaturationRule

Optimiser = Literal["adam", "nesterov"]
Precision = Literal["auto", "float32", "bfloat16"]
PACKAGED = Path(__file__).resolve().parents[1] / "configs"
LOSSES = ("mask", "joints", "base", "type")
AUGMENT: dict[str, type] = {
    "turn_deg": float,
    "roll_deg": float,
    "zoom": float,
    "mirror": bool,
    "colour": float,
    "noise": float,
    "background": float,
}
_MOST_AUGMENT = {
    "turn_deg": 30, "roll_deg": 180, "zoom": 0.5, "mirror": 1, "colour": 0.9, "noise": 0.5,
    "background": 1
}  # fmt: skip


@dataclass(frozen=True)
class Stage:
    """One stretch of training: which layers, by which losses, for how long.

    Attributes:
        name: for people.
        trains: groups of layers that move; empty for all. The others stay bit for bit.
        loss: weight of each loss; those that are not named are not computed.
        true_masks: a cascaded network masks with the truth (T4's coordinate network).
        batch: images of an update.
        updates: at most.
        optimiser: ``adam``, or ``nesterov`` (gradient descent with Nesterov's momentum).
        learning_rate: at the first and at the last update.
        fall: how it gets from one to the other.
        momentum: of ``nesterov``, at the first and at the last update.
        wide_inputs: dense weights of a layer with n inputs move at the learning rate times
            wide_inputs / n where n is larger; 0 for no such care. Adam moves every weight by the
            same step, so that with the papers' 434 000 inputs at 1e-3 the first updates throw
            positions hundreds of metres away.
        saturation: when the stage ends before its last update.
    """

    name: str
    loss: Mapping[str, float]
    trains: tuple[str, ...] = ()
    true_masks: bool = False
    batch: int = 64
    updates: int = 8000
    optimiser: Optimiser = "adam"
    learning_rate: tuple[float, float] = (1e-3, 1e-6)
    fall: Fall = "linear"
    momentum: tuple[float, float] = (0.9, 0.999)
    wide_inputs: int = 0
    saturation: SaturationRule = field(default_factory=SaturationRule)


@dataclass(frozen=True)
class TrainingConfig:
    """Everything that decides what a training learns, but the data.

    Attributes:
        paper: the work that it follows, for people.
        architecture: of the network.
        stages: one after the other.
        seed: of the weights' start, the drawing of samples and the order of batches.
        split: by ``frame`` as the papers, or by ``scene``.
        limit: at most so many training samples of each robot; None for all.
        samples: robots whose samples are trained on; empty for the architecture's.
        precision: ``auto`` is bfloat16 where it pays (a GPU), else float32.
        start_at_mean: outputs in metres begin at the training set's mean, not at the camera.
        augment: how training pictures are changed on the way, empty for not at all, as the papers
            do; the fields of :class:`armsight.recognition.training.augment.Augmentation`.
    """

    paper: str
    architecture: Architecture
    stages: tuple[Stage, ...]
    seed: int = 0
    split: By = "frame"
    limit: int | None = None
    samples: tuple[str, ...] = ()
    precision: Precision = "auto"
    start_at_mean: bool = True
    augment: Mapping[str, float] = field(default_factory=dict)

    @property
    def trained_robots(self) -> tuple[str, ...]:
        """Robots whose samples are trained on."""
        return self.samples or self.architecture.robots

    def to_json(self) -> dict[str, Any]:
        """As JSON values; two configurations that differ in anything differ here."""
        data = asdict(replace(self, stages=(), augment={}))
        data["stages"] = [
            {**asdict(s), "loss": dict(s.loss), "trains": list(s.trains)} for s in self.stages
        ]
        data["architecture"] = self.architecture.to_json()
        data["augment"] = dict(self.augment)
        return data


def config_file(name: str) -> Path:
    """A packaged configuration's file by its name, or the file itself.

    Raises:
        RecognitionError: neither is there; names those that are packaged.
    """
    given = Path(name)
    if given.suffix == ".toml" and given.is_file():
        return given
    packaged = PACKAGED / f"{name}.toml"
    if packaged.is_file() and given.name == name:
        return packaged
    known = ", ".join(sorted(p.stem for p in PACKAGED.glob("*.toml")))
    raise RecognitionError(f'no configuration "{name}": neither a .toml file nor one of {known}')


def read_config(file: Path) -> TrainingConfig:
    """Read a configuration.

    Raises:
        RecognitionError: it cannot be read, or a key is unknown, missing or out of range.
    """
    try:
        text = file.read_bytes().decode()
        data = tomllib.loads(text)
    except OSError as error:
        raise RecognitionError(f"{file}: cannot be read ({error.strerror or error})") from None
    except (ValueError, RecursionError) as error:
        raise RecognitionError(f"{file}: is not TOML ({error})") from None
    try:
        return _config(data)
    except RecognitionError as error:
        raise RecognitionError(f"{file}: {error}") from None


def _config(data: dict[str, Any]) -> TrainingConfig:
    top = _table(
        data,
        "the file",
        {
            "paper": str,
            "network": str,
            "robots": list,
            "seed": int,
            "precision": str,
            "start_at_mean": bool,
            "size": dict,
            "data": dict,
            "augment": dict,
            "stage": list,
        },
        ("network", "robots", "stage"),
    )
    size = _table(
        top.pop("size", {}),
        "[size]",
        {"width": int, "height": int, "filters": float, "dense": float, "pools": int},
    )
    part = _table(top.pop("data", {}), "[data]", {"split": str, "limit": int, "samples": list})
    architecture = Architecture(
        top.pop("network"), tuple(_words(top.pop("robots"), "robots")), **size
    )
    stages = tuple(_stage(s, f"stage {k}") for k, s in enumerate(top.pop("stage"), 1))
    if not stages:
        raise RecognitionError("has no [[stage]], expected at least one")
    samples = tuple(_words(part.get("samples", []), "[data] samples"))
    if not set(samples) <= set(architecture.robots):
        raise RecognitionError("[data] samples names a robot that is not among robots")
    augment = _table(top.pop("augment", {}), "[augment]", AUGMENT)
    for key, value in augment.items():
        _between(value, 0, _MOST_AUGMENT[key], f"[augment] {key}")
    _one_of(part.get("split", "frame"), get_args(By), "[data] split")
    _one_of(top.get("precision", "auto"), get_args(Precision), "precision")
    _between(part.get("limit", 1), 1, 10**9, "[data] limit")
    _between(top.get("seed", 0), 0, 2**31, "seed")
    return TrainingConfig(
        top.pop("paper", ""),
        architecture,
        stages,
        split=part.get("split", "frame"),
        limit=part.get("limit"),
        samples=samples,
        augment=augment,
        **top,
    )


def _stage(data: object, where: str) -> Stage:
    table = _table(
        data,
        where,
        {
            "name": str,
            "loss": dict,
            "trains": list,
            "true_masks": bool,
            "batch": int,
            "updates": int,
            "optimiser": str,
            "learning_rate": list,
            "fall": str,
            "momentum": list,
            "wide_inputs": int,
            "saturation": dict,
        },
        ("name", "loss"),
    )
    loss = _table(table["loss"], f"{where}: loss", dict.fromkeys(LOSSES, float))
    if not loss or not all(0 < w <= 1000 for w in loss.values()):
        raise RecognitionError(f"{where}: loss weights must be above 0, expected at least one")
    _one_of(table.get("optimiser", "adam"), get_args(Optimiser), f"{where}: optimiser")
    _one_of(table.get("fall", "linear"), FALLS, f"{where}: fall")
    _between(table.get("batch", 1), 1, 65536, f"{where}: batch")
    _between(table.get("updates", 1), 1, 10**8, f"{where}: updates")
    _between(table.get("wide_inputs", 0), 0, 10**8, f"{where}: wide_inputs")
    table["loss"] = loss
    table["trains"] = tuple(_words(table.get("trains", []), f"{where}: trains"))
    for name, most in (("learning_rate", 10.0), ("momentum", 0.9999)):
        if name in table:
            table[name] = _ends(table[name], f"{where}: {name}", most)
    rule = _table(
        table.pop("saturation", {}),
        f"{where}: saturation",
        {"window": int, "patience": int, "gain": float},
    )
    _between(rule.get("window", 0), 0, 10**8, f"{where}: saturation window")
    _between(rule.get("patience", 1), 1, 10**6, f"{where}: saturation patience")
    _between(rule.get("gain", 0.0), 0, 0.99, f"{where}: saturation gain")
    return Stage(**{**table, "saturation": SaturationRule(**rule)})


def _table(
    data: object, where: str, keys: Mapping[str, type], needed: tuple[str, ...] = ()
) -> dict[str, Any]:
    """A table with these keys only, each of its type (a float may be written as a whole number)."""
    if not isinstance(data, dict):
        raise RecognitionError(f"{where} is {data!r}, expected a table")
    for key in data:
        if key not in keys:
            raise RecognitionError(f'{where}: unknown key "{key}", known: {", ".join(keys)}')
    for key in needed:
        if key not in data:
            raise RecognitionError(f'{where}: "{key}" is missing')
    for key, value in data.items():
        kind = keys[key]
        fits = isinstance(value, kind) or (kind is float and isinstance(value, int))
        if not fits or (isinstance(value, bool) and kind is not bool):
            raise RecognitionError(f"{where}: {key} is {value!r}, expected {kind.__name__}")
        if isinstance(value, float) and not math.isfinite(value):
            raise RecognitionError(f"{where}: {key} is {value}, expected a number")
    return dict(data)


def _words(values: list[Any], where: str) -> list[str]:
    if not all(isinstance(v, str) for v in values):
        raise RecognitionError(f"{where} is {values!r}, expected names")
    return values


def _ends(values: list[Any], where: str, most: float) -> tuple[float, float]:
    if len(values) != 2 or not all(
        isinstance(v, int | float) and not isinstance(v, bool) and 0 < v <= most for v in values
    ):
        raise RecognitionError(f"{where} is {values!r}, expected two numbers above 0, to {most}")
    return float(values[0]), float(values[1])


def _one_of(value: str, known: tuple[str, ...], where: str) -> None:
    if value not in known:
        raise RecognitionError(f'{where} is "{value}", expected one of {", ".join(known)}')


def _between(value: float, low: float, high: float, where: str) -> None:
    if not low <= value <= high:
        raise RecognitionError(f"{where} is {value}, expected {low} to {high}")
