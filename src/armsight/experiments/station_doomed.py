"""A station's process that is killed by SIGKILL in the midst of a visit, and one that follows it.

A visit under way is forked where a phase begins; the copy goes on to a moment within it and is
killed, and the visit goes on to its next phase. So one visit serves a kill in each of its phases.
What follows is another process that knows nothing but the file; where arm, plug, lid and car stand
in the simulation is handed to it, as real ones would stand where they were left.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from armsight.charging.station import Station
from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import State
from armsight.errors import ArmsightError
from armsight.experiments.charging_visits import FORCE, uncovered
from armsight.experiments.station_bench import StationBench, make_station
from armsight.workcell.schema import Workcell

OUT = 0.05
"""The plug is out when it is so far before the face [m]."""
AT_HOME = 0.05
"""An arm that is so near waits where it should [rad]."""
PATIENCE = 150.0
"""For what a killed process has left [s]."""


@dataclass(frozen=True)
class Left:
    """What a killed process leaves.

    Attributes:
        world: where everything stands, as JSON; file: the station's, None where there is none.
        depth: of the plug below the port's face [m]; state: in which it was killed.
    """

    world: dict[str, Any]
    file: bytes | None
    depth: float
    state: str


def kill_a_copy(
    bench: StationBench, go_on: Callable[[], bool], station: Station, file: Path
) -> Left:
    """Fork this process; the copy goes on while it is told to, then it is killed.

    Args:
        bench: of the visit.
        go_on: one step more of it, and whether it lives on.
        station: of the visit.
        file: that it keeps; put back as it was.

    Raises:
        ArmsightError: the copy ended otherwise.
    """
    before = file.read_bytes() if file.exists() else None
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        _be_killed(bench, go_on, station, write)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        text = pipe.read()
    status = os.waitpid(pid, 0)[1]
    if not (os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL and text):
        raise ArmsightError(f"a copy of the visit ended with status {status}, not by SIGKILL")
    after = file.read_bytes() if file.exists() else None
    if before is None:
        file.unlink(missing_ok=True)
    else:
        file.write_bytes(before)
    told = json.loads(text)
    return Left(told["world"], after, told["depth"], told["state"])


def _be_killed(
    bench: StationBench, go_on: Callable[[], bool], station: Station, write: int
) -> None:
    """The copy's life. What it leaves of the world is told before, so that nothing comes after."""
    try:
        while go_on():
            pass
        told = {
            "world": bench.world.memory.take(),
            "state": station.state.value,
            "depth": max(bench.score()[0], -1.0),
        }
        with os.fdopen(write, "wb") as pipe:
            pipe.write(json.dumps(told).encode())
        os.kill(os.getpid(), signal.SIGKILL)
    finally:
        os._exit(1)  # whatever went wrong: a copy must not go on as if it were the visit


def follow(bench: StationBench, left: Left, file: Path) -> dict[str, Any]:
    """What becomes of it, in this process: does it end with the plug safely out, and home?

    Args:
        bench: a world of the cell in which nothing has happened yet.
        left: what the killed process left.
        file: where the station keeps its own.
    """
    if left.file is not None:
        file.write_bytes(left.file)
    bench.world.memory.put(left.world)
    bench.stop()
    station = make_station(bench, file, SimulatedCar(seconds=2.0))
    ended = bench.run(station, PATIENCE)
    arm = np.asarray(bench.world.memory.take()["joints"][: bench.robot.n])
    away = float(np.abs(arm - bench.robot.home).max())
    words = station.outcomes[-1].problem if station.outcomes else station.words
    depth = bench.score()[0]
    out = bool(depth < -OUT or not np.isfinite(depth))
    lid = bench.world.lid
    force = max(bench.peaks.axial, bench.peaks.lateral)
    touches = bench.world.truth.moving_contacts if lid is None else []  # a finger is to touch
    home = bool(away < AT_HOME and not file.exists())
    return {
        "safe": bool(ended and out and home and force <= FORCE and not uncovered(touches)),
        "words": words,
        "seconds": bench.now,
        "force_n": force,
        "shut": bool(lid.shut) if lid is not None else None,
        "stuck": station.state is State.STUCK,
    }


class FreshProcesses:
    """Processes that know nothing of a visit, each for what one killed process has left.

    They are forked from one that has loaded the code and has the simulation ready, that never was
    part of a visit, and itself comes from a server that has loaded the code and nothing else.

    Args:
        cell: of the visit.
        seed: of the visit: another one's arm has other errors, and holds the plug elsewhere.
    """

    def __init__(self, cell: Workcell, seed: int) -> None:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload([__name__])
        self._talk, its = context.Pipe()
        self._process = context.Process(target=_serve, args=(its, cell, seed))
        self._process.start()
        its.close()

    def __enter__(self) -> FreshProcesses:
        return self

    def __exit__(self, *exception: object) -> None:
        self._talk.close()
        self._process.join()

    def follow(self, left: Left, file: Path) -> dict[str, Any]:
        """See :func:`follow`.

        Raises:
            ArmsightError: the process ended without a word.
        """
        try:
            self._talk.send((left, file))
            found: dict[str, Any] | int = self._talk.recv()
        except EOFError:
            found = -1
        if isinstance(found, int):
            raise ArmsightError(f"a station that was started again ended with status {found}")
        return found


def _serve(talk: Connection, cell: Workcell, seed: int) -> None:
    """Fork a process for each that is asked for."""
    bench = StationBench(cell, seed)
    while True:
        try:
            left, file = talk.recv()
        except EOFError:
            return
        pid = os.fork()
        if pid == 0:
            try:
                talk.send(follow(bench, left, file))
                os._exit(0)
            finally:
                os._exit(1)
        status = os.waitpid(pid, 0)[1]
        if status != 0:
            talk.send(status)
