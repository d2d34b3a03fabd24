"""One trial of plugging in: a UR10, a plug in its mount, a socket, and a controller between."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armsight.arrays import Floats, JointVector, Pose
from armsight.charging.insert import Answer, Felt, Insertion, InsertOptions, Phase
from armsight.charging.insert_paper import PaperInsertion
from armsight.charging.ports.collision import plug_contours, socket_contours
from armsight.charging.ports.table import PORTS
from armsight.geometry.pose import exp, from_rpy, inverse, log, make_pose
from armsight.robots import load_robot
from armsight.robots.kinematics import flange_jacobian, flange_pose
from armsight.robots.robot import Robot
from armsight.simulation.plugging import PlugBench, PlugSetup

TICK = 8
"""Milliseconds between two commands: 125 Hz."""
T_FLANGE_PLUG = make_pose(None, [0.0, 0.0, 0.20])
T_PORT_PLUG = make_pose(np.diag([-1.0, 1.0, -1.0]))
"""A plug before a port: the same up, looking at each other."""
PLUG_OF = {"type1": "type1_plug", "type2": "type2_plug", "ccs2": "ccs2_plug"}


@dataclass(frozen=True)
class Trial:
    """One situation.

    Attributes:
        port: type of the inlet.
        lateral, tilt, roll, depth: how far the belief of the port is off [m], [rad], [rad], [m].
        direction: (2,) of the lateral error and of the tilt's axis [rad].
        clearance, chamfer: [m]; friction; contacts: friction of mated contacts [N].
        cable: [N]; delay: [s].
        height, yaw: of the port before the arm [m], [rad].
        seed: of the sensor.
    """

    port: str
    lateral: float
    tilt: float
    roll: float
    depth: float
    direction: tuple[float, float]
    clearance: float
    chamfer: float
    friction: float
    contacts: float
    cable: float
    delay: float
    height: float
    yaw: float
    seed: int


def draw(rng: np.random.Generator, lateral: float, tilt_deg: float) -> Trial:
    """A random trial with errors of a given size."""
    return Trial(
        ("type1", "type2", "ccs2")[int(rng.integers(3))],
        lateral,
        float(np.deg2rad(tilt_deg)),
        float(np.deg2rad(rng.normal(0.0, 0.4))),
        float(rng.normal(0.0, 0.3e-3)),
        (float(rng.uniform(0, 2 * np.pi)), float(rng.uniform(0, 2 * np.pi))),
        float(rng.uniform(0.3e-3, 0.6e-3)),
        float(rng.uniform(1.5e-3, 2.0e-3)),
        float(rng.uniform(0.1, 0.4)),
        float(rng.uniform(10.0, 35.0)),
        float(rng.uniform(10.0, 30.0)),
        0.06,
        float(rng.uniform(0.45, 0.8)),
        float(np.deg2rad(rng.uniform(-10, 10))),
        int(rng.integers(2**31)),
    )


def run_trial(
    trial: Trial,
    paper: bool = False,
    unplug: bool = True,
    options: InsertOptions | None = None,
    trace: list[tuple[Any, ...]] | None = None,
) -> dict[str, Any]:
    """Plug in, and out again where it was plugged in; scored by the truth."""
    plug = PORTS[PLUG_OF[trial.port]]
    options = replace(options or InsertOptions(), depth=plug.depth)
    robot = load_robot("ur10")
    T_world_port = make_pose([[0, 0, -1], [-1, 0, 0], [0, 1, 0]], [0.95, 0.16, trial.height])
    T_world_port = T_world_port @ from_rpy((0.0, trial.yaw, 0.0))
    contours = plug_contours(plug)
    socket = socket_contours(plug, trial.clearance, trial.chamfer, plug.depth)
    # what is believed of the port is off by the trial's errors
    a, b = trial.direction
    off = np.array([trial.lateral * np.cos(a), trial.lateral * np.sin(a), trial.depth, 0, 0, 0])
    off[3:] = trial.tilt * np.cos(b), trial.tilt * np.sin(b), trial.roll
    front = T_world_port @ T_PORT_PLUG @ exp(off)
    believed = front @ make_pose(None, [0, 0, plug.depth])
    start = front @ make_pose(None, [0, 0, -0.015])
    q = joints_at(robot, start @ inverse(T_FLANGE_PLUG))
    setup = PlugSetup(
        T_world_port,
        T_FLANGE_PLUG,
        socket.boxes,
        socket.half,
        contours.capsules,
        contours.radius,
        friction=trial.friction,
        contacts=trial.contacts,
        cable=trial.cable,
        delay=trial.delay,
        bias=tuple(np.random.default_rng(trial.seed).normal(0, [2, 2, 2, 0.1, 0.1, 0.1])),
    )
    bench = PlugBench(robot, setup, q, trial.seed)
    # the plug hangs in its soft mount as its weight and cable will have it; the calibration, whose
    # marker it is, has seen it so
    for again in range(3):
        for _ in range(400):
            bench.step()
        hung = inverse(flange_pose(robot, bench.q)) @ T_world_port @ bench.truth()[0]
        if again < 2:
            bench.place(joints_at(robot, start @ inverse(hung), bench.q))
    tare = np.mean([bench.wrench() for _ in range(40)], axis=0)
    law = PaperInsertion(options) if paper else Insertion(options)
    result = _drive(bench, robot, law, believed, hung, tare, trace)
    inside, _ = bench.truth()
    depth, tilt = _score(inside)
    full = depth > plug.depth - 1e-3 and tilt < np.deg2rad(2.0)
    said = law.phase is Phase.SEATED
    result |= {"port": trial.port, "full": bool(full), "said": said, "words": law.words}
    result |= {"true_depth": depth, "true_tilt": tilt, "tries": law.tries}
    result["partial_as_success"] = bool(said and not full)
    if unplug and said and not paper:
        leave = Insertion(options, out=True)
        back = _drive(bench, robot, leave, believed, hung, tare, trace)
        result |= {"unplugged": leave.phase is Phase.OUT, "unplug_n": back["pulled_n"]}
        result["unplug_s"] = back["seconds"]
    return result


def _score(inside: Pose) -> tuple[float, float]:
    """Depth of the plug's front below the face [m] and its tilt [rad], by the truth."""
    tilt = float(np.arccos(np.clip(-inside[2, 2], -1.0, 1.0)))
    return float(-inside[2, 3]), tilt


