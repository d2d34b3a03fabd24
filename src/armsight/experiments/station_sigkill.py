"""The charging program itself killed by SIGKILL in a phase of a visit, and started again."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from armsight.charging.visit import State

CELL = "ur10_charging"
OUT = 0.05
"""The plug is out when it is so far before the face [m]."""
PATIENCE = 90.0
"""For what a killed program has left [s]."""
HOMEWARD = 20.0
"""For the way to the stand-by, after which nobody waits for it any more [s]."""
WALL = 900.0
"""For one process at most, by the machine's clock [s]."""


def killed(phase: State, when: float, seed: int) -> dict[str, Any]:
    """One kill: whether it ended with the plug safely out.

    Args:
        phase: of the visit.
        when: so long after it began [s], or as it ends.
        seed: of everything random in the cell.
    """
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "station.json"
        before: dict[str, Any] = {}
        began = None
        with _program(file, seed, None) as lines:
            for before in lines:
                began = before["now"] if began is None and _is(before, phase) else began
                due = began is not None and before["now"] >= began + when
                if due or (began is not None and not _is(before, phase)):
                    break
        left = file.exists()
        after: dict[str, Any] = {"words": "it did not start", "state": "", "now": 0.0}
        with _program(file, seed, before.get("world")) as lines:
            for after in lines:
                back = _done(after) and (_home(after) or after["now"] > HOMEWARD)
                if after["state"] == State.STUCK.value or after["now"] > PATIENCE or back:
                    break
        return {
            "phase": phase.value,
            "safe": bool(began is not None and _done(after)),
            "words": after["problems"][-1] if after.get("problems") else after["words"],
            "depth_mm": 1e3 * before.get("depth", -1.0),
            "home": _home(after) and not file.exists(),
            "left": left,
            "seconds": after["now"],
        }


def _is(line: dict[str, Any], phase: State) -> bool:
    return bool(line["state"] == phase.value)


def _home(line: dict[str, Any]) -> bool:
    """It waits where it should, and nothing is under way."""
    return bool(line.get("home", False) and not line["busy"])


def _done(line: dict[str, Any]) -> bool:
    """All that is left is the way home; the plug is out, the arm touched nothing but the port."""
    quiet = line.get("state") == State.STAND_BY.value
    return bool(quiet and line["depth"] < -OUT and line["contacts"] == 0 and line["now"] > 1.0)


@contextmanager
def _program(file: Path, seed: int, world: Any) -> Iterator[Iterator[dict[str, Any]]]:
    """The program and what it says; killed by SIGKILL when nobody listens any more."""
    module = "armsight.experiments.station_process"
    process = subprocess.Popen(  # noqa: S603 - our own words, no shell
        [sys.executable, "-m", module, CELL, str(file), str(seed)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write("" if world is None else json.dumps(world))
        process.stdin.close()
        yield _lines(process)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()


def _lines(process: subprocess.Popen[str]) -> Iterator[dict[str, Any]]:
    assert process.stdout is not None
    end = time.monotonic() + WALL
    for text in process.stdout:
        if time.monotonic() > end:
            return
        yield json.loads(text)
