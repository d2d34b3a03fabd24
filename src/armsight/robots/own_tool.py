"""A tool of the user's own: a folder with ``tool.toml`` and, where there are any, its meshes.

It is turned, once, into a folder such as those of the catalogue (shapes fitted, everything in the
flange's frame), which is kept in the user's cache under a hash of the files it was made from.
"""

from __future__ import annotations

import hashlib
import json
import logging
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from armsight.arrays import Floats, Pose
from armsight.errors import RobotError
from armsight.geometry.pose import from_rpy
from armsight.robots.fit_cache import cache_folder
from armsight.robots.fit_quality import measure, report
from armsight.robots.fitting import fit_body
from armsight.robots.folder import QUICK
from armsight.robots.link_body import FitOptions, NeighbourLinks, prepare
from armsight.robots.meshes import Triangles, geometry_triangles, join_triangles
from armsight.robots.shapes import FitReport
from armsight.robots.sheet import read_toml
from armsight.robots.urdf import Geometry
from armsight.writing import write_text

SHEET = "tool.toml"
VERSION = 1
"""Raised when the same files make another folder."""
LARGEST = 1.5
"""No point of a tool is further from the flange [m]."""
OPTIONS = replace(QUICK, voxel=0.003, spacing=0.005, check_spacing=0.002, sphere_price=2e-9)

Finite = Annotated[float, Field(allow_inf_nan=False)]
Triple = tuple[Finite, Finite, Finite]
Length = Annotated[float, Field(gt=0.0, le=LARGEST)]
Channel = Annotated[float, Field(ge=0.0, le=1.0)]

_log = logging.getLogger("armsight")


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Part(_Table):
    """Where something is in the flange's frame: metres, degrees about fixed x, y, z."""

    position: Triple = (0.0, 0.0, 0.0)
    rpy_deg: Triple = (0.0, 0.0, 0.0)
    color: tuple[Channel, Channel, Channel] = (0.35, 0.37, 0.40)

    @property
    def T_flange_part(self) -> Pose:
        return from_rpy(np.deg2rad(self.rpy_deg), self.position)


class _Mesh(_Part):
    file: str
    scale: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = 1.0


class _Box(_Part):
    size: tuple[Length, Length, Length]


class _Cylinder(_Part):
    radius: Length
    length: Length


class _Sphere(_Part):
    radius: Length


class _Sheet(_Table):
    tip: Triple
    tip_rpy_deg: Triple = (0.0, 0.0, 0.0)
    mass: Annotated[float, Field(gt=0.0, le=100.0)]
    center_of_mass: Triple
    title: str = ""
    mesh: tuple[_Mesh, ...] = ()
    box: tuple[_Box, ...] = ()
    cylinder: tuple[_Cylinder, ...] = ()
    sphere: tuple[_Sphere, ...] = ()


@dataclass(frozen=True)
class ToolShapes:
    """What covers a tool, and how well.

    Attributes:
        balls: (k, 4) centres and radii [m]; rods: (m, 7) both ends and radii [m].
        ball_fit, rod_fit: of each.
    """

    balls: Floats
    rods: Floats
    ball_fit: FitReport
    rod_fit: FitReport


def fit_tool(triangles: Triangles, options: FitOptions, spacing: float) -> ToolShapes:
    """Spheres and capsules that cover a tool; the fit is measured every ``spacing`` metres."""
    body = prepare(triangles, options, NeighbourLinks())
    axes, radius = fit_body(body, options, "balls")
    balls = np.column_stack([axes.start, radius])
    ball_fit = report([measure(body, axes, radius, spacing)])
    axes, radius = fit_body(body, options, "segments")
    rods = np.column_stack([axes.start, axes.end, radius])
    rod_fit = report([measure(body, axes, radius, spacing)])
    return ToolShapes(balls, rods, ball_fit, rod_fit)


def own_tool(folder: Path) -> Path:
    """The folder, in the catalogue's form, of a tool of the user's own; made if need be.

    Raises:
        RobotError: a file is missing or broken, a part is no part of a tool, or the cache cannot be
            written; says which and what to do.
    """
    sheet = _read(folder)
    parts = _geometries(folder, sheet)
    made = cache_folder().with_name("tools") / _mark(folder, sheet) / folder.resolve().name
    if not (made / "tool.json").is_file():
        _make(folder, made, sheet, parts)
    return made


