"""Make the tools' folders of ``src/armsight/robots/data/tools``.

Tools are built from primitives with the dimensions below; the Panda's hand comes from the meshes of
example-robot-data. Needs what ``convert_robots.py`` needs::

    PYTHONPATH=src python scripts/make_tools.py \
        --example-robot-data example_robot_data-6.0.0-0-py3-none-any.whl

writes, for each tool, ``tool.json`` (tip, mass, colours, spheres, capsules, how well they fit) and
one OBJ file a colour, in the flange's frame: z outward along the tool's axis.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from convert_robots import DATA
from robot_sources.parts import Color, Part, extract, find, read_collada
from robot_sources.writing import decimate, obj_text
from trimesh.creation import box, capsule, cylinder, icosphere

from armsight.charging.ports.collision import sleeves
from armsight.charging.ports.meshes import surfaces
from armsight.charging.ports.outline import sample_union
from armsight.charging.ports.table import PORTS
from armsight.geometry.pose import from_rpy, make_pose, transform
from armsight.robots.link_body import FitOptions
from armsight.robots.meshes import join_triangles
from armsight.robots.own_tool import fit_tool

TOOLS = DATA / "tools"
ALUMINIUM, DARK, BLACK, WHITE = (
    (0.72, 0.73, 0.75),
    (0.22, 0.23, 0.25),
    (0.07, 0.07, 0.08),
    (0.95,) * 3,
)
GREEN = (0.25, 0.65, 0.35)
STEEL = (0.55, 0.56, 0.58)
LOOKS = {"face": BLACK, "wall": (0.05, 0.05, 0.055), "floor": (0.05, 0.05, 0.055), "metal": STEEL}


@dataclass
class Draft:
    """A tool before fitting; see ``armsight.robots.Tool``."""

    title: str
    tip: np.ndarray
    mass: float
    center_of_mass: tuple[float, float, float]
    origin: str = "made for armsight from primitives"
    license: str = "Apache-2.0"
    license_text: str = ""
    sphere_price: float = 1e-9
    capsule_price: float = 5e-10
    meshes: list[tuple[Color, trimesh.Trimesh]] = field(default_factory=list)
    drawn_instead: dict[int, list[Part]] = field(default_factory=dict)

    def add(self, color: Color, mesh: trimesh.Trimesh, T: np.ndarray | None = None) -> None:
        """One more body, placed in the flange's frame."""
        if T is not None:
            mesh.apply_transform(T)
        self.meshes.append((color, mesh))


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """A shift [m]."""
    return make_pose(None, [x, y, z])


def rod(radius: float, length: float, sections: int = 32) -> trimesh.Trimesh:
    """A cylinder along z that begins at z = 0 [m]."""
    mesh = cylinder(radius, length, sections=sections)
    mesh.apply_translation([0, 0, 0.5 * length])
    return mesh


def gripper() -> Draft:
    """Two parallel fingers, open 85 mm along y: the size of a Robotiq 2F-85 with its coupling."""
    tool = Draft("two-finger gripper, open 85 mm", at(z=0.150), 1.0, (0.0, 0.0, 0.06))
    tool.add(ALUMINIUM, rod(0.0375, 0.014))
    tool.add(DARK, box((0.060, 0.072, 0.066)), at(z=0.014 + 0.033))
    tool.add(DARK, box((0.040, 0.110, 0.020)), at(z=0.086))
    for side in (-1, 1):
        tilt = from_rpy([-side * 0.12, 0, 0], [0, side * 0.054, 0.106])
        tool.add(ALUMINIUM, box((0.027, 0.014, 0.036)), tilt)
        tool.add(BLACK, box((0.022, 0.012, 0.044)), at(y=side * 0.0485, z=0.140))
    return tool


def pen() -> Draft:
    """A steel rod with a ball of 10 mm at its end, on a plate."""
    tool = Draft("rod with a 10 mm ball at its tip", at(z=0.150), 0.25, (0.0, 0.0, 0.03))
    tool.add(ALUMINIUM, rod(0.0315, 0.010))
    tool.add(ALUMINIUM, rod(0.012, 0.030), at(z=0.010))
    tool.add(STEEL, rod(0.004, 0.106), at(z=0.040))
    tool.add((0.8, 0.1, 0.1), icosphere(subdivisions=3, radius=0.005), at(z=0.145))
    return tool


