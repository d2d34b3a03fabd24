"""The robot on the page: its meshes hang on its links, and links move with the joints."""

from __future__ import annotations

import numpy as np
import trimesh
import viser

from armsight.arrays import JointVector
from armsight.robots.kinematics import link_poses
from armsight.robots.meshes import read_mesh
from armsight.robots.robot import LinkMesh, Robot
from armsight.viewer.nodes import Posed, quaternions


class RobotModel:
    """Draws a robot with its tool under a parent node."""

    def __init__(self, scene: viser.SceneApi, parent: str, robot: Robot) -> None:
        self._robot = robot
        self._links = [
            Posed(scene.add_frame(f"{parent}/link_{i}", show_axes=False))
            for i in range(len(robot.link_names))
        ]
        self._flange = Posed(
            scene.add_frame(f"{parent}/link_{robot.n}/flange", show_axes=False),
            robot.T_last_flange,
        )
        for i, mesh in enumerate(robot.meshes):
            _add_mesh(scene, f"{parent}/link_{mesh.link}/mesh_{i}", mesh)
        for i, mesh in enumerate(() if robot.tool is None else robot.tool.meshes):
            _add_mesh(scene, f"{parent}/link_{robot.n}/flange/tool_{i}", mesh)
        self.move(robot.home)

    def move(self, q: JointVector) -> None:
        """Show the robot at (n,) joint positions [rad]."""
        poses = link_poses(self._robot, q)
        for link, T, wxyz in zip(self._links, poses, quaternions(poses)):
            link.move(T, wxyz)


def _add_mesh(scene: viser.SceneApi, name: str, mesh: LinkMesh) -> None:
    """One coloured surface; corners are split so that edges stay sharp and curves smooth."""
    surface = trimesh.Trimesh(*read_mesh(mesh), process=True)
    surface = trimesh.graph.smooth_shade(surface, angle=np.deg2rad(35.0))
    scene.add_mesh_simple(
        name,
        vertices=np.asarray(surface.vertices, np.float32),
        faces=np.asarray(surface.faces, np.uint32),
        color=mesh.color,
        side="double",
    )