def _read(folder: Path) -> _Sheet:
    path = folder / SHEET
    if not folder.is_dir():
        raise RobotError(f"{folder}: no such folder; a tool of your own is a folder with {SHEET}")
    if not path.is_file():
        raise RobotError(f"{folder}: no {SHEET} in it; docs/robots.md shows one")
    try:
        sheet = _Sheet.model_validate(read_toml(path))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(p) for p in first["loc"])
        raise RobotError(f"{path}: {where}: {first['msg']}") from None
    for key, place in (("tip", sheet.tip), ("center_of_mass", sheet.center_of_mass)):
        if (far := float(np.linalg.norm(place))) > LARGEST:
            raise RobotError(
                f"{path}: {key} is {far:.3g} m from the flange, at most {LARGEST:g} m is a tool; "
                "give metres"
            )
    if not (sheet.mesh or sheet.box or sheet.cylinder or sheet.sphere):
        raise RobotError(f"{path}: has no [[mesh]], [[box]], [[cylinder]] or [[sphere]]: no body")
    return sheet


def _geometries(folder: Path, sheet: _Sheet) -> list[Geometry]:
    out = []
    for mesh in sheet.mesh:
        path, scale = folder / mesh.file, (mesh.scale,) * 3
        if not path.is_file():
            raise RobotError(f"{folder / SHEET}: mesh {path} is missing; put it there")
        out.append(Geometry("mesh", scale, mesh.T_flange_part, mesh.color, path))
    for box in sheet.box:
        out.append(Geometry("box", box.size, box.T_flange_part, box.color))
    for rod in sheet.cylinder:
        size = (rod.radius, rod.length, 0.0)
        out.append(Geometry("cylinder", size, rod.T_flange_part, rod.color))
    for ball in sheet.sphere:
        out.append(Geometry("sphere", (ball.radius, 0.0, 0.0), ball.T_flange_part, ball.color))
    return out


def _mark(folder: Path, sheet: _Sheet) -> str:
    digest = hashlib.sha256(f"{VERSION}\n{sheet.model_dump_json()}\n".encode())
    for mesh in sheet.mesh:
        try:
            digest.update((folder / mesh.file).read_bytes())
        except OSError as error:
            raise RobotError(f"{folder / mesh.file}: cannot be read ({error.strerror})") from None
    return digest.hexdigest()[:32]


def _make(folder: Path, made: Path, sheet: _Sheet, parts: list[Geometry]) -> None:
    solids: list[Triangles] = []
    for geometry in parts:
        vertices, faces = geometry_triangles(geometry)
        far = float(np.linalg.norm(vertices, axis=1).max())
        if far > LARGEST:
            hint = "; is it in millimetres? then say scale = 0.001" if far > 20.0 else ""
            name = geometry.kind if geometry.path is None else geometry.path.name
            raise RobotError(
                f"{folder / SHEET}: {name} reaches {far:.3g} m from the flange, at most "
                f"{LARGEST:g} m is a tool{hint}"
            )
        solids.append((vertices, faces))
    _log.info("Fitting shapes to %s, once.", folder)
    shapes = fit_tool(join_triangles(solids), OPTIONS, 0.003)
    tip = from_rpy(np.deg2rad(sheet.tip_rpy_deg), sheet.tip)
    meshes = []
    for index, (geometry, solid) in enumerate(zip(parts, solids)):
        name = f"{made.name}_{index}.obj"
        write_text(made / name, _obj(solid, made.name), RobotError)
        meshes.append({"file": name, "color": list(geometry.color)})
    data = {
        "title": sheet.title or made.name,
        "license": "your own",
        "origin": str(folder),
        "T_flange_tcp": tip.tolist(),
        "mass": sheet.mass,
        "center_of_mass": list(sheet.center_of_mass),
        "meshes": meshes,
        "spheres": shapes.balls.tolist(),
        "capsules": shapes.rods.tolist(),
        "fit": {"spheres": asdict(shapes.ball_fit), "capsules": asdict(shapes.rod_fit)},
    }
    write_text(made / "tool.json", json.dumps(data, indent=1) + "\n", RobotError)


def _obj(solid: Triangles, name: str) -> str:
    vertices, faces = solid
    lines = [f"# {name}"]
    lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    return "\n".join(lines) + "\n"
