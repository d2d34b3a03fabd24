"""Depth frame in memory to velocity command: map and guard, four cameras at 30 Hz, one arm.

Frames are rendered beforehand and handed over one at a time, as staggered cameras deliver them.
Measured is what lies between: the map's update and the guard's tick on the new snapshot. Run it
alone on the machine; the CPU time beside it (all threads) is less disturbed by neighbours. The arm
stands with a goal but no plan, the guard's cheaper case.
"""

from __future__ import annotations

import time

import numpy as np

from armsight.devices.data import JointState, RgbdFrame
from armsight.devices.history import JointHistory
from armsight.motion.intents import JointIntent
from armsight.runtime.config import SessionConfig
from armsight.runtime.parts import make_parts
from armsight.workcell import load_workcell, open_cell
from armsight.workcell.packaged import packaged
from common import Report

RATE = 30.0
WARM = 40


def main() -> None:
    """Render, replay, report."""
    report = Report("guard", __doc__)
    rounds = 150 if report.quick else 4000
    workcell = load_workcell(packaged()["ur5_four_cameras"])
    faster = tuple(c.model_copy(update={"rate_hz": RATE}) for c in workcell.camera)
    workcell = workcell.model_copy(update={"camera": faster})
    with open_cell(workcell) as cell:
        frames = record(cell, 0.6 if report.quick else 2.0)
        parts = make_parts(cell, SessionConfig())
        latency, mapped, ticked, cpu = replay(cell, parts, frames, rounds)
    for name, seconds in (
        ("command_latency", latency),
        ("command_cpu", cpu),
        ("map", mapped),
        ("guard_tick", ticked),
    ):
        ms = np.array(seconds[WARM:]) * 1e3
        low, high = (float(x) for x in np.percentile(ms, [10, 90]))
        budget = "<= 15" if name == "command_latency" else None
        report.add(f"{name}_p50_ms", float(np.median(ms)), "ms", spread=(low, high))
        report.add(f"{name}_p99_ms", float(np.percentile(ms, 99)), "ms", must=budget)
    report.finish()


def record(cell, seconds: float) -> list[RgbdFrame]:
    """Frames of all cameras while the arm stands at home, in the order of their arrival."""
    frames = []
    for now in np.arange(0.004, seconds, 0.004):
        cell.world.advance(float(now))
        frames += [f for f in (camera.read() for camera in cell.cameras) if f is not None]
    return frames


def replay(cell, parts, frames, rounds):
    """Seconds of each round: whole, map, guard on the wall; whole of the processors."""
    history = JointHistory()
    home, zero = np.asarray(cell.robot.home, float), np.zeros(cell.robot.n)
    goal = JointIntent("A", next(iter(cell.workcell.goals.values())))
    whole, mapped, ticked, cpu = [], [], [], []
    for k in range(rounds):
        turn, index = divmod(k, len(frames))
        frame = frames[index]
        shift = turn * (frames[-1].stamp - frames[0].stamp + 1.0 / (4.0 * RATE))
        now = frame.arrival + shift
        for back in np.arange(0.1, -0.001, -0.004):
            history.add(JointState(now - back, home, zero))
        fresh = RgbdFrame(frame.camera, k, frame.stamp + shift, now, frame.depth)
        spent = time.process_time()
        began = time.perf_counter()
        snapshot = parts.workspace.update([fresh], history, now)
        between = time.perf_counter()
        parts.guard.step(now, JointState(now, home, zero), snapshot, goal, None)
        ended = time.perf_counter()
        cpu.append(time.process_time() - spent)
        whole.append(ended - began)
        mapped.append(between - began)
        ticked.append(ended - between)
    return whole, mapped, ticked, cpu


if __name__ == "__main__":
    main()
