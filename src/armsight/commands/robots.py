"""``armsight robots``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Fit:
    """Fit spheres and capsules to an arm of your own, say how well, and keep them beside it.

    Example: armsight robots fit my_arm.urdf
    Example: armsight robots fit ./my_gripper

    Attributes:
        arm: a URDF, or a folder with robot.urdf and robot.toml; or a tool's folder with tool.toml,
            whose shapes are kept in the user's cache.
        fine: take three times as long for a closer fit, as for the catalogue.
    """

    arm: Annotated[Path, tyro.conf.Positional]
    fine: bool = False

    def run(self) -> int:
        """Fit, print, write ``shapes.json``."""
        from armsight.errors import RobotError
        from armsight.robots.folder import QUICK, fit_arm, fit_lines, mark_of, shapes_lines
        from armsight.robots.link_body import FitOptions
        from armsight.robots.own_tool import SHEET, own_tool
        from armsight.robots.shapes import shapes_json
        from armsight.robots.tools import folder_sheet, load_tool
        from armsight.writing import write_text

        if (self.arm / SHEET).is_file():
            tool, sheet = load_tool(f"{self.arm}/"), folder_sheet(own_tool(self.arm))
            print(f"{tool.name}: {tool.mass:g} kg, {len(tool.meshes)} parts")
            for line in fit_lines(tool.spheres, tool.capsules, sheet.sphere_fit, sheet.capsule_fit):
                print(f"  {line}")
            return 0
        robot, shapes, files = fit_arm(self.arm, FitOptions() if self.fine else QUICK)
        print(f"{robot.name}: {robot.n} joints, {len(robot.self_pairs)} pairs of links to check")
        for line in shapes_lines(shapes):
            print(f"  {line}")
        silent = [n for n, mass in zip(robot.link_names, robot.link_mass) if not mass > 0.0]
        if silent:
            print(f"  no <inertial> for {', '.join(silent)}: 1 g each in a simulated cell")
        write_text(
            files.shapes, shapes_json(shapes, robot.link_names, mark_of(self.arm)), RobotError
        )
        print(f"  written to {files.shapes}")
        return 0


@dataclass(frozen=True)
class Listing:
    """List the robots, tools, cameras, drivers and cells that armsight knows.

    Example: armsight robots list
    """

    def run(self) -> int:
        """Print the catalogues."""
        import numpy as np
        from rich.table import Column, Table

        from armsight.commands.terminal import results
        from armsight.devices.camera_models import CAMERA_MODELS
        from armsight.devices.port import GROUPS
        from armsight.robots.report import robots_table, tools_table
        from armsight.workcell.drivers import driver_names
        from armsight.workcell.packaged import packaged

        out = results()
        columns = ("camera", "depth", "field of view", "range", "rate")
        cameras = Table(
            *(Column(name, overflow="fold") for name in columns),
            title="Cameras",
            title_justify="left",
        )
        for key, model in CAMERA_MODELS.items():
            lens = model.depth
            wide = np.rad2deg(2 * np.arctan([lens.width / 2 / lens.fx, lens.height / 2 / lens.fy]))
            cameras.add_row(
                key,
                f"{lens.width}x{lens.height}",
                f"{wide[0]:.0f} x {wide[1]:.0f} deg",
                f"{model.range[0]:g}-{model.range[1]:g} m",
                f"{model.rate:g} Hz",
            )
        out.print(robots_table())
        out.print(tools_table())
        out.print(cameras)
        for kind in GROUPS:
            out.print(f"{kind} drivers: {', '.join(driver_names(kind))}")
        out.print(f"Cells:   {', '.join(packaged())}")
        return 0


@dataclass(frozen=True)
class Robots:
    """List what armsight knows, or fit an arm of your own.

    Example: armsight robots
    Example: armsight robots fit my_arm.urdf

    Attributes:
        action: list if left out.
    """

    action: (
        Annotated[Listing, tyro.conf.subcommand("list")]
        | Annotated[Fit, tyro.conf.subcommand("fit")]
    ) = Listing()

    def run(self) -> int:
        """Run the action."""
        return self.action.run()
