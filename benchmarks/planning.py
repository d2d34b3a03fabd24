"""The planner beside OMPL's on the same questions, with the same proven edges.

A UR5 swings past random pillars through space that people have just left. ``ratio_first`` compares
the time to the first path with OMPL's RRTConnect; ``path_cost_excess`` compares the danger-aware
cost within 20 ms with OMPL's BIT* given 10 s (``--quick``: 1 s), negative where ours is cheaper.
"""

from __future__ import annotations

import time

import numpy as np
from common import Report
from scenes import ball, box, snapshot_of

from armsight.motion.collision import CollisionModel
from armsight.motion.data import JointGoal, PlanRequest
from armsight.motion.ompl_planner import OmplPlanner
from armsight.motion.planner import RrtConnectPlanner
from armsight.robots import load_robot


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
                    yield scene, PlanRequest(seed, a, JointGoal("b", b))
                break


def main() -> None:
    """Run and print."""
    report = Report("planning", __doc__)
    wanted = max(3, report.rounds(20))
    long = 10.0 if wanted >= 20 else 1.0
    robot = load_robot("ur5")
    model = CollisionModel(robot)
    ours = RrtConnectPlanner(robot, model)
    first, whole, theirs, excess = [], [], [], []
    for k, (scene, request) in enumerate(questions(model, wanted)):
        if k == 0:
            ours.plan(request, scene, 1.0, np.random.default_rng(0))
        began = time.perf_counter()
        answer = ours.plan(request, scene, 1.0, np.random.default_rng(0))
        whole.append(time.perf_counter() - began)
        first.append(answer.planning_s)
        peer = OmplPlanner(robot, "RRTConnect", model)
        theirs.append(peer.plan(request, scene, 10.0, np.random.default_rng(0)).planning_s)
        best = OmplPlanner(robot, "BITstar", model).plan(
            request, scene, long, np.random.default_rng(0)
        )
        if answer.good and best.good:
            excess.append(100.0 * (answer.cost / best.cost - 1.0))

    def spread(values):
        return float(np.percentile(values, 10)), float(np.percentile(values, 90))

    ms = [1e3 * np.array(x) for x in (first, whole, theirs)]
    report.add(
        "first_path_ms", np.median(ms[0]), "ms", spread=spread(ms[0]), must="<= 10", aim="<= 2"
    )
    report.add("whole_plan_ms", np.median(ms[1]), "ms", spread=spread(ms[1]))
    report.add("ompl_rrtconnect_ms", np.median(ms[2]), "ms", spread=spread(ms[2]))
    report.add("ratio_first", np.median(ms[2]) / np.median(ms[0]), "", note="OMPL / ours")
    report.add(
        "path_cost_excess",
        np.median(excess),
        "%",
        spread=spread(excess),
        must="<= 15",
        aim="<= 5",
        note=f"against BIT* given {long:g} s",
    )
    report.finish()


if __name__ == "__main__":
    main()