def _drive(
    bench: PlugBench,
    robot: Robot,
    law: Insertion | PaperInsertion,
    believed: Pose,
    T_flange_plug: Pose,
    tare: Floats,
    trace: list[tuple[Any, ...]] | None,
) -> dict[str, Any]:
    axial = lateral = pulled = sunk = 0.0
    begun = bench.time
    while bench.time - begun < 45.0:
        q = bench.q
        flange = flange_pose(robot, q)
        T_seat_plug = inverse(believed) @ flange @ T_flange_plug
        felt = Felt(bench.time, T_seat_plug, at_plug(bench.wrench() - tare, T_flange_plug))
        answer: Answer = law.step(felt)
        bench.command(joint_rates(robot, q, answer.twist, T_flange_plug))
        for _ in range(TICK):
            bench.step()
        _, force = bench.truth()
        axial = max(axial, abs(float(force[2])))
        pulled = max(pulled, -float(force[2]))
        lateral = max(lateral, float(np.hypot(force[0], force[1])))
        sunk = max(sunk, bench.penetration())
        if trace is not None:
            inside, _ = bench.truth()
            trace.append((bench.time, law.phase.value, *_score(inside), *inside[:2, 3], *force))
        if law.phase in (Phase.SEATED, Phase.OUT, Phase.FAILED):
            break
    bench.command(np.zeros(robot.n))
    for _ in range(200):
        bench.step()
    return {
        "axial_n": axial,
        "lateral_n": lateral,
        "pulled_n": pulled,
        "sunk_mm": 1e3 * sunk,
        "seconds": bench.time - begun,
    }


def at_plug(wrench: Floats, T_flange_plug: Pose) -> Floats:
    """What the sensor feels at the flange, as what acts on the plug about its origin, its axes."""
    R, p = T_flange_plug[:3, :3], T_flange_plug[:3, 3]
    force, torque = wrench[:3], wrench[3:] - np.cross(p, wrench[:3])
    return np.concatenate([R.T @ force, R.T @ torque])


def joint_rates(robot: Robot, q: JointVector, twist: Floats, T_flange_plug: Pose) -> JointVector:
    """Joint velocities for a twist of the plug's origin in its own axes, damped."""
    T = flange_pose(robot, q) @ T_flange_plug
    J = flange_jacobian(robot, q)
    arm = T[:3, 3] - flange_pose(robot, q)[:3, 3]
    J = J.copy()
    J[:3] -= np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]]) @ J[3:]
    R = T[:3, :3]
    wish = np.concatenate([R @ twist[:3], R @ twist[3:]])
    return np.asarray(J.T @ np.linalg.solve(J @ J.T + 1e-5 * np.eye(6), wish))


def joints_at(robot: Robot, T: Pose, near: JointVector | None = None) -> JointVector:
    """Joints of a flange pose, from a start that looks forward."""
    home = np.array([0.2, -1.9, 2.2, -0.3, 1.57, 0.0])
    best, least = home, np.inf
    rng = np.random.default_rng(0)
    for attempt in range(60):
        trial = home + rng.normal(0, 0.7, robot.n) if attempt else home
        if attempt == 0 and near is not None:
            trial = near
        if attempt and near is not None and np.isfinite(least):
            break
        for _ in range(120):
            now = flange_pose(robot, trial)
            e = log(inverse(now) @ T)
            J = flange_jacobian(robot, trial)
            R = now[:3, :3]
            wish = np.concatenate([R @ e[:3], R @ e[3:]])
            step = J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), wish)
            trial = trial + step * min(1.0, 0.3 / max(float(np.abs(step).max()), 1e-9))
            if np.abs(e).max() < 1e-8:
                break
        J = flange_jacobian(robot, trial)
        bad = float(np.abs(e).max()) > 1e-6 or np.abs(trial).max() > 2 * np.pi
        cost = np.inf if bad else 1.0 / float(np.linalg.svd(J, compute_uv=False)[-1])
        if cost < least:
            best, least = trial, cost
    if not np.isfinite(least):
        raise ValueError("no joints reach the port")
    return np.asarray(best)
