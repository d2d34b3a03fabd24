"""A guarded patrol in a simulated cell, without the page: who came how near, and was it touched?

python examples/02_patrol.py [SECONDS]
"""

import sys

from armsight import PatrolTask, Session, load_workcell, open_cell, packaged


def main(seconds: float) -> None:
    workcell = load_workcell(packaged()["ur5_four_cameras"])
    with open_cell(workcell, seed=0) as cell:
        patrol = PatrolTask(workcell.goals, dwell=0.5)
        session = Session(cell, patrol)
        session.warm_up()
        session.run(seconds)
        truth = cell.world.truth
        print(f"goals reached: {len(patrol.times)}")
        print(f"nearest to the person: {truth.min_distance:.2f} m")
        print(f"contacts while moving: {len(truth.moving_contacts)}")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 30.0)
