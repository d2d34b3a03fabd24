"""The program of a running cell killed by SIGKILL while something else is wrong with it.

Kills come in chains: the program that is killed next is the one that was started again after the
last kill, with the same arm, which stands where its watchdog stopped it.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from armsight.experiments.episodes import packaged_cell
from armsight.experiments.faults_cases import CASES
from armsight.experiments.faults_lab import SIZE, set_trouble
from armsight.experiments.faults_process import home
from armsight.experiments.faults_run import HELD, JUMPS, MOVES
from armsight.experiments.wall_lab import LabArm
from armsight.experiments.wall_loop import record_pictures
from armsight.runtime.shared_block import SharedBlock

Who = Literal["session", "guard", "both"]
WHO: tuple[Who, ...] = ("session", "guard", "both")
"""Whose process is killed: the session's, that of the command path, or both at once."""
LINKS = 6
"""Kills of a chain."""
KILLED = (0.02, 2.0)
"""It is killed between these times after the fault began, evenly in their logarithm [s]."""
STARTS, ENDS = 240.0, 20.0
"""A program has to move the arm, and to be gone, within [s] on a busy machine."""
LOOKS = 1.0
"""After a kill the arm is looked at for so long [s]."""


@dataclass(frozen=True)
class Bench:
    """The lab of a chain: arm and fault in shared memory, and a folder.

    Attributes:
        arm: that outlives the programs; trouble: memory of when the fault began.
        places: of these, for the programs; folder: of their files.
    """

    arm: LabArm
    trouble: SharedBlock
    places: dict[str, str]
    folder: Path

    @property
    def speed(self) -> float:
        """Of its fastest joint now [rad/s]."""
        return float(np.abs(self.arm.joints(time.perf_counter())[1]).max())


