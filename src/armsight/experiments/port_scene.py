"""Pictures of charging ports: a parked car's flank, lights, weather, dirt, clutter, a stereo pair.

MuJoCo draws the shapes and their shadows; what its lighting lacks (dirt, drops, mirrored sky,
over-exposure, noise) is laid over the picture afterwards. Everything follows from the seed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import cv2
import numpy as np

from armsight.arrays import Bytes, Pose
from armsight.charging.ports.meshes import Surface, surfaces
from armsight.charging.ports.pocket import flank
from armsight.charging.ports.table import MM, PORTS, Port, drawn
from armsight.experiments.port_surroundings import DECOYS, decoy
from armsight.experiments.port_weather import Style, expose, weather, window_about_port
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy, inverse, look_at, make_pose
from armsight.geometry.stereo import StereoPair
from armsight.simulation import looks
from armsight.simulation.gl import mujoco
from armsight.simulation.model import CellModel
from armsight.simulation.model_movers import NOTHING_MOVES
from armsight.simulation.model_parts import COLOR_ONLY
from armsight.simulation.rendering import Renderer

Light = Literal["indoor", "dim", "low_sun", "overcast", "glare"]
LIGHTS: tuple[Light, ...] = ("indoor", "dim", "low_sun", "overcast", "glare")
HIDDEN = 5
CLUTTER = 10
T_WORLD_PORT = make_pose([[0, 0, 1], [1, 0, 0], [0, 1, 0]], [0.0, 0.0, 3.0])


@dataclass(frozen=True)
class PortView:
    """One situation to be photographed.

    Attributes:
        port: name in the table, or empty for a place without one.
        make: number of the make (its measures are drawn from it).
        distance: from the pair's middle to the port [m].
        off_axis: angle between the port's axis and the line to the pair [rad].
        azimuth: on which side of the axis the pair is, about the axis [rad].
        roll: of the pair about its line of sight [rad].
        aim: (2,) where the port is off the middle of the picture, as a share of half of it.
        light: which.
        seed: of everything else.
    """

    port: str
    make: int
    distance: float
    off_axis: float
    azimuth: float
    roll: float
    aim: tuple[float, float]
    light: Light
    seed: int


@dataclass(frozen=True)
class PortPicture:
    """What both cameras saw, and the truth.

    Attributes:
        images: grey pictures, left and maybe right.
        lenses: of each picture.
        T_camera_port: true pose of the port in each camera.
    """

    images: tuple[Bytes, ...]
    lenses: tuple[PinholeCamera, ...]
    T_camera_port: tuple[Pose, ...]


def random_view(
    rng: np.random.Generator,
    ports: tuple[str, ...],
    distance: tuple[float, float],
    off_axis_deg: tuple[float, float] = (0.0, 45.0),
    aim: float = 0.5,
    roll_deg: float = 20.0,
) -> PortView:
    """A situation drawn at random; the pair stands mostly level, anywhere about the axis."""
    return PortView(
        ports[int(rng.integers(len(ports)))] if ports else "",
        int(rng.integers(4)),
        float(rng.uniform(*distance)),
        float(np.deg2rad(rng.uniform(*off_axis_deg))),
        float(rng.uniform(-np.pi, np.pi)),
        float(np.deg2rad(rng.uniform(-roll_deg, roll_deg))),
        (float(rng.uniform(-aim, aim)), float(rng.uniform(-aim, aim))),
        LIGHTS[int(rng.integers(len(LIGHTS)))],
        int(rng.integers(2**31)),
    )


def pair_pose(view: PortView, pair: StereoPair) -> Pose:
    """``T_world_left`` of the pair that looks at the port as the view says."""
    a, z = view.azimuth, np.cos(view.off_axis)
    s = np.sin(view.off_axis)
    direction = T_WORLD_PORT[:3, :3] @ np.array([s * np.cos(a), s * np.sin(a), z])
    middle = T_WORLD_PORT[:3, 3] + view.distance * direction
    T_left_middle = from_rpy((0.0, -0.5 * pair.toe_in, 0.0), 0.5 * pair.T_left_right[:3, 3])
    T_world_middle = look_at(middle, T_WORLD_PORT[:3, 3]) @ from_rpy((0.0, 0.0, view.roll))
    yaw = np.arctan(view.aim[0] * 0.5 * pair.left.width / pair.left.fx)
    pitch = np.arctan(view.aim[1] * 0.5 * pair.left.height / pair.left.fy)
    return T_world_middle @ from_rpy((pitch, yaw, 0.0)) @ inverse(T_left_middle)


def left_pose(view: PortView, pair: StereoPair, T_left_port: Pose | None) -> Pose:
    """``T_world_left`` of a view, or of a port that stands at a given pose."""
    if T_left_port is None:
        return pair_pose(view, pair)
    return np.asarray(T_WORLD_PORT @ inverse(T_left_port))


class PortStudio:
    """Draws situations; keeps a few compiled scenes, one a make of a port.

    Attributes:
        pair: the lenses.
        samples: of antialiasing.
    """

    def __init__(self, pair: StereoPair, samples: int = 4) -> None:
        self.pair = pair
        self.samples = samples
        self._sets: dict[tuple[str, int], tuple[Any, Any, Renderer]] = {}

    def photograph(
        self,
        view: PortView,
        both: bool = True,
        window: float | None = None,
        T_left_port: Pose | None = None,
    ) -> PortPicture:
        """Pictures of a situation.

        Args:
            view: the situation.
            both: both cameras, or the left one alone.
            window: half the side of what is drawn about the port [m]; None draws all.
            T_left_port: where the port is, instead of where the view says.
        """
        model, data, renderer = self._set(view.port, view.make)
        rng = np.random.default_rng((view.seed, 7))
        style = _dress(model, view, rng)
        mujoco.mj_forward(model, data)
        T_world_left = left_pose(view, self.pair, T_left_port)
        seen = []
        for whole, T in (
            (self.pair.left, np.eye(4)),
            (self.pair.right, self.pair.T_left_right),
        )[: 1 + both]:
            T_world_camera = T_world_left @ T
            pose = inverse(T_world_camera) @ T_WORLD_PORT
            lens = whole if window is None else cut(whole, pose, window)
            shot = renderer.take(data, T_world_camera, lens, "still")
            color = renderer.color(shot, lens)
            renderer.give_back(shot)
            gray = np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), np.float32)
            seen.append((expose(weather(gray, lens, pose, style), style, rng), lens, pose))
        images, lenses, poses = zip(*seen)
        return PortPicture(images, lenses, poses)

    def close(self) -> None:
        """Give OpenGL's memory back."""
        for _, _, renderer in self._sets.values():
            renderer.close()
        self._sets.clear()

    def _set(self, name: str, make: int) -> tuple[Any, Any, Renderer]:
        key = (name, make if name else 0)
        if key not in self._sets:
            if len(self._sets) >= 28:
                self._sets.pop(next(iter(self._sets)))[2].close()
            model = _build(*key)
            empty = np.zeros(0, np.int64)
            cell = CellModel(model, (), empty, (), NOTHING_MOVES, np.zeros(0, np.uint8), 0.0)
            renderer = Renderer(cell, self.samples)
            self._sets[key] = (model, mujoco.MjData(model), renderer)
        return self._sets[key]