def straw_cup() -> Draft:
    """A cup held upright beside the tool's axis when that is level, and its straw to the tip (V).

    The straw bends at its lid; what bends it further is the stiffness that the cell declares.
    """
    tool = Draft("cup with a straw, in its holder", at(z=0.150), 0.45, (0.0, 0.015, 0.055))
    tool.add(ALUMINIUM, rod(0.0315, 0.010))
    tool.add(ALUMINIUM, box((0.030, 0.030, 0.020)), at(z=0.018))
    upright = from_rpy([-math.pi / 2, 0, 0], [0, -0.020, 0.058])
    tool.add(WHITE, rod(0.030, 0.085), upright)
    straw = capsule(height=0.0796, radius=0.003, count=(12, 12))
    tool.add(GREEN, straw, from_rpy([-0.2507, 0, 0], [0, -0.0106, 0.1085]))
    return tool


def calibration_board() -> Draft:
    """T1's board: 7x5 squares of 30 mm, one corner hollow, on an A4 plate facing along the tool.

    The tip is the print's middle: x along the seven squares, z out of the paper towards who reads.
    """
    height, square, rim = 0.060, 0.030, 0.22
    tool = Draft(
        "calibration board on a bracket, A4, 7x5 squares of 30 mm",
        at(z=height),
        0.55,
        (0.0, 0.0, 0.040),
        sphere_price=2e-8,
        capsule_price=1e-8,
    )
    tool.add(ALUMINIUM, rod(0.0315, 0.008))
    tool.add(ALUMINIUM, box((0.050, 0.030, height - 0.013)), at(z=0.008 + 0.5 * (height - 0.013)))
    tool.add(WHITE, box((0.297, 0.210, 0.005)), at(z=height - 0.0025))
    for i in range(7):
        for j in range(5):
            if (i + j) % 2 == 0:
                x, y = (i - 3) * square, -(j - 2) * square
                for w, h, dx, dy in tile(square, rim if i == j == 0 else 0.5):
                    tool.add(BLACK, box((w, h, 0.0002)), at(x + dx, y + dy, height + 0.0001))
    return tool


def tile(square: float, rim: float) -> list[tuple[float, float, float, float]]:
    """A dark square as (width, height, shift x, shift y); a frame where the rim is below half."""
    if rim >= 0.5:
        return [(square, square, 0.0, 0.0)]
    r = rim * square
    inner, shift = square - 2 * r, 0.5 * (square - r)
    return [
        (square, r, 0.0, shift),
        (square, r, 0.0, -shift),
        (r, inner, shift, 0.0),
        (r, inner, -shift, 0.0),
    ]


def sphere_marker() -> Draft:
    """V's marker for registering cameras: a ball of 150 mm on a rod; the tip is its centre."""
    tool = Draft("ball of 150 mm on a rod, a marker for cameras", at(z=0.250), 0.4, (0, 0, 0.15))
    tool.add(ALUMINIUM, rod(0.0315, 0.010))
    tool.add(ALUMINIUM, rod(0.010, 0.180), at(z=0.010))
    tool.add((0.85, 0.30, 0.05), icosphere(subdivisions=4, radius=0.075), at(z=0.250))
    return tool


def plug(name: str, mass: float) -> Draft:
    """A vehicle plug by the table of measures, hollow, in a holder of 20 cm.

    The tip is the frame of ``charging/ports``: the middle of the mouth, z out of it, y up.
    """
    port = PORTS[name]
    tool = Draft(f"{port.title.split(' (')[0]} in its holder", at(z=0.200), mass, (0.0, 0.0, 0.140))
    tool.add(ALUMINIUM, rod(0.040, 0.012))
    tool.add(ALUMINIUM, rod(0.026, 0.052), at(z=0.012))
    tool.add(DARK, rod(0.034, 0.084), at(z=0.062))
    around = [sample_union([outline], 0.002)[0] for outline in sleeves(port)]
    ends = [np.column_stack([p, np.full(len(p), z)]) for p in around for z in (0.144, 0.200)]
    sleeve = trimesh.convex.convex_hull(np.concatenate(ends))
    tool.add(BLACK, sleeve)
    cable = capsule(height=0.060, radius=0.0125, count=(24, 24))
    tool.add(BLACK, cable, from_rpy([math.pi / 2, 0, 0], [0, -0.020, 0.085]))
    tool.drawn_instead = {
        id(sleeve): [
            Part(LOOKS[s.look], transform(at(z=0.200), s.vertices), s.faces) for s in surfaces(port)
        ]
    }
    return tool


