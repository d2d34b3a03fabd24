"""The catalogue's tables."""

from __future__ import annotations

import io

from rich.console import Console

from armsight.robots import ROBOT_NAMES, TOOL_NAMES
from armsight.robots.report import robots_table, tools_table


def test_tables_name_everything_with_its_fit():
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(robots_table())
    console.print(tools_table())
    text = console.export_text()
    for name in (*ROBOT_NAMES, *TOOL_NAMES):
        assert name in text
    measured = text.count("100 %") - len(TOOL_NAMES)
    assert measured + text.count("not measured") == 2 * len(ROBOT_NAMES)
    assert measured >= 4
    for licence in ("BSD-3-Clause", "Apache-2.0", "MIT"):
        assert licence in text
