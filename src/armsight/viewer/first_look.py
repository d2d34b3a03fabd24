"""Where a newcomer stands who opens the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import viser

from armsight.arrays import Mask, Points, Pose, Vector3
from armsight.geometry.pose import transform
from armsight.geometry.shapes import Solid
from armsight.viewer.solids import is_wall
from armsight.workcell import Cell

AROUND: Final = np.array(
    [(np.cos(a), np.sin(a)) for a in np.deg2rad(np.arange(-180.0, 180.0, 5.0))]
)
"""(n, 2) horizontal directions from which a newcomer may look."""


def first_look(server: viser.ViserServer, cell: Cell) -> None:
    """Where a newcomer stands: a little above, looking at the arm, between the cameras."""
    T = cell.T_world_base
    fixed = [c.info for c in cell.cameras if c.info.mounted_on == "base"]
    places = transform(T, np.array([c.T_mount_camera[:3, 3] for c in fixed]).reshape(-1, 3))
    if not cell.robot.n:  # a scanned place: stand behind the camera that scanned it
        target = transform(T, np.array([[0.0, 0.0, 0.6]]))[0]
        away = 1.5 * (places[0] - target) if len(places) else np.array([2.0, -2.0, 1.5])
        eye = target + away + 0.45 * np.array([-away[1], away[0], 0.0])
    else:
        reach = max(cell.robot.reach, 0.6)
        target = T[:3, 3] + np.array([0.45 * reach, 0.0, 0.1 * reach])
        eyes = target + reach * np.column_stack([3.2 * AROUND, np.full(len(AROUND), 1.5)])
        solids = _hiding(cell)
        blocked = hidden(target, eyes, solids)
        car = cell.workcell.simulation.car
        if car is not None:  # whoever parks a car wants to see its port
            blocked = blocked | edge_on(car.pose, eyes)
        eye = eyes[clearest_view(places - target, blocked)]
    server.initial_camera.look_at = tuple(target)
    server.initial_camera.position = tuple(eye)
    server.initial_camera.fov = float(np.deg2rad(42.0))


def clearest_view(cameras: Points, blocked: Mask) -> int:
    """Which direction of :data:`AROUND` has no camera before the arm; best near the front right.

    Args:
        cameras: (n, 3) places, seen from what is looked at [m].
        blocked: (n,) directions from which something hides the arm: only where all are.
    """
    angles = np.arctan2(AROUND[:, 1], AROUND[:, 0])
    seen = np.arctan2(cameras[:, 1], cameras[:, 0])
    apart = np.abs(np.angle(np.exp(1j * (angles[:, None] - seen)))).min(axis=1, initial=np.pi)
    liked = 0.35 * np.cos(angles - np.deg2rad(-60.0))
    return int(np.argmax(np.minimum(apart, 0.6) + liked - 10.0 * blocked))


def edge_on(T_world_face: Pose, eyes: Points) -> Mask:
    """(n,) whether eyes [m] see a face, which looks along its z, by more than 60 deg askew."""
    away = eyes - T_world_face[:3, 3]
    return np.asarray(away @ T_world_face[:3, 2] < 0.5 * np.linalg.norm(away, axis=1))


def hidden(target: Vector3, eyes: Points, solids: Sequence[Solid]) -> Mask:
    """(n,) whether a solid (in world) stands between a target and each of (n, 3) eyes [m]."""
    share = np.linspace(0.05, 1.0, 60)[:, None, None]
    along = (target + share * (eyes - target)).reshape(-1, 3)
    inside = np.zeros(len(along), bool)
    for solid in solids:
        inside |= solid.distance(along) < 0.0
    return np.asarray(inside.reshape(len(share), -1).any(axis=0))


def _hiding(cell: Cell) -> list[Solid]:
    """Solids in world that one cannot look through: all but walls, a simulated car's as well."""
    T = cell.T_world_base
    solids = [replace(s, T_frame_solid=T @ s.T_frame_solid) for s in cell.static]
    if cell.world is not None:
        solids += [replace(m.solid, T_frame_solid=m.T_world_solid) for m in cell.world.movers()]
    return [s for s in solids if not is_wall(s)]
