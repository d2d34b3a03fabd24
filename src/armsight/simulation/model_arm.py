"""The arm's bodies: links, what the flange carries, and what the force sensor is between."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armsight.arrays import Floats, Ints, Points, Pose, Poses
from armsight.geometry.pose import inverse, to_wxyz, transform
from armsight.robots.kinematics import link_poses
from armsight.robots.robot import Capsules, LinkMesh, Robot, Tool
from armsight.simulation import looks
from armsight.simulation.board import BoardUnit
from armsight.simulation.finger import add_finger
from armsight.simulation.floating_tip import add_floating, floats
from armsight.simulation.gl import mujoco
from armsight.simulation.hulls import convex_pieces, load_mesh
from armsight.simulation.model_fingers import add_fingers
from armsight.simulation.model_parts import (
    ARM,
    COARSE,
    CONTACT,
    FINE,
    LIES,
    OTHER,
    SEEN,
    TOUCHING,
    Builder,
    Part,
    set_inertia,
)
from armsight.simulation.plugs import add_looks, add_plug, add_sleeve
from armsight.simulation.spec import GripperSpec, PlugSpec, StandingArmSpec

TOOL_GYRATION = 0.03
"""Radius of gyration that is assumed of a tool [m]."""


def add_arm(
    builder: Builder,
    robot: Robot,
    T_world_base: Pose,
    T_link_joint: Poses,
    sensing: bool,
    board: BoardUnit | None = None,
    gripper: GripperSpec | None = None,
    plug: PlugSpec | None = None,
    pushes: bool = False,
) -> tuple[str, ...]:
    """The links; with a force sensor the tool is a body of its own, else part of the last.

    Args:
        builder: of the model.
        robot: the arm.
        T_world_base: where it stands.
        T_link_joint: (n, 4, 4) its true geometry.
        sensing: the tool is a body of its own.
        board: that hangs on it or stands somewhere, or None.
        gripper: whose fingers move, or None; needs ``sensing``.
        plug: the tool hangs in a mount that gives way, or None; needs ``sensing``, too.
        pushes: contact pushes; a tip on springs then gives way, and needs ``sensing``.
    """
    carried = board if board is not None and board.mounted_on == "flange" else None
    if board is not None and carried is None:
        _board(builder, builder.mj.worldbody, Part("static", "board"), board, np.eye(4))
    body = builder.mj.worldbody
    tool = robot.tool
    names = []
    for link in range(robot.n + 1):
        T = T_world_base if link == 0 else T_link_joint[link - 1]
        name = f"arm/{link}/{robot.link_names[link]}"
        body = body.add_body(name=name, pos=T[:3, 3], quat=to_wxyz(T), gravcomp=1.0)
        names.append(name)
        if link > 0:
            body.add_joint(
                name=f"arm/{robot.joint_names[link - 1]}",
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=robot.axis[link - 1],
                limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            )
        _inertia(body, robot, link, with_tool=not sensing)
        meshes = [(m, m.T_link_mesh) for m in robot.meshes if m.link == link]
        if link == robot.n and carried is not None and not sensing:
            # The tool's drawn plate hangs where it was designed, the board where it truly does.
            part = Part("arm", robot.name, robot.link_names[link], link)
            _board(builder, body, part, carried, robot.T_last_flange)
        elif link == robot.n and tool is not None and not sensing:
            meshes += [(m, robot.T_last_flange @ m.T_link_mesh) for m in tool.meshes]
            _held(builder, body, robot, robot.T_last_flange)
        _link(builder, body, robot, link, meshes)
    if sensing:
        _flange(builder, body, robot, carried, gripper, plug, pushes)
    return tuple(names)


def _board(builder: Builder, body: Any, part: Part, board: BoardUnit, T_body_mount: Pose) -> None:
    """The plate behind the print; the print itself is cast onto pictures."""
    center, half = board.plate
    T = T_body_mount @ board.T_mount_board
    builder.geom(
        body,
        part,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half,
        pos=T[:3, :3] @ center + T[:3, 3],
        quat=to_wxyz(T),
        material=looks.arm_material(builder.mj, (0.9, 0.9, 0.9)),
        group=SEEN,
        contype=ARM if part.kind == "arm" else OTHER,
        conaffinity=OTHER if part.kind == "arm" else ARM,
    )


def _flange(
    builder: Builder,
    last: Any,
    robot: Robot,
    board: BoardUnit | None,
    gripper: GripperSpec | None,
    plug: PlugSpec | None,
    pushes: bool,
) -> None:
    """What hangs on the force sensor."""
    T, tool = robot.T_last_flange, robot.tool
    body = last.add_body(name="arm/flange", pos=T[:3, 3], quat=to_wxyz(T), gravcomp=1.0)
    mass = 1e-3 if tool is None else max(tool.mass, 1e-3)
    center = np.zeros(3) if tool is None else tool.center_of_mass
    tip = None
    if pushes and tool is not None and tool.tip is not None and plug is None and board is None:
        tip, mass, center = add_floating(body, tool)
    if plug is not None and tool is not None:
        set_inertia(body, 1e-2, np.zeros(3), np.eye(3) * 1e-6)
        _plug(builder, body, robot, tool, plug, mass)
    else:
        set_inertia(body, mass, center, np.eye(3) * mass * TOOL_GYRATION**2)
    if board is not None:
        part = Part("arm", robot.name, robot.link_names[robot.n], robot.n)
        _board(builder, body, part, board, np.eye(4))
    elif tool is not None and plug is None:
        fingertips = add_fingers(builder, body, robot, gripper) if gripper is not None else ()
        meshes = [(m, m.T_link_mesh) for m in tool.meshes if m.path.stem not in fingertips]
        if meshes and tip is not None:
            _link(builder, tip, robot, robot.n, [m for m in meshes if floats(m[0])], "arm/tip")
            meshes = [m for m in meshes if not floats(m[0])]
        if meshes:
            _link(builder, body, robot, robot.n, meshes, "arm/tool")
        _held(builder, body, robot, np.eye(4))
    site = body.add_site(name="flange")
    for kind, name in (
        (mujoco.mjtSensor.mjSENS_FORCE, "flange/force"),
        (mujoco.mjtSensor.mjSENS_TORQUE, "flange/torque"),
    ):
        builder.mj.add_sensor(
            name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site.name
        )


def _plug(
    builder: Builder, flange: Any, robot: Robot, tool: Tool, plug: PlugSpec, mass: float
) -> None:
    """The tool in its mount, whose centre of turning is the tip."""
    T_tcp_flange = inverse(tool.T_flange_tcp)
    center = transform(T_tcp_flange, tool.center_of_mass[None])[0]
    body = add_plug(flange, plug, tool.T_flange_tcp, mass, center)
    meshes = [(m, np.asarray(T_tcp_flange @ m.T_link_mesh)) for m in tool.meshes]
    _link(builder, body, robot, robot.n, meshes, "arm/tool", plug.drawn)
    part = Part("arm", robot.name, robot.link_names[robot.n], robot.n)
    add_looks(builder, body, plug.looks, "arm/plug", part)
    add_sleeve(builder, body, plug, part)
    if plug.finger is not None:
        add_finger(builder, part, plug.finger, plug.friction)


def _held(builder: Builder, body: Any, robot: Robot, T_body_flange: Pose) -> None:
    """What the tool holds, and what hangs from it: parts of the arm like its links."""
    for solid in () if robot.tool is None else robot.tool.held:
        part = Part("arm", robot.name, robot.link_names[robot.n], robot.n, solid.material)
        T = np.asarray(T_body_flange @ solid.T_frame_solid)
        builder.solid(body, solid, T, part, group=SEEN, contype=ARM, conaffinity=OTHER)


def _link(
    builder: Builder,
    body: Any,
    robot: Robot,
    link: int,
    meshes: Sequence[tuple[LinkMesh, Pose]],
    prefix: str = "arm",
    drawn: float = np.inf,
) -> None:
    """Meshes of a link, seen and touched; drawn only behind this z of the body."""
    part = Part("arm", robot.name, robot.link_names[link], link)
    for number, (mesh, T) in enumerate(meshes):
        name = f"{prefix}/{link}/{number}/{mesh.path.stem}"
        vertices, faces = _surface(builder, body, part, name, mesh, T, drawn)
        for i, piece in enumerate(convex_pieces(vertices, faces)):
            builder.mj.add_mesh(name=f"{name}/{i}", uservert=piece.ravel(), maxhullvert=48)
            builder.geom(
                body,
                part,
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=f"{name}/{i}",
                pos=T[:3, 3],
                quat=to_wxyz(T),
                **TOUCHING,
            )
    if not meshes:
        capsules = _of_link(robot.capsules, link)
        for start, end, radius in zip(capsules.start, capsules.end, capsules.radius):
            shape = _capsule(start, end, radius)
            material = looks.arm_material(builder.mj, (0.75, 0.77, 0.8))
            builder.geom(body, part, **shape, material=material, contype=0, conaffinity=0)
            builder.geom(body, part, **shape, **TOUCHING)


def _surface(
    builder: Builder, body: Any, part: Part, name: str, mesh: LinkMesh, T: Pose, drawn: float
) -> tuple[Points, Ints]:
    """Draw a mesh in a body, as cameras at work see it and for stills; its vertices and faces."""
    surface = load_mesh(mesh.path)
    vertices, faces = surface.vertices * np.asarray(mesh.scale), np.asarray(surface.faces)
    material = looks.arm_material(builder.mj, mesh.color)
    coarse = mesh.path.parent / "coarse" / mesh.path.name
    group = SEEN
    if coarse.is_file():  # a camera does not see the difference, its renderer does
        group = FINE
        plain = load_mesh(coarse)
        scaled = plain.vertices * np.asarray(mesh.scale)
        shown = _behind(scaled, plain.faces, T, drawn)
        if len(shown):
            builder.visual_mesh(f"{name}/coarse", scaled, shown)
            builder.looks(body, part, f"{name}/coarse", T, material, COARSE)
    shown = _behind(vertices, faces, T, drawn)
    if len(shown):
        builder.visual_mesh(name, vertices, shown)
        builder.looks(body, part, name, T, material, group)
    return vertices, faces


def add_standing_arm(builder: Builder, standing: StandingArmSpec) -> None:
    """Another arm of the catalogue, at rest: seen by its meshes and touched by its capsules."""
    robot, world = standing.robot, builder.mj.worldbody
    part = Part("undeclared", standing.name)
    T_link = standing.T_world_base @ link_poses(robot, standing.q)
    for number, mesh in enumerate(robot.meshes):
        T = np.asarray(T_link[mesh.link] @ mesh.T_link_mesh)
        name = f"{standing.name}/{number}/{mesh.path.stem}"
        _surface(builder, world, part, name, mesh, T, np.inf)
    shapes = robot.capsules
    for link, *ends, radius in zip(shapes.link, shapes.start, shapes.end, shapes.radius):
        start, end = transform(T_link[link], np.array(ends))
        shape = _capsule(start, end, radius)
        builder.geom(world, part, **shape, contype=OTHER, conaffinity=ARM | LIES, group=CONTACT)


def _behind(vertices: Points, faces: Ints, T: Pose, z: float) -> Ints:
    """The triangles that lie wholly before this z of the body do not count."""
    height = transform(T, np.asarray(vertices, float))[:, 2]
    return np.asarray(faces)[~(height[np.asarray(faces)] > z).all(axis=1)]


def _inertia(body: Any, robot: Robot, link: int, with_tool: bool = True) -> None:
    mass, com = float(robot.link_mass[link]), robot.link_com[link]
    inertia = robot.link_inertia[link]
    tool = robot.tool if with_tool else None
    if link == robot.n and tool is not None and tool.mass > 0:
        p = robot.T_last_flange[:3, :3] @ tool.center_of_mass + robot.T_last_flange[:3, 3]
        total = mass + tool.mass
        center = (mass * com + tool.mass * p) / total
        inertia = (
            inertia
            + _point_inertia(mass, com - center)
            + _point_inertia(tool.mass, p - center)
            + np.eye(3) * tool.mass * TOOL_GYRATION**2
        )
        mass, com = total, center
    mass = max(mass, 1e-3)
    set_inertia(body, mass, com, inertia + np.eye(3) * 1e-6 * mass)


def _of_link(capsules: Capsules, link: int) -> Capsules:
    mine = capsules.link == link
    return Capsules(
        capsules.link[mine], capsules.start[mine], capsules.end[mine], capsules.radius[mine]
    )


def _capsule(start: Floats, end: Floats, radius: float) -> dict[str, Any]:
    if np.linalg.norm(end - start) < 1e-6:
        return {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [radius, 0, 0], "pos": start}
    return {
        "type": mujoco.mjtGeom.mjGEOM_CAPSULE,
        "size": [radius, 0, 0],
        "fromto": np.concatenate([start, end]),
    }


def _point_inertia(mass: float, offset: Floats) -> Floats:
    return np.asarray(mass * (offset @ offset * np.eye(3) - np.outer(offset, offset)))
