"""Builds the MuJoCo model of a cell from its :class:`WorldSpec`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from armsight.arrays import Bytes, Floats, Ints, Points, Pose, Poses
from armsight.geometry.pose import to_wxyz
from armsight.geometry.shapes import Solid
from armsight.robots.robot import Capsules, LinkMesh, Robot
from armsight.simulation import looks
from armsight.simulation.board import BoardUnit
from armsight.simulation.gl import mujoco
from armsight.simulation.hulls import convex_pieces, load_mesh
from armsight.simulation.people import BodyPart, PersonBody
from armsight.simulation.spec import MovingObjectSpec, WorldSpec

Kind = Literal["arm", "static", "undeclared", "person", "object", "floor"]

SEEN, COARSE, COLOR_ONLY, CONTACT, FINE, DEPTH_ONLY = range(6)
"""Geom groups: seen in all pictures; meshes for cameras at work; what is for colour alone; what
only touches; meshes for stills; what is for depth alone."""
ARM, OTHER = 1, 2  # contact bits: the arm touches others, others never each other
TOUCH_ONLY: dict[str, Any] = {
    "priority": 1,
    "solimp": [1e-4, 1e-4, 1e-3, 0.5, 2.0],
    "solref": [-1e-9, -1e-6],  # negative: stiffness and damping themselves, here next to none
}
"""People and movers are noticed when touched but do not push the arm, since they follow their own
motion whatever the arm does and would push with unlimited force."""
SERVO_BANDWIDTH = 120.0
"""[rad/s] of the position loop; the arm then follows its reference within a milliradian."""
ROTOR = (0.1, 0.3)
"""Inertia of a motor seen through its gear: a constant [kg m^2] and a share of the joint's
(assumption; a hundredfold gear makes rotors weigh about as much as the links)."""


@dataclass(frozen=True)
class Part:
    """What a geom belongs to.

    Attributes:
        kind: arm, static, undeclared, person, object or floor.
        owner: name of the arm, solid, person or object.
        part: name of the link or body part, or empty.
        link: index of the arm's link, -1 for all else.
        material: the solid's material.
    """

    kind: Kind
    owner: str
    part: str = ""
    link: int = -1
    material: str = "plain"


@dataclass(frozen=True)
class CellModel:
    """The compiled model and where things are in it.

    Attributes:
        model: MuJoCo's model.
        parts: one a geom.
        link_bodies: (n + 1,) body of each link.
        person_bodies: mocap index of the first part of each person.
        object_bodies: mocap index of each moving object.
        materials: code of each geom's material, its place in :data:`MATERIALS`.
        greatest_load: torque that the arm's weight asks of a joint [N m].
        wrench: places in ``sensordata`` of the flange's force and torque, or None.
    """

    model: Any
    parts: tuple[Part, ...]
    link_bodies: Ints
    person_bodies: tuple[int, ...]
    object_bodies: tuple[int, ...]
    materials: Bytes
    greatest_load: float
    wrench: tuple[int, int] | None = None


def build_model(
    spec: WorldSpec,
    people: Sequence[PersonBody],
    T_link_joint_true: Poses,
    board: BoardUnit | None = None,
) -> CellModel:
    """Compile the cell.

    Args:
        spec: of the cell.
        people: bodies of ``spec.people``, in order.
        T_link_joint_true: (n, 4, 4) the arm's true geometry.
        board: a calibration board as it truly hangs.
    """
    mj = mujoco.MjSpec()
    mj.modelname = "cell"
    mj.compiler.degree = False
    mj.compiler.autolimits = True
    mj.option.timestep = spec.time_step
    mj.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    mj.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    mj.option.impratio = 10.0
    looks.set_up(mj)
    builder = _Builder(mj)
    if spec.floor:
        builder.floor()
    for solid in spec.static:
        builder.solid(mj.worldbody, solid, solid.T_frame_solid, "static")
    for solid in spec.undeclared:
        builder.solid(mj.worldbody, solid, solid.T_frame_solid, "undeclared")
    link_names = builder.arm(
        spec.arm.robot, spec.arm.T_world_base, T_link_joint_true, spec.wrench is not None, board
    )
    people_first = tuple(builder.person(person) for person in people)
    objects_first = tuple(builder.moving_object(item) for item in spec.objects)
    _add_servos(mj, spec.arm.robot)
    model = mj.compile()
    n = spec.arm.robot.n
    inertia, load = _greatest_inertia(model, spec.arm.robot)
    model.dof_armature[:n] = ROTOR[0] + ROTOR[1] * inertia
    mujoco.mj_setConst(model, mujoco.MjData(model))
    inertia = inertia + model.dof_armature[:n]
    kp = inertia * SERVO_BANDWIDTH**2
    # what the URDF says of the drives, but no less than their accelerations ask for
    limits = spec.arm.robot.limits
    torque = 3.0 * inertia * limits.acceleration + 5.0
    if limits.effort is not None:
        torque = np.fmax(torque, limits.effort)
    model.actuator_gainprm[:n, 0] = kp
    model.actuator_biasprm[:n, 1] = -kp
    kv = 2.0 * kp / SERVO_BANDWIDTH
    model.actuator_gainprm[n:, 0] = kv
    model.actuator_biasprm[n:, 2] = -kv
    model.jnt_actfrcrange[:n] = np.stack([-torque, torque], axis=1)
    model.jnt_actfrclimited[:n] = True
    parts = tuple(builder.parts[model.geom(i).name] for i in range(model.ngeom))
    materials = np.array([MATERIALS.index(part.material) for part in parts], np.uint8)
    return CellModel(
        model,
        parts,
        np.array([model.body(name).id for name in link_names]),
        tuple(int(model.body(name).mocapid[0]) for name in people_first),
        tuple(int(model.body(name).mocapid[0]) for name in objects_first),
        materials,
        load,
        None
        if spec.wrench is None
        else (int(model.sensor("flange/force").adr[0]), int(model.sensor("flange/torque").adr[0])),
    )


MATERIALS = ("plain", "black_plastic", "shiny")
"""Materials that the sensors tell apart, in the order of their codes."""


TOOL_GYRATION = 0.03
"""Radius of gyration that is assumed of a tool [m]."""


class _Builder:
    """Adds things to a model's specification and remembers what each geom is."""

    def __init__(self, mj: Any) -> None:
        self.mj = mj
        self.parts: dict[str, Part] = {}

    def floor(self) -> None:
        """A plane to stand on.

        MuJoCo draws planes in pieces, for the lights' sake: an endless one in thousands, which
        takes half of a picture's time. So colour sees as far as the haze lets it, depth a slab.
        """
        what = Part("floor", "floor")
        self._geom(
            self.mj.worldbody,
            what,
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0.0, 0.0, 0.1],  # without end
            conaffinity=ARM,
            contype=OTHER,
            group=CONTACT,
        )
        self._geom(
            self.mj.worldbody,
            what,
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[20.0, 20.0, 1.0],  # the last is the edge of a piece
            material="floor",
            contype=0,
            conaffinity=0,
            group=COLOR_ONLY,
        )
        self._geom(
            self.mj.worldbody,
            what,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[40.0, 40.0, 0.05],
            pos=[0.0, 0.0, -0.05],
            contype=0,
            conaffinity=0,
            group=DEPTH_ONLY,
        )

    def solid(
        self, body: Any, solid: Solid, T: Pose, kind: Kind, owner: str = "", **options: Any
    ) -> None:
        kinds = {
            "box": (mujoco.mjtGeom.mjGEOM_BOX, 0.5 * np.asarray(solid.size)),
            "cylinder": (
                mujoco.mjtGeom.mjGEOM_CYLINDER,
                np.array([solid.size[0], 0.5 * solid.size[1], 0.0]),
            ),
            "sphere": (mujoco.mjtGeom.mjGEOM_SPHERE, np.array([solid.size[0], 0.0, 0.0])),
        }
        geom_type, size = kinds[solid.kind]
        self._geom(
            body,
            Part(kind, owner or solid.name, material=solid.material),
            type=geom_type,
            size=size,
            pos=T[:3, 3],
            quat=to_wxyz(T),
            material=looks.solid_material(self.mj, solid),
            contype=OTHER,
            conaffinity=ARM,
            **options,
        )

    def arm(
        self,
        robot: Robot,
        T_world_base: Pose,
        T_link_joint: Poses,
        sensing: bool,
        board: BoardUnit | None = None,
    ) -> tuple[str, ...]:
        """The links; with a force sensor the tool is a body of its own, else part of the last."""
        carried = board if board is not None and board.mounted_on == "flange" else None
        if board is not None and carried is None:
            self._board(self.mj.worldbody, Part("static", "board"), board, np.eye(4))
        body = self.mj.worldbody
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
            self._inertia(body, robot, link, with_tool=not sensing)
            meshes = [(m, m.T_link_mesh) for m in robot.meshes if m.link == link]
            if link == robot.n and carried is not None and not sensing:
                # The tool's drawn plate hangs where it was designed, the board where it truly does.
                part = Part("arm", robot.name, robot.link_names[link], link)
                self._board(body, part, carried, robot.T_last_flange)
            elif link == robot.n and tool is not None and not sensing:
                meshes += [(m, robot.T_last_flange @ m.T_link_mesh) for m in tool.meshes]
            self._link(body, robot, link, meshes)
        if sensing:
            self._flange(body, robot, carried)
        return tuple(names)

    def _board(self, body: Any, part: Part, board: BoardUnit, T_body_mount: Pose) -> None:
        """The plate behind the print; the print itself is cast onto pictures."""
        center, half = board.plate
        T = T_body_mount @ board.T_mount_board
        self._geom(
            body,
            part,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=half,
            pos=T[:3, :3] @ center + T[:3, 3],
            quat=to_wxyz(T),
            material=looks.arm_material(self.mj, (0.9, 0.9, 0.9)),
            group=SEEN,
            contype=ARM if part.kind == "arm" else OTHER,
            conaffinity=OTHER if part.kind == "arm" else ARM,
        )

    def _flange(self, last: Any, robot: Robot, board: BoardUnit | None) -> None:
        """What hangs on the force sensor."""
        T, tool = robot.T_last_flange, robot.tool
        body = last.add_body(name="arm/flange", pos=T[:3, 3], quat=to_wxyz(T), gravcomp=1.0)
        mass = 1e-3 if tool is None else max(tool.mass, 1e-3)
        center = np.zeros(3) if tool is None else tool.center_of_mass
        _set_inertia(body, mass, center, np.eye(3) * mass * TOOL_GYRATION**2)
        if board is not None:
            part = Part("arm", robot.name, robot.link_names[robot.n], robot.n)
            self._board(body, part, board, np.eye(4))
        elif tool is not None:
            meshes = [(m, m.T_link_mesh) for m in tool.meshes]
            if meshes:
                self._link(body, robot, robot.n, meshes, "arm/tool")
        site = body.add_site(name="flange")
        for kind, name in (
            (mujoco.mjtSensor.mjSENS_FORCE, "flange/force"),
            (mujoco.mjtSensor.mjSENS_TORQUE, "flange/torque"),
        ):
            self.mj.add_sensor(
                name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site.name
            )

    def _link(
        self,
        body: Any,
        robot: Robot,
        link: int,
        meshes: Sequence[tuple[LinkMesh, Pose]],
        prefix: str = "arm",
    ) -> None:
        part = Part("arm", robot.name, robot.link_names[link], link)
        for number, (mesh, T) in enumerate(meshes):
            surface = load_mesh(mesh.path)
            vertices, faces = surface.vertices * np.asarray(mesh.scale), np.asarray(surface.faces)
            name = f"{prefix}/{link}/{number}/{mesh.path.stem}"
            material = looks.arm_material(self.mj, mesh.color)
            coarse = mesh.path.parent / "coarse" / mesh.path.name
            group = SEEN
            if coarse.is_file():  # a camera does not see the difference, its renderer does
                group = FINE
                plain = load_mesh(coarse)
                scaled = plain.vertices * np.asarray(mesh.scale)
                self._visual_mesh(f"{name}/coarse", scaled, plain.faces)
                self._looks(body, part, f"{name}/coarse", T, material, COARSE)
            self._visual_mesh(name, vertices, faces)
            self._looks(body, part, name, T, material, group)
            for i, piece in enumerate(convex_pieces(vertices, faces)):
                self.mj.add_mesh(name=f"{name}/{i}", uservert=piece.ravel(), maxhullvert=48)
                self._geom(
                    body,
                    part,
                    type=mujoco.mjtGeom.mjGEOM_MESH,
                    meshname=f"{name}/{i}",
                    pos=T[:3, 3],
                    quat=to_wxyz(T),
                    **_TOUCHING,
                )
        if not meshes:
            capsules = _of_link(robot.capsules, link)
            for start, end, radius in zip(capsules.start, capsules.end, capsules.radius):
                shape = _capsule(start, end, radius)
                material = looks.arm_material(self.mj, (0.75, 0.77, 0.8))
                self._geom(body, part, **shape, material=material, contype=0, conaffinity=0)
                self._geom(body, part, **shape, **_TOUCHING)

    def _inertia(self, body: Any, robot: Robot, link: int, with_tool: bool = True) -> None:
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
        _set_inertia(body, mass, com, inertia + np.eye(3) * 1e-6 * mass)

    def person(self, person: PersonBody) -> str:
        first = ""
        for part in person.parts:
            name = f"person/{person.name}/{part.name}"
            first = first or name
            body = self.mj.worldbody.add_body(name=name, mocap=True, pos=[0, 0, -10])
            self._body_part(body, person.name, part)
        return first

    def _body_part(self, body: Any, person: str, part: BodyPart) -> None:
        """One mesh to see for each look, and convex pieces to touch, of the same surfaces."""
        what = Part("person", person, part.name)
        looks_of: dict[str, list[tuple[Points, Ints]]] = {}
        for piece in part.lofts:
            vertices, faces = piece.mesh()
            looks_of.setdefault(piece.look, []).append((vertices, faces))
            for i, hull in enumerate(convex_pieces(vertices, faces, piece.pieces)):
                if piece.pieces > 0:
                    name = f"{person}/{part.name}/{piece.name}/{i}"
                    self.mj.add_mesh(name=name, uservert=hull.ravel())
                    self._geom(
                        body,
                        what,
                        type=mujoco.mjtGeom.mjGEOM_MESH,
                        meshname=name,
                        group=CONTACT,
                        **_TOUCHED,
                    )
        for look, meshes in looks_of.items():
            name = f"{person}/{part.name}/{look}"
            self._visual_mesh(name, *joined(meshes))
            material = looks.cloth_material(self.mj, look, person)
            self._looks(body, what, name, np.eye(4), material, SEEN)

    def _looks(self, body: Any, part: Part, mesh: str, T: Pose, material: str, group: int) -> None:
        """A mesh that is seen and touches nothing."""
        self._geom(
            body,
            part,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=mesh,
            pos=T[:3, 3],
            quat=to_wxyz(T),
            material=material,
            contype=0,
            conaffinity=0,
            group=group,
        )

    def _visual_mesh(self, name: str, vertices: Points, faces: Ints) -> None:
        self.mj.add_mesh(
            name=name,
            uservert=np.asarray(vertices).ravel(),
            userface=np.asarray(faces).ravel().astype(np.int32),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )

    def moving_object(self, item: MovingObjectSpec) -> str:
        name = f"object/{item.solid.name}"
        T = item.solid.T_frame_solid
        body = self.mj.worldbody.add_body(name=name, mocap=True, pos=T[:3, 3], quat=to_wxyz(T))
        self.solid(
            body,
            item.solid,
            np.eye(4),
            "object",
            **TOUCH_ONLY,
        )
        return name

    def _geom(self, body: Any, part: Part, **options: Any) -> None:
        name = f"{len(self.parts)}"
        self.parts[name] = part
        body.add_geom(name=name, **options)