def cut(lens: PinholeCamera, T_camera_port: Pose, reach: float) -> PinholeCamera:
    """The part of a lens's picture about the port, as a lens of its own."""
    window = window_about_port(lens, T_camera_port, reach)
    if window is None:
        return lens
    top, bottom, left, right = window
    return replace(
        lens, width=right - left, height=bottom - top, cx=lens.cx - left, cy=lens.cy - top
    )


def made_port(name: str, make: int) -> Port:
    """The make of a port: 0 is the table's own measures."""
    nominal = PORTS[name]
    return nominal if make == 0 else drawn(nominal, np.random.default_rng((make, 11)))


@lru_cache(maxsize=64)
def _meshes(name: str, make: int) -> tuple[Surface, ...]:
    return surfaces(made_port(name, make))


def _build(name: str, make: int) -> Any:
    mj = mujoco.MjSpec()
    mj.compiler.degree = False
    looks.set_up(mj)
    mj.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[6, 6, 0.05],
        pos=[0, 0, -0.05],
        material="floor",
    )
    for look in ("paint", "face", "wall", "floor_dark", "metal", "pocket"):
        mj.add_material(name=f"m_{look}", rgba=[0.1, 0.1, 0.1, 1])
    T = T_WORLD_PORT
    body = mj.worldbody.add_body(name="port", pos=T[:3, 3], quat=[0.5, 0.5, 0.5, 0.5])
    if name:
        material = {"face": "face", "wall": "wall", "floor": "floor_dark", "metal": "metal"}
        for i, surface in enumerate(_meshes(name, make)):
            _add_mesh(mj, body, f"port{i}", surface, f"m_{material[surface.look]}")
        plug = PORTS[name].plug
        if not plug:
            for i, (surface, look) in enumerate(flank(PORTS[name])):
                _add_mesh(mj, body, f"flank{i}", surface, f"m_{look}")
    if not name or PORTS[name].plug:
        body.add_geom(
            name="back",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.9, 0.6, 0.02],
            pos=[0, 0, -0.25],
            material="m_paint",
        )
    for i in range(CLUTTER):
        thing = mj.worldbody.add_body(name=f"clutter{i}")
        mj.add_material(name=f"m_c{i}", rgba=[0.5, 0.5, 0.5, 1])
        thing.add_geom(
            name=f"clutter{i}",
            type=(mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER)[i % 2],
            size=[0.05, 0.05, 0.05],
            material=f"m_c{i}",
        )
    for kind in DECOYS:
        thing = mj.worldbody.add_body(name=f"decoy_{kind}")
        for j, surface in enumerate(decoy(kind)):
            _add_mesh(mj, thing, f"decoy_{kind}{j}", surface, "m_wall" if j % 2 else "m_face")
    blocker = mj.worldbody.add_body(name="blocker")
    blocker.add_geom(
        name="blocker", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.05, 0.5, 0], material="m_metal"
    )
    model = mj.compile()
    for geom in range(model.ngeom):
        model.geom_group[geom] = COLOR_ONLY
    return model


