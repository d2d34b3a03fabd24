"""Brings a robot of one's own by its URDF: kinematics, limits, and where its links touch.

Here the URDF is written first: two links on a turntable.

python examples/09_urdf.py [ROBOT.urdf]
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from armsight import load_urdf
from armsight.robots.kinematics import flange_pose

LINK = '<link name="{0}"><inertial><mass value="2"/></inertial><collision><origin xyz="0 0 0.2"/>'
LINK += '<geometry><cylinder radius="0.05" length="0.4"/></geometry></collision></link>'
JOINT = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
JOINT += '<origin xyz="0 0 {3}"/><axis xyz="{4}"/>'
JOINT += '<limit lower="-2.5" upper="2.5" velocity="2" effort="50"/></joint>'
TEXT = '<robot name="two_links"><link name="base"/>{}</robot>'.format(
    "".join(LINK.format(name) for name in ("turntable", "upper", "lower"))
    + JOINT.format("turn", "base", "turntable", 0.0, "0 0 1")
    + JOINT.format("shoulder", "turntable", "upper", 0.4, "0 1 0")
    + JOINT.format("elbow", "upper", "lower", 0.4, "0 1 0")
)


def main(file: Path) -> None:
    robot = load_urdf(file, flange="lower" if file.name == "two_links.urdf" else None)
    print(f"{robot.name}: {', '.join(robot.joint_names)}")
    print(f"upper limits {np.rad2deg(robot.limits.upper).round()} deg")
    bent = np.full(robot.n, 0.5)
    print(f"flange with all joints at 0.5 rad: {flange_pose(robot, bent)[:3, 3].round(3)} m")
    print(f"{len(robot.spheres.link)} spheres cover its links")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with TemporaryDirectory() as folder:
            made = Path(folder) / "two_links.urdf"
            made.write_text(TEXT)
            main(made)
