"""What a port or plug looks like: triangles with normals, one group a look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import Delaunay

from armsight.arrays import Floats, Ints, Points
from armsight.charging.ports.outline import Outline, inside_any, sample_union
from armsight.charging.ports.table import MM, Pin, Port

Look = Literal["face", "wall", "floor", "metal"]
STEP = 0.8 * MM
"""Length of a side of the polygons that stand for round things [m]."""


@dataclass(frozen=True)
class Surface:
    """Triangles of one look.

    Attributes:
        look: ``face`` (towards who looks), ``wall`` and ``floor`` (in a cavity, darker), ``metal``.
        vertices: (n, 3) [m]; normals: (n, 3).
        faces: (k, 3).
    """

    look: Look
    vertices: Points
    normals: Points
    faces: Ints


def surfaces(port: Port) -> tuple[Surface, ...]:
    """All surfaces of a port, in its frame."""
    return _plug(port) if port.plug else _inlet(port)


def _inlet(port: Port) -> tuple[Surface, ...]:
    mouths = [rim.outline for rim in port.of_kind("mouth")]
    wide = [outline.grown(port.chamfer) for outline in mouths]
    pedestals = [rim.outline for rim in port.of_kind("pedestal")]
    recesses = [rim.outline for rim in port.of_kind("recess")]
    top, floor = port.plate_z, -port.depth
    edge = 0.6 * MM
    parts = [
        flat("face", [port.plate], wide, top),
        _wall("face", [port.plate], -0.01, top, outward=True),
        _chamfer("face", wide, mouths, top, top - port.chamfer),
        _wall("wall", mouths, floor, top - port.chamfer, outward=False),
        flat("floor", mouths, pedestals, floor),
    ]
    for outline in pedestals:
        mine = [r for r in recesses if outline.contains(np.array([[r.x, r.y]]))[0]]
        inner = outline.grown(-edge)
        parts.append(flat("face", [inner], mine, 0.0))
        parts.append(_chamfer("face", [outline], [inner], -edge, 0.0))
        parts.append(_wall("wall", [outline], floor, -edge, outward=True))
    for outline in recesses:
        parts.append(_wall("wall", [outline], floor, 0.0, outward=False))
        parts.append(flat("floor", [outline], [], floor))
    parts += [_pin(pin, floor) for pin in port.pins]
    return tuple(parts)


def _plug(port: Port) -> tuple[Surface, ...]:
    bores = [rim.outline for rim in port.of_kind("mouth")]
    sleeves = [port.plate, *(bore.grown(4 * MM) for bore in bores[1:])]
    slim = [outline.grown(-port.chamfer) for outline in sleeves]
    wide = [outline.grown(0.4 * MM) for outline in bores]
    tubes = [rim for rim in port.rims if rim.kind == "pedestal"]
    holes = [rim for rim in port.rims if rim.kind == "recess"]
    top, floor = port.plate_z, -port.depth
    parts = [
        flat("face", slim, wide, top),
        _chamfer("face", sleeves, slim, top - port.chamfer, top),
        _wall("face", sleeves, floor - 20 * MM, top - port.chamfer, outward=True),
        _chamfer("face", wide, bores, top, top - 0.4 * MM),
        _wall("wall", bores, floor, top - 0.4 * MM, outward=False),
        flat("floor", bores, [tube.outline for tube in tubes], floor),
    ]
    for tube, hole in zip(tubes, holes):
        parts.append(flat("face", [tube.outline], [hole.outline], tube.z))
        parts.append(_wall("wall", [tube.outline], floor, tube.z, outward=True))
        parts.append(_wall("wall", [hole.outline], floor, hole.z, outward=False))
        parts.append(flat("floor", [hole.outline], [], floor))
    return tuple(parts)


def flat(look: Look, outer: Sequence[Outline], holes: Sequence[Outline], z: float) -> Surface:
    """A plane with holes, facing +z.

    Points along all borders, closer than the borders are to each other, so that their Delaunay
    triangles do not cross a border.
    """
    borders = [_dense(outer)] + ([_dense(holes)] if holes else [])
    p = np.unique(np.round(np.concatenate(borders), 9), axis=0)
    faces = Delaunay(p).simplices
    middle = p[faces].mean(axis=1)
    faces = faces[inside_any(outer, middle) & ~inside_any(holes, middle)]
    a, b, c = (p[faces[:, i]] for i in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    faces = np.where((area < 0)[:, None], faces[:, ::-1], faces)[np.abs(area) > 1e-14]
    vertices = np.column_stack([p, np.full(len(p), z)])
    return Surface(look, vertices, np.tile([0.0, 0.0, 1.0], (len(p), 1)), faces)


def _dense(outlines: Sequence[Outline]) -> Floats:
    return sample_union(outlines, STEP)[0]


def _wall(
    look: Look, outlines: Sequence[Outline], low: float, high: float, outward: bool
) -> Surface:
    return band(look, outlines, outlines, low, high, outward)


def _chamfer(
    look: Look, below: Sequence[Outline], above: Sequence[Outline], low: float, high: float
) -> Surface:
    """A slope from one outline to another; ``below`` at ``low``, seen from the front."""
    return band(look, below, above, low, high, outward=True, lean=True)


def band(
    look: Look,
    first: Sequence[Outline],
    second: Sequence[Outline],
    z_first: float,
    z_second: float,
    outward: bool,
    lean: bool = False,
) -> Surface:
    """Quads between two nested borders, piece by piece of the first one."""
    vertices, normals, faces, count = [], [], [], 0
    for i, (one, two) in enumerate(zip(first, second)):
        p, n = one.sample(STEP)
        q = _nearest_on(two, p, n)
        others = [o for j, o in enumerate(first) if j != i]
        bare = ~inside_any(others, p, 1e-9)
        k = len(p)
        following = np.roll(np.arange(k), -1)
        keep = bare & bare[following]
        facing = n if outward else -n
        if lean:
            rise = z_second - z_first
            run = np.einsum("ij,ij->i", q - p, n)
            slope = np.column_stack([n * rise, -run])
            slope *= np.where(slope[:, 2:] < 0, -1.0, 1.0)
            normal = slope / np.linalg.norm(slope, axis=1, keepdims=True)
        else:
            normal = np.column_stack([facing, np.zeros(k)])
        vertices += [np.column_stack([p, np.full(k, z_first)])]
        vertices += [np.column_stack([q, np.full(k, z_second)])]
        normals += [normal, normal]
        a, b = np.flatnonzero(keep), following[keep]
        quads = np.concatenate([np.stack([a, b, b + k], 1), np.stack([a, b + k, a + k], 1)])
        faces.append(quads + count)
        count += 2 * k
    v, m, f = np.concatenate(vertices), np.concatenate(normals), np.concatenate(faces)
    turned = np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
    wrong = np.einsum("ij,ij->i", turned, m[f].mean(axis=1)) < 0
    f[wrong] = f[wrong][:, ::-1]
    return Surface(look, v, m, f)


def _nearest_on(outline: Outline, points: Floats, normals: Floats) -> Floats:
    """Where the normal of each point of a parallel curve meets an outline."""
    p, _ = outline.sample(0.25 * STEP)
    offset = p[None] - points[:, None]
    across = np.abs(offset[..., 0] * normals[:, None, 1] - offset[..., 1] * normals[:, None, 0])
    far = np.linalg.norm(offset, axis=-1)
    best = np.argmin(across + 0.5 * far, axis=1)
    return np.asarray(p[best])


def _pin(pin: Pin, floor: float) -> Surface:
    """A contact pin with a round end."""
    r, turns = 0.5 * pin.diameter, 24
    angle = np.linspace(0, 2 * np.pi, turns, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    rows, normals = [], []
    for height, radius, nz in (
        (floor, r, 0.0),
        (pin.z - r, r, 0.0),
        (pin.z - 0.5 * r, 0.87 * r, 0.5),
        (pin.z - 0.13 * r, 0.5 * r, 0.87),
        (pin.z, 0.0, 1.0),
    ):
        rows.append(np.column_stack([ring * radius + [pin.x, pin.y], np.full(turns, height)]))
        normals.append(np.column_stack([ring * np.sqrt(1 - nz * nz), np.full(turns, nz)]))
    a = np.arange(turns)
    b = np.roll(a, -1)
    faces = [
        np.concatenate(
            [
                np.stack([a + k * turns, b + k * turns, b + (k + 1) * turns], 1),
                np.stack([a + k * turns, b + (k + 1) * turns, a + (k + 1) * turns], 1),
            ]
        )
        for k in range(len(rows) - 1)
    ]
    return Surface("metal", np.concatenate(rows), np.concatenate(normals), np.concatenate(faces))
