"""Which network, for which robots, of which size: everything that fixes the shapes of its weights.

Sizes other than the papers' make the same network smaller: ``filters`` scales the filters of every
convolution, ``dense`` the units of every hidden dense layer, and the input can be smaller.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from armsight.errors import RecognitionError

Kind = Literal["cascaded", "multi-objective"]
KINDS: tuple[str, ...] = get_args(Kind)

JOINTS: dict[str, int] = {"ur3": 6, "ur5": 6, "ur10": 6, "iiwa": 7, "panda": 7}
"""Joints of each robot that the papers' networks know."""
PAPER_WIDTH, PAPER_HEIGHT = 256, 212
"""Input of T4 to T7 [px], half of the Kinect v2's 512 x 424."""
_LARGEST_SIDE = 1024


@dataclass(frozen=True)
class Architecture:
    """What fixes a network's weights' shapes.

    Attributes:
        kind: ``cascaded`` (T4) or ``multi-objective`` (T5 to T7).
        robots: types that it knows, in the order of its type output; T4's has one.
        width, height: of its input [px].
        filters: share of the papers' 32, 64, 128 filters.
        dense: share of the papers' 500 (T4) or 1024 and 512 (T5) dense units.
        pools: 2 x 2 poolings before each dense layer, 2 or 3.
    """

    kind: Kind
    robots: tuple[str, ...]
    width: int = PAPER_WIDTH
    height: int = PAPER_HEIGHT
    filters: float = 1.0
    dense: float = 1.0
    pools: int = 2

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise RecognitionError(f'network "{self.kind}" is unknown; known: {", ".join(KINDS)}')
        unknown = [r for r in self.robots if r not in JOINTS]
        if unknown or not self.robots or len(set(self.robots)) != len(self.robots):
            raise RecognitionError(
                f"robots are {list(self.robots)}, expected different ones of {', '.join(JOINTS)}"
            )
        if self.kind == "cascaded" and len(self.robots) != 1:
            raise RecognitionError(
                f"a cascaded network knows one robot (T4), not {len(self.robots)}; train one each"
            )
        if self.pools not in (2, 3):
            raise RecognitionError(f"pools is {self.pools}, expected 2 or 3")
        smallest = 2**self.pools
        if not all(smallest <= n <= _LARGEST_SIDE for n in (self.width, self.height)):
            raise RecognitionError(
                f"input of {self.width} x {self.height} pixels, expected {smallest} to "
                f"{_LARGEST_SIDE} each way"
            )
        if not (0.03 <= self.filters <= 4 and 0.01 <= self.dense <= 4):
            raise RecognitionError(
                f"filters {self.filters} and dense {self.dense} scale the papers' network, "
                "expected 0.03 to 4 and 0.01 to 4"
            )

    @property
    def joints(self) -> int:
        """Joints that the network answers for; robots of fewer leave the last ones unused."""
        return max(JOINTS[r] for r in self.robots)

    def scaled_filters(self, count: int) -> int:
        """Filters of a convolution that has ``count`` in the papers."""
        return max(1, round(self.filters * count))

    def scaled_dense(self, count: int) -> int:
        """Units of a dense layer that has ``count`` in the papers."""
        return max(1, round(self.dense * count))

    def pooled(self) -> tuple[int, int]:
        """Height and width after all poolings [px]."""
        return self.height >> self.pools, self.width >> self.pools

    def to_json(self) -> dict[str, Any]:
        """As JSON values."""
        return {**asdict(self), "robots": list(self.robots)}

    @classmethod
    def from_json(cls, data: object) -> Architecture:
        """The architecture of JSON values that came from outside.

        Raises:
            RecognitionError: something is missing, unknown or absurd.
        """
        if not isinstance(data, dict) or set(data) != set(cls.__dataclass_fields__):
            raise RecognitionError("the description of a network lacks or invents a field")
        robots = data["robots"]
        if not isinstance(robots, list) or not all(isinstance(r, str) for r in robots):
            raise RecognitionError("the description of a network has no list of robots")
        for name, kind in {
            "kind": str,
            "width": int,
            "height": int,
            "filters": int | float,
            "dense": int | float,
            "pools": int,
        }.items():
            if not isinstance(data[name], kind) or isinstance(data[name], bool):
                raise RecognitionError(f"the description of a network has {name} {data[name]!r}")
        return cls(**{**data, "robots": tuple(robots)})


def read_description(
    file: Path, words: dict[str, str], cure: str
) -> tuple[Architecture, dict[str, Any]]:
    """The architecture and the card that a network's file carries as JSON.

    Args:
        file: for the message.
        words: text of the file by name.
        cure: what to do about a damaged card.

    Raises:
        RecognitionError: they are missing, damaged or absurd.
    """
    try:
        architecture = Architecture.from_json(json.loads(words["architecture"]))
        card = json.loads(words["card"])
    except (KeyError, ValueError, RecursionError):
        raise RecognitionError(f"{file}: its card is damaged; {cure}") from None
    except RecognitionError as error:
        raise RecognitionError(f"{file}: {error}") from None
    if not isinstance(card, dict):
        raise RecognitionError(f"{file}: its card is damaged; {cure}")
    return architecture, card


@dataclass(frozen=True)
class LayerCount:
    """Weights and multiply-accumulates of one layer."""

    name: str
    weights: int
    macs: int


def count_layers(architecture: Architecture) -> tuple[LayerCount, ...]:
    """Weights and multiply-accumulates of every layer, counted from the shapes alone."""
    a = architecture
    f32, f64, f128 = (a.scaled_filters(n) for n in (32, 64, 128))
    full, half, quarter = ((a.height >> k) * (a.width >> k) for k in range(3))
    pooled = a.pooled()[0] * a.pooled()[1]

    def conv(name: str, inputs: int, outputs: int, side: int, pixels: int) -> LayerCount:
        macs = inputs * outputs * side * side
        return LayerCount(name, macs + outputs, macs * pixels)

    def dense(name: str, inputs: int, outputs: int) -> LayerCount:
        return LayerCount(name, inputs * outputs + outputs, inputs * outputs)

    if a.kind == "cascaded":
        units = a.scaled_dense(500)
        return (
            conv("mask 1", 3, f32, 3, full),
            *(conv(f"mask {k}", f32, f32, 3, full) for k in (2, 3, 4)),
            conv("mask output", f32, 1, 3, full),
            conv("coordinates 1", 3, f32, 3, full),
            conv("coordinates 2", f32, f64, 3, half),
            conv("coordinates 3", f64, f128, 2, quarter),
            dense("coordinates dense", f128 * pooled, units),
            dense("coordinates output", units, 3 * (1 + a.joints)),
        )
    units, head = a.scaled_dense(1024), a.scaled_dense(512)
    return (
        conv("common", 3, f32, 3, full),
        *(conv(f"mask {k}", f32, f32, 3, full) for k in (2, 3, 4)),
        conv("mask output", f32, 1, 3, full),
        conv("second 2", f32, f32, 3, half),
        conv("second 3", f32, f64, 3, quarter),
        conv("second 4", f64, f128, 2, quarter),
        dense("dense second", f128 * pooled, units),
        dense("dense side", f32 * pooled, units),
        *(dense(f"dense {name}", units, head) for name in ("joints", "base", "type")),
        dense("output joints", head, 3 * a.joints),
        dense("output base", head, 3),
        dense("output type", head, len(a.robots)),
    )
