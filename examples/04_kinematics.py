"""Where an arm's tool is, how it moves, and which joint positions bring it to a pose.

python examples/04_kinematics.py [ROBOT]
"""

import sys

import numpy as np

from armsight import load_robot
from armsight.geometry.pose import make_pose
from armsight.motion.ik import solve_ik
from armsight.robots.kinematics import tcp_jacobian, tcp_pose


def main(name: str) -> None:
    robot = load_robot(name)
    T_base_tcp = tcp_pose(robot, robot.home)
    print(f"{name}: {robot.n} joints; the tool at home: {T_base_tcp[:3, 3].round(3)} m in base")

    J = tcp_jacobian(robot, robot.home)  # (6, n): [m/s] and [rad/s] of each joint's [rad/s]
    print(
        f"fastest joint for the tool: {robot.joint_names[np.linalg.norm(J[:3], axis=0).argmax()]}"
    )

    wanted = make_pose(None, [0.0, 0.0, 0.05]) @ T_base_tcp  # 5 cm higher
    solutions = solve_ik(robot, wanted, robot.home, np.random.default_rng(0))
    nearest = solutions[0]
    print(f"{len(solutions)} ways to be 5 cm higher; the nearest turns a joint by at most ", end="")
    print(f"{np.rad2deg(np.abs(nearest - robot.home).max()):.1f} deg")
    print(f"error: {np.abs(tcp_pose(robot, nearest) - wanted).max():.1e}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "ur5")