_TOUCHING: dict[str, Any] = {
    "contype": ARM,
    "conaffinity": OTHER,
    "group": CONTACT,
    "friction": [0.4, 0.005, 0.0001],
}
_TOUCHED: dict[str, Any] = {"contype": OTHER, "conaffinity": ARM, **TOUCH_ONLY}


def joined(meshes: Sequence[tuple[Points, Ints]]) -> tuple[Points, Ints]:
    """Several meshes as one."""
    counts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [f + count for (_, f), count in zip(meshes, counts)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


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


def _set_inertia(body: Any, mass: float, center: Floats, inertia: Floats) -> None:
    i = inertia
    body.explicitinertial = True
    body.mass = mass
    body.ipos = center
    body.fullinertia = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]


def _add_servos(mj: Any, robot: Robot) -> None:
    """A position servo a joint, then a velocity servo a joint; gains follow the inertia."""
    for kind in ("position", "velocity"):
        for name in robot.joint_names:
            servo = mj.add_actuator(
                name=f"{kind}/{name}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"arm/{name}"
            )
            servo.gaintype = mujoco.mjtGain.mjGAIN_FIXED
            servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE


def _greatest_inertia(model: Any, robot: Robot) -> tuple[Floats, float]:
    """Greatest inertia of each joint [kg m^2] and greatest load [N m] over random poses."""
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    n = robot.n
    inertia, load = np.zeros(n), 0.0
    full = np.zeros((model.nv, model.nv))
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    for _ in range(64):
        data.qpos[:n] = rng.uniform(lower, upper)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        inertia = np.maximum(inertia, np.diag(full)[:n])
        load = max(load, float(np.abs(data.qfrc_gravcomp[:n]).max()))
    return inertia, load
