"""What a rendered scene is made of, without saying who draws it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from armsight.arrays import Bytes, Floats, Points, Pose, Vector3
from armsight.geometry.pose import make_pose

Kind = Literal["box", "cylinder", "capsule", "ellipsoid", "mesh"]
Color = tuple[float, float, float]


@dataclass(frozen=True)
class Surface:
    """How a thing looks.

    Attributes:
        color: RGB 0..1, multiplied with the texture.
        specular, shininess, emission, reflectance: 0..1; only boxes mirror, on their +z side.
        texture: number of the scene's texture, -1 for none.
        repeat: repetitions of the texture a metre.
    """

    color: Color
    specular: float = 0.2
    shininess: float = 0.3
    emission: float = 0.0
    reflectance: float = 0.0
    texture: int = -1
    repeat: float = 1.0


@dataclass(frozen=True)
class Thing:
    """A solid in the scene.

    Attributes:
        kind: of shape.
        size: (3,) half sizes of a box; radii of an ellipsoid; radius, radius, half length of a
            cylinder or of a capsule's straight part, along z [m]; unused by a mesh.
        T_world_thing: its pose.
        surface: its looks.
        label: link + 1 where it is the robot, 0 where it is not.
        mesh: name of the mesh in the painter's store.
    """

    kind: Kind
    size: tuple[float, float, float]
    T_world_thing: Pose
    surface: Surface
    label: int = 0
    mesh: str = ""


@dataclass(frozen=True)
class Lamp:
    """A light.

    Attributes:
        position: in world [m].
        direction: unit vector in world.
        color: of the light, times its strength.
        specular: strength of its reflection.
        cutoff_deg: half angle of its cone.
        exponent: how fast it falls off from the cone's middle.
        attenuation: constant, linear [1/m], quadratic [1/m^2].
        shadow: whether it casts shadows.
    """

    position: Vector3
    direction: Vector3
    color: Color
    specular: float = 0.3
    cutoff_deg: float = 80.0
    exponent: float = 1.0
    attenuation: tuple[float, float, float] = (1.0, 0.0, 0.0)
    shadow: bool = False


@dataclass
class Scene:
    """Everything that is drawn.

    Attributes:
        things: all of them.
        lamps: at most eight.
        ambient: light from everywhere.
        textures: (256, 256, 3) each.
    """

    things: list[Thing] = field(default_factory=list)
    lamps: list[Lamp] = field(default_factory=list)
    ambient: Color = (0.25, 0.25, 0.25)
    textures: list[Bytes] = field(default_factory=list)


def box(center: Floats | tuple[float, ...], half: tuple[float, ...], surface: Surface) -> Thing:
    """An upright box."""
    return Thing("box", (half[0], half[1], half[2]), make_pose(None, center), surface)


def turned_box(T_world_box: Pose, half: tuple[float, ...], surface: Surface) -> Thing:
    """A box in any pose."""
    return Thing("box", (half[0], half[1], half[2]), T_world_box, surface)


def rod(
    start: Vector3, end: Vector3, radius: float, surface: Surface, kind: Kind = "capsule"
) -> Thing:
    """A capsule or cylinder between two points in world."""
    middle, along = 0.5 * (start + end), end - start
    length = float(np.linalg.norm(along))
    T = make_pose(z_to(along), middle)
    return Thing(kind, (radius, radius, max(0.5 * length, 1e-3)), T, surface)


def z_to(direction: Vector3) -> Floats:
    """(3, 3) rotation that turns z into a direction."""
    z = np.asarray(direction, float)
    length = np.linalg.norm(z)
    if length < 1e-9:
        return np.eye(3)
    z = z / length
    helper = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.8 else np.array([0.0, 1.0, 0.0])
    x = cross(helper, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, cross(z, x), z])


def cross(a: Vector3, b: Vector3) -> Vector3:
    """(3,) cross product; a tenth of the time of numpy's, which is made for stacks."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def yaw_pose(yaw: float, position: Floats | tuple[float, ...]) -> Pose:
    """Pose turned about the vertical."""
    c, s = np.cos(yaw), np.sin(yaw)
    return make_pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), position)


def box_gap(points: Points, box: Thing) -> Floats:
    """(n,) distances of points in world from a box's surface [m], negative inside."""
    T = box.T_world_thing
    local = np.abs((points - T[:3, 3]) @ T[:3, :3]) - np.asarray(box.size)
    outside = np.linalg.norm(np.maximum(local, 0.0), axis=1)
    return np.asarray(outside + np.minimum(local.max(axis=1), 0.0))
