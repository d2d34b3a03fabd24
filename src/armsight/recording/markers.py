"""Solids as visualisation markers and back: what stands in the cell, and who moves in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armsight.devices.world import MovingSolid, MovingSurfaces
from armsight.geometry.shapes import ShapeKind, Solid, Surface
from armsight.recording.messages import (
    MARKERS,
    encode,
    header,
    make,
    point_message,
    pose_message,
    pose_of,
)

_TYPES: dict[ShapeKind, int] = {"box": 1, "sphere": 2, "cylinder": 3}
_KINDS: dict[int, ShapeKind] = {number: kind for kind, number in _TYPES.items()}
_TRIANGLES = 11
_ADD, DELETE_ALL = 0, 3
_NO_BYTES = np.zeros(0, np.uint8)


def encode_solids(solids: Sequence[Solid], stamp: float, frame: str, opacity: float = 1.0) -> bytes:
    """MarkerArray of solids posed in ``frame``; each marker's text is the solid's name."""
    markers = [_solid(i, s, s.T_frame_solid, stamp, frame, opacity) for i, s in enumerate(solids)]
    return encode(make(MARKERS, markers=markers))


def encode_movers(movers: Sequence[MovingSolid], stamp: float, *, fresh: bool) -> bytes:
    """MarkerArray of movers in ``world``; ``fresh`` clears those that are gone."""
    markers = [
        _solid(i, mover.solid, mover.T_world_solid, stamp, "world", 1.0, mover.name)
        for i, mover in enumerate(movers)
    ]
    if fresh:
        markers.insert(0, marker(0, stamp, "world", action=DELETE_ALL))
    return encode(make(MARKERS, markers=markers))


def encode_looks(bodies: Sequence[MovingSurfaces], stamp: float) -> bytes:
    """MarkerArray of triangles: each surface in the frame of its body, which ``/tf`` moves."""
    markers: list[Any] = []
    for body in bodies:
        for surface in body.surfaces:
            corners = surface.vertices[surface.faces].reshape(-1, 3)
            markers.append(
                marker(
                    len(markers),
                    stamp,
                    body.name,
                    kind=_TRIANGLES,
                    color=(*surface.color, 1.0),
                    text=surface.name,
                    points=[point_message(corner) for corner in corners],
                )
            )
    return encode(make(MARKERS, markers=markers))


def decode_looks(message: Any) -> dict[str, tuple[Surface, ...]]:
    """Surfaces by body."""
    looks: dict[str, tuple[Surface, ...]] = {}
    for marker in message.markers:
        if int(marker.type) != _TRIANGLES:
            continue
        corners = np.array([[p.x, p.y, p.z] for p in marker.points], np.float32).reshape(-1, 3)
        vertices, faces = np.unique(corners, axis=0, return_inverse=True)
        color = (float(marker.color.r), float(marker.color.g), float(marker.color.b))
        surface = Surface(marker.text, vertices, faces.reshape(-1, 3), color)
        name = marker.header.frame_id
        looks[name] = (*looks.get(name, ()), surface)
    return looks


def decode_movers(message: Any) -> tuple[MovingSolid, ...]:
    """The movers of a MarkerArray."""
    movers = []
    for marker in message.markers:
        kind = _KINDS.get(int(marker.type))
        if int(marker.action) != _ADD or kind is None:
            continue
        scale = (float(marker.scale.x), float(marker.scale.y), float(marker.scale.z))
        size = {
            "box": scale,
            "sphere": (0.5 * scale[0], 0.0, 0.0),
            "cylinder": (0.5 * scale[0], scale[2], 0.0),
        }[kind]
        color = (float(marker.color.r), float(marker.color.g), float(marker.color.b))
        pose = pose_of(marker.pose)
        movers.append(MovingSolid(marker.text, Solid(marker.text, kind, size, pose, color), pose))
    return tuple(movers)


def _solid(
    number: int,
    solid: Solid,
    pose: Any,
    stamp: float,
    frame: str,
    opacity: float,
    name: str | None = None,
) -> Any:
    a, b, c = solid.size
    scale = {"box": (a, b, c), "sphere": (2 * a, 2 * a, 2 * a), "cylinder": (2 * a, 2 * a, b)}
    return marker(
        number,
        stamp,
        frame,
        kind=_TYPES[solid.kind],
        pose=pose_message(pose),
        scale=scale[solid.kind],
        color=(*solid.color, opacity),
        text=solid.name if name is None else name,
    )


def marker(
    number: int,
    stamp: float,
    frame: str,
    *,
    kind: int = 1,
    action: int = _ADD,
    pose: Any = None,
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0),
    color: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    text: str = "",
    points: Sequence[Any] = (),
    colors: Sequence[tuple[float, float, float, float]] = (),
) -> Any:
    """A visualization_msgs/Marker; ``colors`` are of the points, where each has its own."""
    point = make("geometry_msgs/msg/Point", x=0.0, y=0.0, z=0.0)
    upright = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    red, green, blue, alpha = (float(value) for value in color)
    x, y, z = (float(value) for value in scale)
    return make(
        "visualization_msgs/msg/Marker",
        header=header(stamp, frame),
        ns="armsight",
        id=number,
        type=kind,
        action=action,
        pose=pose or make("geometry_msgs/msg/Pose", position=point, orientation=upright),
        scale=make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
        color=make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=alpha),
        lifetime=make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        frame_locked=kind == _TRIANGLES,
        points=list(points),
        colors=[make("std_msgs/msg/ColorRGBA", r=r, g=g, b=b, a=a) for r, g, b, a in colors],
        texture_resource="",
        texture=make(
            "sensor_msgs/msg/CompressedImage",
            header=header(stamp, frame),
            format="",
            data=_NO_BYTES,
        ),
        uv_coordinates=[],
        text=text,
        mesh_resource="",
        mesh_file=make("visualization_msgs/msg/MeshFile", filename="", data=_NO_BYTES),
        mesh_use_embedded_materials=False,
    )