def chain(seed: int, number: int) -> list[dict[str, Any]]:
    """Kill after kill, each in another fault; in the end the program runs once more, and well.

    Args:
        seed: of the experiment.
        number: of the chain; as many as fit into the cases have each of them once.
    """
    group, part = divmod(number, len(CASES) // LINKS)
    order = np.random.default_rng((seed, group, 8)).permutation(len(CASES))
    results: list[dict[str, Any]] = []
    with bench() as made:
        for link in range(LINKS):
            case = CASES[int(order[part * LINKS + link])]
            rng = np.random.default_rng((seed, number, link, 9))
            size = math.exp(rng.uniform(*np.log(JUMPS)))
            about = {
                "case": case.name,
                "jump": -size if case.name.endswith("_back") else size,
                "joint": int(rng.integers(6)),
                "sign": float(rng.choice([-1.0, 1.0])),
                "seed": link,
            }
            who = WHO[int(rng.integers(len(WHO)))]
            after = math.exp(rng.uniform(*np.log(KILLED)))
            found = killed(made, f"run{link}", about, who, after)
            if results:
                results[-1]["again"] = found["began"]
            results.append({"case": case.name, "who": who, **found})
        results[-1]["again"] = ends_well(made, f"run{LINKS}", about)
    return results


@contextlib.contextmanager
def bench() -> Iterator[Bench]:
    """A lab, and everything of it gone afterwards."""
    with tempfile.TemporaryDirectory() as name:
        record_pictures(name)
        memory, word = SharedBlock(size=LabArm.needs()), SharedBlock(size=SIZE)
        arm = LabArm(memory)
        arm.place(home(packaged_cell()))
        places = {"lab": memory.name, "trouble": word.name, "pictures": name}
        try:
            yield Bench(arm, word, places, Path(name))
        finally:
            arm.close()
            memory.close()
            word.close()


@contextlib.contextmanager
def program(made: Bench, name: str, about: dict[str, Any]) -> Iterator[subprocess.Popen[str]]:
    """The program of the cell, which records into a folder of this name; killed in the end."""
    folder = made.folder / name
    folder.mkdir()
    file = made.folder / f"{name}.json"
    told = about | made.places | {"recording": str(folder / "run.mcap")}
    file.write_text(json.dumps(told), encoding="utf-8")
    path = os.pathsep.join(p for p in sys.path if p)
    with (made.folder / f"{name}.err").open("wb") as errors:
        process = subprocess.Popen(  # noqa: S603 - our own words, no shell
            [sys.executable, "-m", "armsight.experiments.faults_process", str(file)],
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            env=os.environ | {"PYTHONPATH": path, "ARMSIGHT_RUNTIME_DIR": str(made.folder)},
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def killed(made: Bench, name: str, about: dict[str, Any], who: Who, after: float) -> dict[str, Any]:
    """Run until the arm moves, let the fault begin, kill; what the arm and the files then are."""
    with program(made, name, about) as process:
        assert process.stdout is not None
        told = json.loads(process.stdout.readline() or '{"guard": 0}')
        guard = int(told["guard"])
        if not (guard and _wait(lambda: made.speed > MOVES, STARTS)):
            return {"began": False, "words": last_words(made.folder, name)}
        begin = time.perf_counter()
        set_trouble(made.trouble, begin)
        time.sleep(after)
        was, kill = made.speed, time.perf_counter()
        if who in ("guard", "both"):
            os.kill(guard, signal.SIGKILL)
        if who in ("session", "both"):
            process.kill()
        time.sleep(LOOKS)
        stood = stood_after(made.arm, kill)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(ENDS)
        gone = process.poll() is not None and _wait(lambda: not _alive(guard), ENDS)
        set_trouble(made.trouble, 0.0)
        said = "" if process.poll() is None else process.stdout.read()
    full = begin if about["case"] == "disk" else math.inf
    last, readable = read_recording(made.folder / name / "run.mcap")
    return {
        "began": True,
        "after": after,
        "speed": was,
        "stood": stood,
        "gone": gone,
        "said": said[-300:],
        "lost": told["now"] + min(kill, full) - told["host"] - last,
        "readable": readable,
        "left": sorted(p.name for p in (made.folder / name).iterdir()),
    }


def ends_well(made: Bench, name: str, about: dict[str, Any]) -> bool:
    """Whether the program, nothing wrong any more, moves the arm, records, and ends in order."""
    with program(made, name, about) as process:
        moved = _wait(lambda: made.speed > MOVES or process.poll() is not None, STARTS)
        process.send_signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(ENDS)
        ended = process.poll() == 0
    whole = (made.folder / name / "run.mcap").exists()
    return moved and ended and whole and read_recording(made.folder / name / "run.mcap")[1]


def read_recording(path: Path) -> tuple[float, bool]:
    """The last time in a recording by the session's clock [s], and whether all of it can be read.

    Args:
        path: its name once it is closed; until then ``.partial`` is added.
    """
    from armsight.errors import RecordingError
    from armsight.recording.mcap_file import McapReader

    try:
        with McapReader(_written(path)) as reader:
            count = sum(1 for _ in reader.messages())
            return 1e-9 * reader.span[1], count > 0
    except (RecordingError, OSError):
        return -math.inf, False


def _written(path: Path) -> Path:
    """What there is of a recording: it has its name once it is closed."""
    return path if path.exists() else path.with_name(path.name + ".partial")


def last_words(folder: Path, name: str) -> str:
    """What a program's guard said most often, in shares of its ticks, and its last line of stderr.

    Args:
        folder: of the bench.
        name: of the program there.
    """
    from armsight.errors import RecordingError
    from armsight.recording import messages
    from armsight.recording.mcap_file import McapReader
    from armsight.recording.status_messages import GUARD

    said = Counter[str]()
    try:
        with McapReader(_written(folder / name / "run.mcap")) as reader:
            for _, kind, record in reader.messages(["/guard/status"]):
                told = messages.decode_diagnostics(messages.decode(record.data, kind))[GUARD]
                said[re.sub(r"-?\d+(\.\d+)?", "#", f"{told[2]['mode']} {told[1]}".strip())] += 1
    except (RecordingError, OSError) as error:
        said[str(error)] += 1
    words = [f"{n / said.total():.0%} {what[:120]}" for what, n in said.most_common(4)]
    errors = (folder / f"{name}.err").read_text(encoding="utf-8", errors="replace").strip()
    return "; ".join(words + errors.splitlines()[-1:])


def stood_after(arm: LabArm, since: float) -> float:
    """From a time until the arm stood for good [s]; inf if it does not stand now."""
    now = time.perf_counter()
    last = max(float(arm.commands()[-1]), since)  # before it the formula says nothing any more
    times = np.arange(last, now, 0.002)
    fast = [t for t in times if np.abs(arm.joints(t)[1]).max() >= HELD]
    if np.abs(arm.joints(now)[1]).max() >= HELD:
        return math.inf
    return (fast[-1] if fast else last) - since


def _wait(ask: Callable[[], bool], seconds: float) -> bool:
    """Whether something comes true in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if ask():
            return True
        time.sleep(0.005)
    return False


def _alive(pid: int) -> bool:
    """Whether a process runs."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
    except OSError:
        return False
    return text.rpartition(")")[2].split()[0] != "Z"
