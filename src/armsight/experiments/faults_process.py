"""A patrol under the wall clock, recorded, with a fault; a program that somebody else may kill.

Run as ``python -m armsight.experiments.faults_process ABOUT``: a JSON file, see :func:`main`.
It says, line by line as JSON, which process its command path is and what time it is by the
session's clock and the computer's; and why its run ended.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.errors import ArmsightError
from armsight.experiments.episodes import packaged_cell
from armsight.experiments.faults_lab import GuardElsewhere, trouble_of
from armsight.experiments.faults_parts import FullDisk, TroubledMap, TroubledTime
from armsight.experiments.wall_loop import behind_drivers
from armsight.recording.recorder import Recorder
from armsight.runtime.config import SessionConfig
from armsight.runtime.parts import MakeParts, Parts, make_parts
from armsight.runtime.remote_arm import RemoteArm
from armsight.runtime.renewed_map import RenewedMap
from armsight.runtime.session import Session
from armsight.tasks.patrol import PatrolTask
from armsight.workcell import open_cell

if TYPE_CHECKING:
    from armsight.workcell import Cell, Workcell

SECONDS = 120.0
"""For which it runs at most [s]."""


def say(**what: Any) -> None:
    """A line for whoever listens."""
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def main(about: dict[str, Any]) -> None:
    """Run the cell until somebody ends the process.

    Args:
        about: ``lab``, ``trouble``: names of shared memory; ``pictures``: folder; ``recording``:
            file; ``seed``; ``case``, ``jump``, ``joint``, ``sign``: what goes wrong.
    """
    workcell = troubled(packaged_cell(), about)
    trouble = trouble_of(about)
    with open_cell(workcell) as cell:
        recorder = Recorder(Path(about["recording"]), cell, pictures="small", wait=False)
        disk = FullDisk(trouble, Path(about["recording"] + ".partial"))
        task = PatrolTask(workcell.goals, workcell.patrol.dwell_s)
        session = Session(
            cell, task, seed=about["seed"], observers=(recorder, disk), make=parts_with(about)
        )
        assert isinstance(cell.arm, RemoteArm)
        say(guard=cell.arm.link.pid, now=cell.clock.now(), host=time.perf_counter())
        try:
            session.run(SECONDS)
        except ArmsightError as error:
            say(ended=str(error))
        else:
            say(ended=session.ended_by)
        finally:
            disk.close()
            recorder.close()


def troubled(workcell: Workcell, about: dict[str, Any]) -> Workcell:
    """The packaged cell with the lab's devices, and what goes wrong with them."""
    placed = behind_drivers(workcell, about["lab"], Path(about["pictures"]))
    module = "armsight.experiments.faults_lab"
    keys = ("trouble", "case", "jump", "joint", "sign")
    more = {key: about[key] for key in keys}

    def changed(section: Any, kind: str) -> Any:
        update = {"driver": f"{module}:{kind}", "connection": section.connection | more}
        return section.model_copy(update=update)

    cameras = list(placed.camera)
    for i in range(len(cameras)):
        if about["case"].startswith("cameras_") or (about["case"].startswith("camera_") and not i):
            cameras[i] = changed(cameras[i], "Camera")
    return placed.model_copy(
        update={"robot": changed(placed.robot, "Arm"), "camera": tuple(cameras)}
    )


def parts_with(about: dict[str, Any]) -> MakeParts:
    """Makes the parts of the session, with what goes wrong in them."""

    def make(cell: Cell, config: SessionConfig) -> Parts:
        parts, trouble = make_parts(cell, config), trouble_of(about)
        assert isinstance(parts.workspace, RenewedMap)
        assert parts.elsewhere is not None
        elsewhere = GuardElsewhere(parts.elsewhere, about)
        true: Any = parts.workspace.make
        if about["case"].startswith("map_"):
            parts.workspace.make = lambda: TroubledMap(true(), trouble, lambda: time.sleep(3600.0))
        if about["case"].startswith("clock_"):
            parts.workspace.make = lambda: TroubledTime(true(), trouble)
        return replace(parts, workspace=RenewedMap(parts.workspace.make), elsewhere=elsewhere)

    return make


def home(workcell: Workcell) -> Any:
    """(n,) where its arm begins [rad]."""
    assert workcell.robot.home_deg is not None
    return np.deg2rad(workcell.robot.home_deg)


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