def panda_hand(example: Path) -> Draft:
    """The Panda's own hand, fingers open; its frame is turned by -45 deg about the flange's z."""
    meshes = find(example, "meshes/visual/hand.dae").parent
    T_flange_hand = from_rpy([0, 0, -math.pi / 4])
    tool = Draft(
        "Franka hand, fingers open 80 mm",
        T_flange_hand @ at(z=0.1034),
        0.76,
        tuple(transform(T_flange_hand, np.array([[-0.01, 0.0, 0.03]]))[0]),
        origin="frankaemika/franka_ros, branch noetic-devel, franka_description",
        license_text=(meshes.parents[1] / "LICENSE").read_text(),
    )
    for stem, T in (
        ("hand", np.eye(4)),
        ("finger", at(y=0.04, z=0.0584)),
        ("finger", from_rpy([0, 0, math.pi], [0, -0.04, 0.0584])),
    ):
        for part in read_collada(meshes / f"{stem}.dae", 1.0):
            mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
            tool.add(part.color, mesh, T_flange_hand @ T)
    return tool


def main() -> None:
    """Make the tools named, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*")
    parser.add_argument("--example-robot-data", type=Path, help="wheel, for the Panda's hand")
    parser.add_argument("--out", type=Path, default=TOOLS)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if args.example_robot_data is not None:
            extract(args.example_robot_data, Path(folder), ("/panda_description/",))
        makers: dict[str, Callable[[], Draft]] = {
            "gripper": gripper,
            "panda_hand": lambda: panda_hand(Path(folder)),
            "pen": pen,
            "sphere_marker": sphere_marker,
            "straw_cup": straw_cup,
            "calibration_board": calibration_board,
            "type1_plug": lambda: plug("type1_plug", 1.3),
            "type2_plug": lambda: plug("type2_plug", 1.6),
            "ccs2_plug": lambda: plug("ccs2_plug", 2.0),
        }
        for name in args.names or makers:
            write(makers[name](), args.out / name)


def write(tool: Draft, folder: Path) -> None:
    """Fit the shapes and write all files of one tool."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.obj"):
        old.unlink()
    by_color: dict[Color, list[Part]] = {}
    solids: list[tuple[np.ndarray, np.ndarray]] = []
    plain: dict[Color, list[Part]] = {}
    for color, mesh in tool.meshes:
        solid = Part(color, np.asarray(mesh.vertices), np.asarray(mesh.faces))
        solids.append((solid.vertices, solid.faces))
        drawn = tool.drawn_instead.get(id(mesh))
        for part in [solid] if drawn is None else drawn:
            by_color.setdefault(part.color, []).append(part)
            coarse = plain.setdefault(part.color, [])
            if not any(known is solid for known in coarse):
                coarse.append(solid)
    files, full = [], solids if tool.drawn_instead else []
    for i, (color, parts) in enumerate(by_color.items()):
        joined = Part(color, *join_triangles([(p.vertices, p.faces) for p in parts]))
        name = f"{folder.name}_{i}.obj"
        files.append({"file": name, "color": [round(float(c), 3) for c in color]})
        if tool.drawn_instead:  # depth cameras do not see the difference, their renderer does
            (folder / "coarse").mkdir(exist_ok=True)
            rough = [(p.vertices, p.faces) for p in plain[color]]
            small = Part(color, *join_triangles(rough))
            (folder / "coarse" / name).write_text(obj_text(small, folder.name, "see tool.json"))
            (folder / name).write_text(obj_text(joined, folder.name, "see tool.json"))
        else:
            small = decimate(joined, 0.0001)
            (folder / name).write_text(obj_text(small, folder.name, "see tool.json"))
            full += [(joined.vertices, joined.faces), (small.vertices, small.faces)]
    options = FitOptions(
        restarts=2,
        voxel=0.0015,
        spacing=0.004,
        check_spacing=0.0012,
        sphere_price=tool.sphere_price,
        capsule_price=tool.capsule_price,
    )
    shapes = fit_tool(join_triangles(full), options, 0.002)
    data = {
        "title": tool.title,
        "license": tool.license,
        "origin": tool.origin,
        "T_flange_tcp": np.round(tool.tip, 9).tolist(),
        "mass": tool.mass,
        "center_of_mass": [round(float(v), 6) for v in tool.center_of_mass],
        "meshes": files,
        "spheres": np.round(shapes.balls, 5).tolist(),
        "capsules": np.round(shapes.rods, 5).tolist(),
        "fit": {"spheres": asdict(shapes.ball_fit), "capsules": asdict(shapes.rod_fit)},
    }
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in data.items()]
    text = "{\n" + ",\n".join(lines) + "\n}\n"
    (folder / "tool.json").write_text(text.replace("], [", "],\n  ["))
    if tool.license_text:
        (folder / "LICENSE").write_text(tool.license_text)
    print(
        f"{folder.name}: {len(shapes.balls)} spheres {shapes.ball_fit}\n"
        f"  {len(shapes.rods)} capsules {shapes.rod_fit}",
        flush=True,
    )


if __name__ == "__main__":
    main()
