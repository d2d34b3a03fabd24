"""The simulated car's port and the plug: their shapes, from the table of measures.

The one place of this room that knows what ports and cars look like (``charging``).
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from armsight.arrays import Pose
from armsight.charging.ports.collision import plug_contours, socket_contours
from armsight.charging.ports.meshes import Surface, surfaces
from armsight.charging.ports.pocket import flank
from armsight.charging.ports.table import PORTS, drawn, port
from armsight.charging.vehicle_file import VehicleShape, load_vehicle, packaged
from armsight.errors import UsageError, WorkcellError
from armsight.geometry.pose import inverse, make_pose
from armsight.robots.tools import load_tool
from armsight.simulation.spec import CableSpec, FingerSpec, LidSpec, Look, PlugSpec, SocketSpec
from armsight.workcell.schema import Workcell
from armsight.workcell.schema_devices import PlugSection
from armsight.workcell.schema_things import CarSection

PLUG_OF = {"type1": "type1_plug", "type2": "type2_plug", "ccs2": "ccs2_plug"}
"""Which plug enters which inlet."""
PORT = "port"
"""Owner of the walls that a plug touches, and nothing else."""
PAINT = (0.32, 0.38, 0.45)
"""Of a car that no file describes."""
LOOKS = {
    "face": ((0.10, 0.10, 0.105), 0.3),
    "wall": (
        (0.055, 0.055, 0.06),
        0.15,
    ),
    "floor": ((0.03, 0.03, 0.03), 0.0),
    "metal": ((0.55, 0.54, 0.50), 0.7),
    "paint": (PAINT, 0.4),
    "pocket": ((0.13, 0.13, 0.135), 0.15),
}
"""Colour and gloss of surfaces."""


def plug_spec(workcell: Workcell) -> PlugSpec | None:
    """The plug as physics has it; None where the flange carries none.

    Raises:
        WorkcellError: there is no such plug, or nothing feels it.
    """
    section, file = workcell.plug, workcell.file or workcell.name
    if section is None:
        return None
    try:
        shape = port(section.kind)
    except UsageError as error:
        raise WorkcellError(f"{file}: plug.kind: {error}") from None
    if not shape.plug:
        known = ", ".join(name for name, entry in PORTS.items() if entry.plug)
        raise WorkcellError(f"{file}: plug.kind: {section.kind} is an inlet; plugs are {known}")
    if workcell.robot.tool == "none" or workcell.wrench is None:
        raise WorkcellError(f"{file}: [plug] needs a [wrench] and robot.tool: what the plug is")
    check_tool(workcell)
    contours = plug_contours(shape)
    stiffness = (1e3 * section.mount_n_per_mm, section.mount_nm_per_rad)
    finger = _finger(workcell, section)
    hung = None
    if section.hanger is not None:
        hung = CableSpec(
            section.hanger,
            section.cable_m,
            section.cable_kg_per_m,
            section.cable_nm2,
            0.5e-3 * section.cable_mm,
        )
    seen = tuple(_look(surface, surface.look, "plain") for surface in surfaces(shape))
    return PlugSpec(
        contours.capsules,
        contours.radius,
        stiffness,
        section.cable_n,
        finger=finger,
        hung=hung,
        looks=seen,
        drawn=min(float(look.vertices[:, 2].min()) for look in seen) - 0.5e-3,
    )


def check_tool(workcell: Workcell) -> None:
    """That the flange does not carry another plug than the one that is plugged in.

    Raises:
        WorkcellError: it does; its weight and tip would be the other one's.
    """
    section, tool = workcell.plug, workcell.robot.tool
    if section is not None and tool in PORTS and tool != section.kind:
        raise WorkcellError(
            f"{workcell.file or workcell.name}: plug.kind is {section.kind}, and robot.tool is "
            f"{tool}: name the same plug"
        )


def _finger(workcell: Workcell, section: PlugSection) -> FingerSpec | None:
    T = finger_pose(section)
    if T is None:
        return None
    if workcell.gripper is None:
        raise WorkcellError(
            f"{workcell.file or workcell.name}: plug.finger_mm needs a [gripper], which draws the "
            "finger back by its opening"
        )
    T_flange_plug = load_tool(workcell.robot.tool).T_flange_tcp
    return FingerSpec(np.asarray(inverse(T_flange_plug) @ T), workcell.gripper.opening)


def finger_pose(section: PlugSection) -> Pose | None:
    """``T_flange_tip`` of the finger that is out, z along it, x away from the plug; None: none."""
    if section.finger_mm is None:
        return None
    p = 1e-3 * np.asarray(section.finger_mm)
    away = float(np.hypot(p[0], p[1]))
    c, s = (1.0, 0.0) if away < 1e-6 else (float(p[0]) / away, float(p[1]) / away)
    return make_pose([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], p)


def socket_spec(workcell: Workcell) -> SocketSpec | None:
    """The parked car's port; None where there is no car.

    Raises:
        WorkcellError: there is no such inlet.
    """
    section, file = workcell.simulation.car, workcell.file or workcell.name
    if section is None:
        return None
    if section.port not in PORTS or PORTS[section.port].plug:
        known = ", ".join(name for name, entry in PORTS.items() if not entry.plug)
        raise WorkcellError(
            f"{file}: simulation.car.port: no inlet {section.port}; there are {known}"
        )
    vehicle = vehicle_of(workcell, section.vehicle)
    if vehicle is not None and vehicle.inlet != section.port:
        raise WorkcellError(
            f"{file}: simulation.car: {section.vehicle} has {vehicle.inlet}, not {section.port}"
        )
    plug = PORTS[PLUG_OF.get(section.port, "type1_plug")]
    depth = plug.depth
    if section.blocked_mm is not None:
        depth = min(depth, section.blocked_mm / 1e3)
    walls = socket_contours(plug, section.clearance_mm / 1e3, section.chamfer_mm / 1e3, depth)
    return SocketSpec(
        PORT,
        section.pose,
        walls.boxes,
        walls.half,
        _looks(
            section.port,
            section.make,
            PAINT if vehicle is None else vehicle.color,
            vehicle is None or vehicle.lid is None,
        ),
        () if vehicle is None else vehicle.solids,
        section.friction,
        section.mated_n,
        lid=_lid(section, vehicle),
    )


def _lid(section: CarSection, vehicle: VehicleShape | None) -> LidSpec | None:
    if vehicle is None or vehicle.lid is None:
        return None
    latch = vehicle.lid.latch
    return LidSpec(
        vehicle.T_port_lid,
        section.lid_latch if latch == "unknown" else latch,
        section.lid_holds_n,
        stuck=0.0 if section.lid == "stuck" else None,
        there=section.lid != "missing",
        color=vehicle.color,
    )


def vehicle_of(workcell: Workcell, given: str) -> VehicleShape | None:
    """The vehicle of a file or a packaged name; None where the cell names none.

    Args:
        workcell: files are sought beside its own.
        given: what the cell says.

    Raises:
        WorkcellError: its file is not there, or says what cannot be.
    """
    if not given:
        return None
    beside = Path() if workcell.file is None else Path(workcell.file).parent
    try:
        return load_vehicle(given if given in packaged() else beside / given)
    except UsageError as error:
        raise WorkcellError(f"{workcell.file or workcell.name}: {error}") from None


@lru_cache(maxsize=8)
def _looks(
    name: str, make: int, paint: tuple[float, float, float], pocket: bool
) -> tuple[Look, ...]:
    """What the port and, with a pocket, the side about it look like.

    Under a lid there is no pocket of its own: the edges of the car's solids are that of the lid.
    """
    nominal = PORTS[name]
    made = nominal if make == 0 else drawn(nominal, np.random.default_rng((make, 11)))
    looks = [_look(surface, surface.look, "black_plastic") for surface in surfaces(made)]
    for surface, look in flank(nominal) if pocket else ():
        made_so = _look(surface, look, "")
        looks.append(replace(made_so, color=paint) if look == "paint" else made_so)
    return tuple(looks)


def _look(surface: Surface, look: str, material: str) -> Look:
    color, gloss = LOOKS[look]
    return Look(surface.vertices, surface.normals, surface.faces, color, gloss, material)


__all__ = ["PLUG_OF", "CarSection", "check_tool", "plug_spec", "socket_spec", "vehicle_of"]
