"""Every arm of the catalogue in the simulated world: meshes, contact pieces, drives."""

import numpy as np
import pytest
import trimesh

from armsight.geometry.pose import make_pose
from armsight.robots import ROBOT_NAMES, load_robot
from armsight.robots.kinematics import link_poses, tcp_pose
from armsight.simulation.hulls import convex_pieces, load_mesh
from armsight.simulation.spec import ArmSpec, WorldSpec
from armsight.simulation.world import SimulatedWorld


@pytest.mark.parametrize("name", sorted(ROBOT_NAMES))
def test_arm_moves_as_its_kinematics_say(name):
    robot = load_robot(name)
    T_world_base = make_pose(None, (0.1, -0.2, 0.7))
    with SimulatedWorld(WorldSpec(ArmSpec(robot, T_world_base, robot.home))) as world:
        rng = np.random.default_rng(0)
        worst = 0.0
        for _ in range(4):
            velocity = rng.uniform(-0.5, 0.5, robot.n)
            for _ in range(10):
                world.arm.command_velocity(velocity)
                world.advance(world.clock.now() + 0.02)
                off = world._data.qpos[: robot.n] - world.arm.reference_position
                worst = max(worst, float(np.abs(off).max()))
        assert worst < 1e-3
        for _ in range(40):  # rest, so that poses and joints are of the same instant
            world.arm.command_velocity(np.zeros(robot.n))
            world.advance(world.clock.now() + 0.02)
        q = world._data.qpos[: robot.n].copy()
        assert np.allclose(world.truth.link_poses(), T_world_base @ link_poses(robot, q), atol=1e-4)
        tip = T_world_base @ tcp_pose(robot, q)
        assert np.allclose(world.truth.tip_position(), tip[:3, 3], atol=1e-4)
        assert np.allclose(world.arm.read().position, q, atol=1e-3)
        assert not world.truth.contacts


def test_contact_pieces_lie_close_around_the_upper_arm():
    """One hull fills the elbow of a UR5's upper arm; the pieces follow it."""
    robot = load_robot("ur5")
    whole, pieces = 0.0, 0.0
    for mesh in robot.meshes:
        if mesh.link != 2:
            continue
        surface = load_mesh(mesh.path)
        vertices, faces = np.asarray(surface.vertices), np.asarray(surface.faces)
        whole += trimesh.convex.convex_hull(vertices).volume
        hulls = convex_pieces(vertices, faces)
        pieces += sum(trimesh.convex.convex_hull(hull).volume for hull in hulls)
    assert pieces < 0.7 * whole
