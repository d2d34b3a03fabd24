"""A map from depth pictures of one's own: no workcell file, no simulation, no loop.

Here the pictures are made by a formula: a camera looks down at a table with a box on it.

python examples/05_map.py
"""

import numpy as np

from armsight import PinholeCamera, RgbdFrame, WorkspaceMap, WorkspaceSnapshot, load_robot
from armsight.devices.data import DepthNoise, JointState, RgbdCameraInfo
from armsight.devices.history import JointHistory
from armsight.geometry.pose import look_at
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN

LENS = PinholeCamera.from_fov(320, 240, 1.2, 1.0)
T_BASE_CAMERA = look_at([0.8, 0.0, 1.6], [0.55, 0.0, 0.0])
BOX = np.array([[0.5, -0.1, 0.0], [0.7, 0.1, 0.3]])  # lower and upper corner in base [m]


def depth_picture() -> np.ndarray:
    """(h, w) float32 depth [m] of the table z = 0 and the box, by intersecting rays."""
    rays = np.concatenate([LENS.rays, np.ones((240, 320, 1))], axis=-1) @ T_BASE_CAMERA[:3, :3].T
    eye = T_BASE_CAMERA[:3, 3]
    with np.errstate(divide="ignore"):
        a, b = (BOX[0] - eye) / rays, (BOX[1] - eye) / rays
        table = np.where(rays[..., 2] < 0, -eye[2] / rays[..., 2], np.nan)
    near, far = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
    return np.where(near <= far, near, table).astype(np.float32)


def make_map() -> WorkspaceSnapshot:
    camera = RgbdCameraInfo(
        "above", "ideal", LENS, None, np.eye(4), "base", T_BASE_CAMERA, 30.0, 0.0, (0.3, 4.5),
        DepthNoise(0.001, 0.0, 0.0),
    )  # fmt: skip
    robot = load_robot("ur5")
    # The map leaves the arm's own pixels out: it is told where the joints are.
    joints, workspace = JointHistory(), WorkspaceMap(robot, [camera], ())
    for k in range(10):
        now = k / 30
        joints.add(JointState(now, robot.home, np.zeros(robot.n)))
        frame = RgbdFrame("above", k, now, now, depth_picture(), None, T_BASE_CAMERA)
        snapshot = workspace.update([frame], joints, now)
    return snapshot


def main() -> None:
    snapshot = make_map()
    for name, state in (("occupied", OCCUPIED), ("free", FREE), ("unseen", UNKNOWN)):
        print(f"{name:9} {(snapshot.state == state).mean():6.1%} of the voxels")
    above = snapshot.grid.index(np.array([[0.6, 0.0, 0.5]]))[0]
    print(f"20 cm above the box: nearest thing {snapshot.distance[tuple(above)]:.2f} m away")


if __name__ == "__main__":
    main()
