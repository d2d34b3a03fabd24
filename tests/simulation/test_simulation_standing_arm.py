"""Another arm in the cell: it is seen where its joints put it, touched, and known as undeclared."""

import numpy as np

from armsight.devices.camera_models import camera_info
from armsight.geometry.pose import inverse, look_at, make_pose, transform
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import sphere_centers
from armsight.simulation.spec import ArmSpec, CameraSpec, StandingArmSpec, WorldSpec
from armsight.simulation.world import SimulatedWorld

Q = np.deg2rad([0, -30, 0, -120, 0, 95, 45])
PLACE = make_pose(None, [1.0, 0.6, 0.0])


def world(*arms: StandingArmSpec) -> SimulatedWorld:
    arm = ArmSpec(load_robot("ur5"), np.eye(4), load_robot("ur5").home)
    eye = look_at([2.6, 0.6, 1.2], [1.0, 0.6, 0.4])
    camera = CameraSpec(camera_info("cam", "kinect_v2", T_mount_camera=eye), eye, errors=False)
    return SimulatedWorld(WorldSpec(arm, (camera,), arms=arms), 0)


def test_depth_shows_it_where_its_joints_put_it(gl) -> None:
    panda = load_robot("panda")
    with world() as empty, world(StandingArmSpec("b", panda, PLACE, Q)) as cell:
        before, frame = empty.snap(0, 1).depth, cell.snap(0, 1).depth
        info = cell.cameras[0].info
        nearer = np.nan_to_num(frame, nan=9.0) < np.nan_to_num(before, nan=9.0) - 0.05
        assert nearer.sum() > 2000
        points = info.depth.deproject(frame)[nearer]
    T_world_camera = cell.cameras[0].unit.T_mount_camera
    points = transform(T_world_camera, points)
    centers = transform(PLACE, sphere_centers(panda, Q))
    gap = np.linalg.norm(points[:, None] - centers[None], axis=2) - panda.spheres.radius
    assert np.abs(np.quantile(gap.min(axis=1), [0.01, 0.99])).max() < 0.03
    seen = transform(inverse(PLACE), points)
    assert seen[:, 2].max() > 0.5


def test_it_stops_the_arm_that_runs_into_it(gl) -> None:
    """Built into the other one: MuJoCo finds contacts between the arm and what is undeclared."""
    other = StandingArmSpec("b", load_robot("panda"), make_pose(None, [0.25, 0.0, 0.0]), Q)
    with world(other) as cell:
        cell.advance(0.02)
        assert {(c.kind, c.owner) for c in cell.truth.contacts} == {("undeclared", "b")}
