"""The planner beside OMPL's on the same questions, with the same proven edges.

A UR5 swings past random pillars through space that people have just left. ``ratio_first`` compares
the time to the first path with OMPL's RRTConnect, question by question, no path shortened;
``path_cost_excess`` compares the danger-aware cost within 20 ms with OMPL's BIT* given 10 s
(``--quick``: 1 s), negative where ours is cheaper. All times, the limits too, are CPU times of the
planning thread. ``work_20ms`` is how long the looks that stand for 20 ms take here.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from armsight.motion.collision import CollisionModel
from armsight.motion.data import PlanRequest
from armsight.motion.intents import JointIntent
from armsight.motion.planner import PlannerConfig, RrtConnectPlanner
from armsight.robots import load_robot
from baselines.ompl_planner import OmplPlanner
from common import Report
from scenes import ball, box, snapshot_of


def questions(model: CollisionModel, wanted: int):
    """Yield (snapshot, request): swings whose ends are free and whose straight line is not."""
    seed = 0
    while wanted > 0:
        rng = np.random.default_rng(seed)
        seed += 1
        solids = [box((0.0, 0.0, -0.2), (2.0, 2.0, 0.08))]
        for angle in rng.uniform(-1.0, 1.0, 3):
            r, h = rng.uniform(0.4, 0.7), rng.uniform(0.3, 0.8)
            solids.append(box((r * np.cos(angle), r * np.sin(angle), 0.5 * h), (0.1, 0.1, h)))
        gone = [
            (
                ball((0.5 * np.cos(a), 0.5 * np.sin(a), rng.uniform(0.1, 0.9)), 0.15),
                rng.uniform(0, 15),
            )
            for a in rng.uniform(-1.0, 1.0, 3)
        ]
        scene = snapshot_of(solids, gone)
        for _ in range(50):
            a = np.array([-1.1, -1.2, 1.2, -1.6, -1.57, 0.0]) + rng.normal(0, 0.3, 6)
            b = np.array([1.1, -1.2, 1.2, -1.6, -1.57, 0.0]) + rng.normal(0, 0.3, 6)
            if model.valid(a, scene) and model.valid(b, scene):
                if not model.edge_valid(a, b, scene):
                    wanted -= 1
                    yield scene, PlanRequest(seed, a, JointIntent("b", b))
                break


def main() -> None:
    """Run and print."""
    report = Report("planning", __doc__)
    wanted = max(3, report.rounds(20))
    long = 10.0 if wanted >= 20 else 1.0
    robot = load_robot("ur5")
    model = CollisionModel(robot)
    config = PlannerConfig()
    ours = RrtConnectPlanner(robot, model, config, clock=time.thread_time)
    plain = RrtConnectPlanner(
        robot, model, replace(config, improvement=0.0), clock=time.thread_time
    )
    first, whole, spent, theirs, excess, failed = [], [], [], [], [], 0
    for k, (scene, request) in enumerate(questions(model, wanted)):
        if k == 0:
            for one in (ours, OmplPlanner(robot, "RRTConnect", model)):
                one.plan(request, scene, 1.0, np.random.default_rng(0))
        answer = ours.plan(request, scene, 1.0, np.random.default_rng(0))
        first.append(answer.planning_s)
        whole.append(answer.planning_s + answer.optimisation_s)
        spent.append(
            answer.optimisation_s
            - plain.plan(request, scene, 1.0, np.random.default_rng(0)).optimisation_s
        )
        peer = OmplPlanner(robot, "RRTConnect", model, simplify=False, clock=time.thread_time)
        theirs.append(peer.plan(request, scene, 10.0, np.random.default_rng(0)).planning_s)
        best = OmplPlanner(robot, "BITstar", model, clock=time.thread_time).plan(
            request, scene, long, np.random.default_rng(0)
        )
        if answer.good and best.good:
            excess.append(100.0 * (answer.cost / best.cost - 1.0))
        else:
            failed += 1

    def add(key, values, unit, **budget):
        low, high = (float(x) for x in np.percentile(values, [10, 90]))
        report.add(key, float(np.median(values)), unit, spread=(low, high), **budget)

    ms = {
        k: 1e3 * np.array(v) for k, v in (("f", first), ("w", whole), ("s", spent), ("t", theirs))
    }
    add("first_path_ms", ms["f"], "ms", must="<= 10", aim="<= 2")
    add("whole_plan_ms", ms["w"], "ms")
    add("work_20ms", ms["s"], "ms", note=f"{config.improvement * config.looks_per_second:g} looks")
    add("ompl_rrtconnect_ms", ms["t"], "ms")
    add("ratio_first", ms["t"] / ms["f"], "", note="OMPL / ours")
    add(
        "path_cost_excess", excess, "%", must="<= 15", aim="<= 5",
        note=f"against BIT* given {long:g} s; {failed} of {wanted} not answered by both",
    )  # fmt: skip
    report.finish()


if __name__ == "__main__":
    main()