def _add_mesh(mj: Any, body: Any, name: str, surface: Surface, material: str) -> None:
    n = len(surface.vertices)
    if not len(surface.faces):
        return
    mj.add_mesh(
        name=name,
        uservert=surface.vertices.astype(np.float32).ravel(),
        usernormal=surface.normals.astype(np.float32).ravel(),
        userface=surface.faces.astype(np.int32).ravel(),
        userfacenormal=surface.faces.astype(np.int32).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    assert n == len(surface.normals)
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        material=material,
        contype=0,
        conaffinity=0,
    )


def _dress(model: Any, view: PortView, rng: np.random.Generator) -> Style:
    """Colours, lights and things about the port, for one picture."""

    def paint(name: str, gray: float, tint: float, specular: float, shininess: float) -> None:
        m = model.material(name)
        m.rgba[:3] = np.clip(gray * (1 + tint * rng.uniform(-1, 1, 3)), 0.005, 1)
        m.specular[:] = specular
        m.shininess[:] = shininess
        m.texid[:] = -1

    gloss = float(rng.uniform(0.0, 0.7))
    black = float(rng.uniform(0.06, 0.16))
    paint("m_paint", float(rng.uniform(0.08, 0.85)), 0.4, 0.4, 0.7)
    paint("m_face", black, 0.1, gloss, float(rng.uniform(0.1, 0.9)))
    paint("m_wall", black * float(rng.uniform(0.35, 0.7)), 0.1, 0.3 * gloss, 0.4)
    paint("m_floor_dark", black * float(rng.uniform(0.15, 0.4)), 0.1, 0.0, 0.1)
    paint("m_metal", float(rng.uniform(0.4, 0.7)), 0.05, 0.8, 0.6)
    paint("m_pocket", float(rng.uniform(0.05, 0.25)), 0.1, 0.2, 0.3)
    _place_clutter(model, view, rng, paint)
    _set_lights(model, view.light, rng)
    wet = float(rng.uniform(0.3, 1.0)) if rng.random() < 0.25 else 0.0
    return Style(
        gain={"indoor": 1.0, "dim": 0.22, "low_sun": 1.15, "overcast": 1.0, "glare": 1.9}[
            view.light
        ]
        * float(rng.uniform(0.8, 1.3)),
        noise=2.2 if view.light == "dim" else 1.2,
        blur=float(rng.uniform(0.35, 0.75)),
        dirt=float(rng.uniform(0.0, 0.15)),
        wet=wet,
        mirror=float(rng.uniform(0.0, 14.0)) * (1.0 + wet) * gloss,
        shade=float(rng.uniform(0.35, 0.7)) if rng.random() < 0.3 else 1.0,
        seed=view.seed,
    )


