"""A task of one's own: it sees an observation, says what it wants, and never touches the arm.

The tool draws circles by velocities; the guard limits them, and stops where somebody comes near.
The same task runs in any cell: armsight run ur5_four_cameras --task 11_task:Circle

python examples/11_task.py [SECONDS]
"""

import sys
from dataclasses import dataclass

import numpy as np

from armsight import Observation, Session, VelocityIntent, load_workcell, open_cell, packaged
from armsight.motion.task import Subscriptions
from armsight.robots.kinematics import tcp_pose


@dataclass
class Circle:
    """Circles in a vertical plane, with a tool speed [m/s] and a time for each turn [s]."""

    speed: float = 0.1
    turn: float = 4.0
    name, period, subscriptions = "circle", 0.02, Subscriptions()

    def update(self, observation: Observation) -> VelocityIntent:
        angle = 2 * np.pi * observation.now / self.turn
        twist = self.speed * np.array([0.0, np.cos(angle), np.sin(angle), 0.0, 0.0, 0.0])
        # Valid for 0.2 s: should this task stop talking, the arm comes to rest by itself.
        now = observation.now
        return VelocityIntent("circle", twist, "base", exposure=now, valid_until=now + 0.2)


def main(seconds: float) -> None:
    with open_cell(load_workcell(packaged()["ur3_bench"])) as cell:
        session = Session(cell, Circle())
        session.warm_up()
        places = []
        for _ in range(8):
            session.run(seconds / 8)
            places.append(tcp_pose(cell.robot, session.view().joints.position)[:3, 3])
        view = session.view()
    print(f"the tool has been in a box of {np.ptp(places, axis=0).round(2)} m")
    print(f"guard: {view.guard.mode.value} {view.guard.reason}")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 4.0)
