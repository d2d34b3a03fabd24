"""Plans a motion through what the cameras see, and says how near it comes to anything.

python examples/06_plan.py [WORKCELL]
"""

import sys

import numpy as np

from armsight import JointIntent, Session, load_workcell, open_cell
from armsight.motion.data import PlanRequest
from armsight.motion.planner import RrtConnectPlanner
from armsight.workcell.packaged import find


def main(file: str) -> None:
    workcell = load_workcell(find(file))
    with open_cell(workcell) as cell:
        session = Session(cell, None)  # no task: cameras and map alone
        session.run(1.0)
        view = session.view()
    goal, position = next(iter(workcell.goals.items()))
    request = PlanRequest(1, view.joints.position, JointIntent(goal, position))
    planner = RrtConnectPlanner(cell.robot)
    plan = planner.plan(request, view.snapshot, 1.0, np.random.default_rng(0))
    if not plan.good:
        print(f"no way to {goal}: {plan.failure}")  # in words: which link, touching what, where
        return
    motion = plan.trajectory
    print(f"to {goal}: {len(plan.path)} poses, {motion.duration:.1f} s")
    times = np.linspace(0.0, motion.duration, 50)
    gaps = [planner.model.clearances(motion.position(t), view.snapshot).min() for t in times]
    print(f"on the way no part comes nearer than {min(gaps):.2f} m to anything seen or unseen")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "ur5_four_cameras")