def _place_clutter(model: Any, view: PortView, rng: np.random.Generator, paint: Any) -> None:
    """Boxes and cylinders about the port; in empty places round dark things before the wall."""
    for body in range(1, model.nbody):
        name = model.body(body).name
        if name == "port":
            continue
        if name.startswith("clutter"):
            i = int(name[7:])
            paint(f"m_c{i}", float(rng.uniform(0.03, 0.8)), 0.5, 0.3, 0.4)
            model.geom(name).size[:] = rng.uniform(0.015, 0.08, 3)
            angle, far = rng.uniform(-np.pi, np.pi), rng.uniform(0.30, 0.7)
            place = [far * np.cos(angle), far * np.sin(angle), rng.uniform(-0.05, 0.05)]
        elif name.startswith("decoy"):
            show = not view.port or rng.random() < 0.15
            angle = rng.uniform(-np.pi, np.pi)
            far = rng.uniform(0.0, 0.5) if not view.port else rng.uniform(0.28, 0.5)
            place = [far * np.cos(angle), far * np.sin(angle), rng.uniform(-0.2, 0.0)]
            if not show:
                place = [0, 0, -30.0]
        else:  # the shadow of the arm itself, or of a post
            show = view.light == "low_sun" and rng.random() < 0.5
            place = [rng.uniform(-0.25, 0.25), rng.uniform(0.9, 1.5), rng.uniform(1.2, 2.0)]
            if not show:
                place = [0, 0, -30.0]
        T = T_WORLD_PORT @ make_pose(None, place)
        model.body_pos[body] = T[:3, 3]
        turn = from_rpy(rng.uniform(-0.5, 0.5, 3))
        if not name.startswith("decoy"):
            turn = from_rpy(rng.uniform(-np.pi, np.pi, 3))
        R = T_WORLD_PORT @ turn
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(R[:3, :3]).ravel())
        model.body_quat[body] = quat


def _set_lights(model: Any, light: Light, rng: np.random.Generator) -> None:
    """MuJoCo's three lights and the headlight, as the situation wants them."""
    level = {"indoor": 1.0, "dim": 1.0, "low_sun": 0.55, "overcast": 0.9, "glare": 1.0}[light]
    target = T_WORLD_PORT[:3, 3]
    for i in range(model.nlight):
        angle, height = rng.uniform(-1.2, 1.2), rng.uniform(0.15, 1.1)
        if light == "low_sun" and i == 0:
            height = rng.uniform(0.05, 0.35)
        direction = np.array(
            [np.cos(angle) * np.cos(height), np.sin(angle) * np.cos(height), np.sin(height)]
        )
        position = target + 4.0 * direction
        model.light_pos[i] = position
        model.light_dir[i] = -direction
        strength = float(rng.uniform(0.15, 0.5)) * level
        if light == "low_sun" and i == 0:
            strength = float(rng.uniform(0.9, 1.4))
        if light == "overcast":
            strength *= 0.4
        model.light_diffuse[i] = strength
        model.light_specular[i] = 0.6 * strength
        model.light_castshadow[i] = i == 0 and light != "overcast"
    ambient = {"indoor": 0.35, "dim": 0.35, "low_sun": 0.25, "overcast": 0.7, "glare": 0.5}[light]
    model.vis.headlight.ambient[:] = ambient * float(rng.uniform(0.7, 1.2))
    model.vis.headlight.diffuse[:] = float(rng.uniform(0.0, 0.25))


__all__ = ["LIGHTS", "MM", "PortPicture", "PortStudio", "PortView", "made_port", "random_view"]
