"""Depth frame in memory to velocity command: map and guard, four cameras at 30 Hz, one arm.

Frames are rendered beforehand and handed over one at a time, as staggered cameras deliver them.
Measured is what lies between: the map's update and the guard's tick on the new snapshot. Run it
alone on the machine; the CPU time beside it (all threads) is less disturbed by neighbours. The arm
stands with a goal but no plan, the guard's cheaper case.

Its dearer case are velocities: a task drives the arm to and fro by twists at the same map, with
somebody near, and every tick brings a new one. ``velocity_tick`` is the guard's whole round, as
the wall clock tells it, ``velocity_cpu`` the processor time of its thread.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from armsight.devices.data import JointState, RgbdFrame
from armsight.devices.history import JointHistory
from armsight.motion.intents import JointIntent, VelocityIntent
from armsight.runtime.config import SessionConfig
from armsight.runtime.parts import make_parts
from armsight.simulation.kernels import drive_step
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
        driven, driven_cpu = drive(cell, frames, 300 if report.quick else 6000)
    for name, seconds in (
        ("velocity_tick", driven),
        ("velocity_cpu", driven_cpu),
        ("command_latency", latency),
        ("command_cpu", cpu),
        ("map", mapped),
        ("guard_tick", ticked),
    ):
        ms = np.array(seconds[WARM:]) * 1e3
        low, high = (float(x) for x in np.percentile(ms, [10, 90]))
        budget = {"command_latency": "<= 12", "velocity_tick": "<= 4"}.get(name)
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


def drive(cell, frames, ticks):
    """Seconds of each tick with velocities, on the wall and of the thread, among real hazards."""
    parts = make_parts(cell, SessionConfig())
    history = JointHistory()
    q, v = np.array(cell.robot.home, float), np.zeros(cell.robot.n)
    snapshot = None
    for frame in frames[:16]:
        for back in np.arange(0.1, -0.001, -0.004):
            history.add(JointState(frame.arrival - back, q, v))
        snapshot = parts.workspace.update([frame], history, frame.arrival)
    rng, limits = np.random.default_rng(0), cell.robot.limits
    config = parts.guard.config
    ramp = limits.acceleration * config.acceleration
    sent = [(-1.0, np.zeros(cell.robot.n), True)]
    wall, cpu, twist = [], [], np.zeros(6)
    for k in range(ticks):
        now = frames[16].arrival + k * config.period
        if k % 40 == 0:
            twist = np.concatenate([rng.normal(size=3) * 0.3, rng.normal(size=3) * 0.3])
        seen = tuple(replace(c, stamp=now - 0.05) for c in snapshot.cameras)
        fresh = replace(
            snapshot, sequence=snapshot.sequence + 1 + k, stamp=now, oldest=now - 0.05, cameras=seen
        )
        wish = VelocityIntent("v", twist, "base", now - 0.1, now + 0.1)
        spent, began = time.thread_time(), time.perf_counter()
        decision = parts.guard.step(now, JointState(now, q.copy(), v.copy()), fresh, wish, None)
        wall.append(time.perf_counter() - began)
        cpu.append(time.thread_time() - spent)
        sent.append((now + config.start_delay, decision.command, decision.brake))
        for at in np.arange(now, now + config.period - 1e-9, 0.002):
            while len(sent) > 1 and sent[1][0] <= at:
                sent.pop(0)
            drive_step(
                sent[0][1], sent[0][2], q, v, limits.lower, limits.upper, ramp,
                limits.acceleration, 0.002,
            )  # fmt: skip
    return wall, cpu


if __name__ == "__main__":
    main()
