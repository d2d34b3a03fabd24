"""Which options of ``armsight calibrate`` belong to which way of calibrating.

An option that would be ignored is refused: whoever gave it believes that it does something.
"""

from __future__ import annotations

from dataclasses import MISSING, Field, fields
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armsight.commands.calibrate import Calibrate

_ALL = {"workcell", "write", "seed", "headless"}
_LIVE = {*_ALL, "cell_is_empty", "page"}
USED: dict[str, set[str]] = {
    "--from": _ALL
    | {"from_", "out", "board", "lens", "keep_lenses", "hand", "beside", "compare", "second_arm"}
    | {"robot", "camera", "force"},
    "--plug": _LIVE | {"plug", "out", "camera", "views", "fresh"},
    "--sphere": _LIVE | {"sphere", "force"},
    "--wrist": _LIVE | {"wrist"},
    "--markerless": _LIVE | {"markerless", "camera", "force"},
    "a live calibration": _LIVE
    | {"out", "board", "keep_lenses", "goal_mm", "views", "paper", "fresh", "force"},
}
"""Options of each way; the first way that is asked for is meant."""
INSTEAD = {
    ("--sphere", "out"): "what is found goes into the cell's calibration file",
    ("--markerless", "out"): "what is found goes into the cell's calibration file",
    ("--wrist", "out"): "what is found goes into the cell's calibration file",
    ("--wrist", "force"): "what is found goes into the cell's calibration file",
    ("--plug", "force"): "what is found goes into the cell's calibration file",
    ("a live calibration", "camera"): "it goes with --markerless, --plug or --from",
    (
        "a live calibration",
        "lens",
    ): "it goes with --from; 'armsight calibration import' reads it",
}


def refuse_unused(asked: Calibrate) -> None:
    """Refuse options that the way asked for does not use, and numbers that cannot be.

    Raises:
        UsageError: names the first of them.
    """
    from armsight.errors import UsageError

    given = {f.name for f in fields(asked) if getattr(asked, f.name) != _default(f)}
    if not given & {"workcell", "from_"}:
        raise UsageError(
            "calibrate: give a workcell to calibrate live, or --from FOLDER for a recorded set"
        )
    way = next((w for w in USED if _flag(w) in given), "a live calibration")
    for name in (f.name for f in fields(asked) if f.name in given - USED[way]):
        why = INSTEAD.get((way, name), "leave it out")
        raise UsageError(f"calibrate: {_option(name)} does nothing with {way}: {why}")
    if way != "--from" and asked.workcell is None:
        raise UsageError(f"calibrate: {way} needs a cell: name its file")
    if way == "--from" and asked.camera is not None and asked.workcell is None:
        raise UsageError(
            "calibrate: --camera says whose pictures the set has: name the workcell file, too"
        )
    if asked.views < 3:
        raise UsageError(f"calibrate: --views is {asked.views}; expected 3 or more")
    if not asked.goal_mm > 0.0:
        raise UsageError(f"calibrate: --goal-mm is {asked.goal_mm:g}; expected more than 0")


def _default(field: Field[Any]) -> Any:
    return field.default if field.default_factory is MISSING else field.default_factory()


def _flag(way: str) -> str:
    return {"--from": "from_"}.get(way, way.removeprefix("--"))


def _option(name: str) -> str:
    return {"from_": "--from", "write": "--no-write"}.get(name, "--" + name.replace("_", "-"))
