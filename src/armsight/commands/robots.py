"""``armsight robots``."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Robots:
    """List the robots, tools, cameras, drivers and cells that armsight knows.

    Example: armsight robots
    """

    def run(self) -> int:
        """Print the catalogues."""
        import numpy as np
        from rich.console import Console
        from rich.table import Table

        from armsight.devices.camera_models import CAMERA_MODELS
        from armsight.robots.report import robots_table, tools_table
        from armsight.workcell.drivers import driver_names
        from armsight.workcell.packaged import packaged

        out = Console()
        cameras = Table(
            "camera",
            "depth",
            "field of view",
            "range",
            "rate",
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
        out.print(f"Drivers: {', '.join(driver_names())}")
        out.print(f"Cells:   {', '.join(packaged())}")
        return 0
