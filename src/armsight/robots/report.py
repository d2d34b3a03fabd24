"""The catalogue of robots and tools as tables, for ``armsight robots`` and the docs."""

from __future__ import annotations

import math

import numpy as np
from rich.table import Column, Table

from armsight.arrays import JointVector
from armsight.robots.catalogue import ROBOT_NAMES, load_robot, robot_shapes, robot_sheet
from armsight.robots.shapes import FitReport
from armsight.robots.tools import TOOL_NAMES, load_tool, tool_sheet


def robots_table() -> Table:
    """Every arm: what the maker says, and how well its shapes fit its meshes."""
    table = Table(
        Column("robot", no_wrap=True),
        *_folded(
            "joints",
            "reach\nmm",
            "payload\nkg",
            "joint range\ndeg",
            "joint speed\ndeg/s",
            "spheres\ncover, over p50/p95 mm",
            "capsules\ncover, over p50/p95 mm",
            "licence",
        ),
        title="Robots",
        title_justify="left",
    )
    for name in ROBOT_NAMES:
        robot, sheet, shapes = load_robot(name), robot_sheet(name), robot_shapes(name)
        table.add_row(
            name,
            str(robot.n),
            f"{1e3 * robot.reach:.0f}",
            f"{sheet.payload:g}",
            _ranges(robot.limits.lower, robot.limits.upper),
            _span(np.rad2deg(robot.limits.velocity)),
            _fit(len(shapes.spheres.radius), shapes.sphere_fit),
            _fit(len(shapes.capsules.radius), shapes.capsule_fit),
            sheet.license,
        )
    return table


def tools_table() -> Table:
    """Every tool: what it is, its mass and tip, and how well its shapes fit."""
    table = Table(
        *_folded(
            "tool", "what", "mass\nkg", "tip\nmm", "spheres\ncover, over p50/p95 mm", "licence"
        ),
        title="Tools (or none)",
        title_justify="left",
    )
    for name in TOOL_NAMES:
        tool, sheet = load_tool(name), tool_sheet(name)
        table.add_row(
            name,
            sheet.title,
            f"{tool.mass:g}",
            f"{1e3 * tool.T_flange_tcp[2, 3]:.0f}",
            _fit(len(tool.spheres.radius), sheet.sphere_fit),
            sheet.license,
        )
    return table


def _folded(*names: str) -> list[Column]:
    """Columns that lose nothing in a narrow terminal: figures go on in the next line."""
    return [Column(name, overflow="fold") for name in names]


def _fit(count: int, fit: FitReport | None) -> str:
    if fit is None or fit.samples == 0:
        return f"{count}: not measured"
    over = f"{1e3 * fit.overshoot_median:.1f}/{1e3 * fit.overshoot_p95:.1f}"
    covered = math.floor(1000 * fit.coverage) / 10  # 100 % means all
    return f"{count}: {covered:g} %, {over}"


def _span(values: JointVector) -> str:
    low, high = round(float(values.min())), round(float(values.max()))
    return f"{low}" if low == high else f"{low}-{high}"


def _ranges(lower: JointVector, upper: JointVector) -> str:
    if np.allclose(-lower, upper):
        return f"±{_span(np.rad2deg(upper))}"
    return f"{np.rad2deg(lower.min()):.0f} to {np.rad2deg(upper.max()):.0f}"
