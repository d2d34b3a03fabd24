"""One trial of a charging lid: a UR10 with a finger beside its plug, in contact physics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from armsight.charging.lid import R_LID_FINGER, LidHand, LidOptions
from armsight.experiments.insertion_bench import TICK, at_plug, joint_rates, joints_at
from armsight.geometry.pose import exp, from_rpy, inverse, make_pose
from armsight.robots import load_robot
from armsight.robots.kinematics import flange_pose
from armsight.simulation.plugging import PlugBench, PlugSetup
from armsight.simulation.spec import Latch, LidSpec

T_FLANGE_FINGER = make_pose(None, (0.07, 0.0, 0.25))
"""The tip beside the plug and 5 cm before its mouth; the mount carries both."""
PIN = LidOptions("push").pin
SECONDS = 60.0
"""For one of the two motions at most [s]."""
OPENED = float(np.deg2rad(85.0))
Fault = Literal["", "stuck", "half", "missing", "no latch"]
STUCK: dict[Fault, float] = {"stuck": 0.0, "half": float(np.deg2rad(35.0))}
"""A lid that jams opens so far [rad]."""


@dataclass(frozen=True)
class LidTrial:
    """One situation.

    Attributes:
        latch: of the lid; holds: force at its edge that works it [N]; friction: of its surface.
        yaw, lean: of the car before the arm [rad]; height: of the lid [m].
        off: (6,) how wrong the belief of its pose is, as a twist in its frame [m], [rad].
        fault: nothing; does not open at all; jams half-way; is not there; does not catch.
        seed: of the sensor.
        told: whether the hand is told which latch it is.
    """

    latch: Latch
    holds: float
    friction: float
    yaw: float
    lean: float
    height: float
    off: tuple[float, ...]
    fault: Fault
    seed: int
    told: bool = True


def draw(rng: np.random.Generator, latch: Latch, fault: Fault = "", told: bool = True) -> LidTrial:
    """A random trial, turned by up to 30 deg; the belief is off by twice what a look's is."""
    sigma = np.array([1.5e-3] * 3 + [np.deg2rad(0.8)] * 3)
    return LidTrial(
        latch,
        float(rng.uniform(15.0, 30.0)),
        float(rng.uniform(0.1, 0.4)),
        float(np.deg2rad(rng.uniform(-30.0, 30.0))),
        float(np.deg2rad(rng.uniform(0.0, 10.0))),
        float(rng.uniform(0.55, 0.75)),
        tuple(float(v) for v in rng.standard_normal(6) * sigma),
        fault,
        int(rng.integers(2**31)),
        told,
    )


def run_trial(trial: LidTrial) -> dict[str, Any]:
    """Open the lid, and shut it again where it was opened; scored by the truth."""
    bench = LidBench(trial)
    opening = bench.drive(LidHand(bench.options))
    angle = bench.lid.angle
    result = {
        "latch": trial.latch,
        "told": trial.told,
        "fault": trial.fault,
        "open_deg": float(np.rad2deg(angle)),
        "open_said": opening.problem,
        "open_s": bench.time,
        "force_n": bench.peak,
        "opened": bool(angle > OPENED and not opening.problem),
    }
    if not result["opened"]:
        return result | {"shut": False, "shut_said": "", "shut_s": float("nan")}
    began = bench.time
    shutting = bench.drive(LidHand(bench.options, "shut"))
    shut = bool(bench.lid.shut)
    return result | {
        "shut_deg": float(np.rad2deg(bench.lid.angle)),
        "shut_true": shut,
        "shut": bool(shut and not shutting.problem),
        "shut_said": shutting.problem,
        "shut_s": bench.time - began,
        "force_n": bench.peak,
    }


class LidBench:
    """The physics of a trial, and a hand that works in it.

    Args:
        trial: the situation.

    Attributes:
        options: of a hand that works this lid; peak: greatest force on the finger [N].
    """

    def __init__(self, trial: LidTrial) -> None:
        self.options = LidOptions(trial.latch if trial.told else "unknown")
        self._robot = load_robot("ur10")
        facing = make_pose([[0, 0, -1], [-1, 0, 0], [0, 1, 0]], [0.95, 0.16, trial.height])
        T = facing @ from_rpy((-trial.lean, 0.0, 0.0)) @ from_rpy((0.0, trial.yaw, 0.0))
        self._believed = T @ exp(np.array(trial.off))
        spec = LidSpec(
            T,
            trial.latch,
            0.0 if trial.fault == "no latch" else trial.holds,
            trial.friction,
            stuck=STUCK.get(trial.fault),
            there=trial.fault != "missing",
        )
        setup = PlugSetup(
            T,
            T_FLANGE_FINGER,
            np.zeros((0, 4, 4)),
            np.zeros((0, 3)),
            np.array([[0.0, 0.0, -0.12, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, PIN, 0.0, 0.0]]),
            self.options.radius,
            center=(-0.07, 0.0, -0.11),
            lid=spec,
        )
        start = self._believed @ make_pose(R_LID_FINGER, (0.03, 0.0, 0.26))
        q = joints_at(self._robot, start @ inverse(T_FLANGE_FINGER))
        self._bench = bench = PlugBench(self._robot, setup, q, trial.seed)
        assert bench.lid is not None
        self.lid = bench.lid
        for again in range(3):  # as the plug in insertion_bench: it hangs, and is seen to hang so
            for _ in range(400):
                bench.step()
            self._hung = inverse(flange_pose(self._robot, bench.q)) @ bench.T_world_plug()
            if again < 2:
                bench.place(joints_at(self._robot, start @ inverse(self._hung), bench.q))
        self._tare = np.mean([bench.wrench() for _ in range(40)], axis=0)
        self.peak = 0.0

    @property
    def time(self) -> float:
        """[s]."""
        return self._bench.time

    def drive(self, hand: LidHand) -> LidHand:
        """Let a hand work until it has ended."""
        bench, end = self._bench, self._bench.time + SECONDS
        while not hand.ended and bench.time < end:
            T = inverse(self._believed) @ flange_pose(self._robot, bench.q) @ self._hung
            wrench = at_plug(bench.wrench() - self._tare, self._hung)
            twist = hand.step(bench.time, T, wrench)
            bench.command(joint_rates(self._robot, bench.q, twist, self._hung))
            for _ in range(TICK):
                bench.step()
            self.peak = max(self.peak, bench.force())
        bench.command(np.zeros(self._robot.n))
        for _ in range(300):
            bench.step()
        return hand
