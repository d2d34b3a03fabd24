"""Draw the arms of the catalogue for the docs, and their shapes for checking by eye.

python scripts/draw_robots.py docs/images/robots.png
python scripts/draw_robots.py --shapes spheres --tool gripper spheres.png ur5 panda
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np
from PIL import Image

from armsight.geometry.pose import to_wxyz, transform
from armsight.robots import ROBOT_NAMES, LinkMesh, Robot, load_robot, load_tool
from armsight.robots.kinematics import link_poses
from armsight.robots.meshes import read_mesh

os.environ.setdefault("MUJOCO_GL", "egl")
import mujoco

BACKGROUND = (0.93, 0.94, 0.96)
GREEN, ORANGE = (0.1, 0.7, 0.2, 0.3), (0.9, 0.5, 0.1, 0.3)


def main() -> None:
    """Draw to the file named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("names", nargs="*", default=list(ROBOT_NAMES))
    parser.add_argument("--shapes", choices=["none", "spheres", "capsules"], default="none")
    parser.add_argument("--tool")
    parser.add_argument("--spacing", type=float, default=0.75, help="between the arms [m]")
    parser.add_argument("--azimuth", type=float, default=183.0, help="of the view [deg]")
    parser.add_argument("--size", type=int, nargs=2, default=(1600, 700), help="of the picture")
    args = parser.parse_args()
    spec = empty_scene(*args.size)
    for k, name in enumerate(args.names or ROBOT_NAMES):
        robot = load_robot(name)
        if args.tool:
            robot = robot.with_tool(load_tool(args.tool))
        place(spec, f"{k}/", robot, np.array([0.0, -k * args.spacing, 0.0]), args.shapes)
    args.file.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(picture(spec, len(args.names or ROBOT_NAMES), args)).save(args.file)


def empty_scene(width: int, height: int) -> mujoco.MjSpec:
    """A floor, light and a plain sky."""
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.offsamples = 8
    spec.visual.headlight.ambient = [0.42] * 3
    spec.visual.headlight.diffuse = [0.35] * 3
    spec.visual.headlight.specular = [0.05] * 3
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        width=16,
        height=96,
        rgb1=BACKGROUND,
        rgb2=BACKGROUND,
    )
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    spec.worldbody.add_geom(type=plane, size=[20, 20, 1], rgba=[*BACKGROUND, 1])
    sun = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    spec.worldbody.add_light(type=sun, pos=[2, -1, 4], dir=[-0.3, 0.2, -1], diffuse=[0.45] * 3)
    return spec


def place(spec: mujoco.MjSpec, prefix: str, robot: Robot, at: np.ndarray, shapes: str) -> None:
    """An arm at home, its meshes and, if wanted, its shapes."""
    poses = link_poses(robot, robot.home)
    poses[:, :3, 3] += at
    drawn = [(mesh, poses[mesh.link]) for mesh in robot.meshes]
    if robot.tool is not None:
        drawn += [(mesh, poses[-1] @ robot.T_last_flange) for mesh in robot.tool.meshes]
    for i, (mesh, T) in enumerate(drawn):
        add_mesh(spec, f"{prefix}{i}", mesh, T)
    if shapes == "spheres":
        s = robot.spheres
        for link, center, radius in zip(s.link, s.center, s.radius):
            add_capsule(spec, transform(poses[link], np.stack([center, center])), radius, GREEN)
    if shapes == "capsules":
        c = robot.capsules
        for link, start, end, radius in zip(c.link, c.start, c.end, c.radius):
            add_capsule(spec, transform(poses[link], np.stack([start, end])), radius, ORANGE)


def add_mesh(spec: mujoco.MjSpec, name: str, mesh: LinkMesh, T: np.ndarray) -> None:
    """One coloured surface at a pose."""
    vertices, faces = read_mesh(mesh)
    spec.add_mesh(
        name=name,
        uservert=vertices.astype(np.float32).ravel(),
        userface=faces.astype(np.int32).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        pos=T[:3, 3],
        quat=to_wxyz(T),
        rgba=[*mesh.color, 1],
    )


def add_capsule(
    spec: mujoco.MjSpec, ends: np.ndarray, radius: float, rgba: tuple[float, ...]
) -> None:
    """One transparent sphere or capsule."""
    if np.linalg.norm(ends[1] - ends[0]) < 1e-6:
        kind = mujoco.mjtGeom.mjGEOM_SPHERE
        spec.worldbody.add_geom(type=kind, pos=ends[0], size=[radius, 0, 0], rgba=rgba)
    else:
        kind = mujoco.mjtGeom.mjGEOM_CAPSULE
        spec.worldbody.add_geom(type=kind, fromto=ends.ravel(), size=[radius, 0, 0], rgba=rgba)


def picture(spec: mujoco.MjSpec, count: int, args: argparse.Namespace) -> np.ndarray:
    """The scene seen from in front of the arms."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    middle = -0.5 * (count - 1) * args.spacing
    camera.lookat = [0.2, middle, 0.46]
    camera.distance = 1.3 + 0.36 * (count - 1) * args.spacing
    camera.azimuth, camera.elevation = args.azimuth, -14.0
    with mujoco.Renderer(model, args.size[1], args.size[0]) as renderer:
        renderer.update_scene(data, camera)
        return renderer.render()


if __name__ == "__main__":
    main()
