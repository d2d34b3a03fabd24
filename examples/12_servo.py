"""The arm comes after a ball that moves, by all five cameras at once; and what they make of it.

python examples/12_servo.py [SECONDS]
"""

import sys

import numpy as np

from armsight import Session, load_workcell, open_cell, packaged
from armsight.tasks.servo import ServoOptions


def main(seconds: float) -> None:
    with open_cell(load_workcell(packaged()["ur10_servoing"]), seed=1) as cell:
        task = ServoOptions(mode="ours").make(cell)
        session = Session(cell, task, seed=1)
        session.warm_up()
        session.run(0.5 * seconds)
        before = task.chase.distance
        session.run(0.5 * seconds)
        estimate, guard = task.chase.estimate, session.status()
    speed = 1e3 * np.linalg.norm(estimate.velocity)
    print(f"the ball is {1e3 * task.chase.distance:.0f} mm away, {1e3 * before:.0f} before;")
    print(f"it moves at {speed:.0f} mm/s; led by: {task.chase.reason}")
    print(guard.permit or "no permit asked for")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 4.0)
