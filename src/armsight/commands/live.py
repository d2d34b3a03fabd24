"""The options of commands that run a cell live."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from armsight.commands.serving import Page


@dataclass(frozen=True)
class Watching:
    """A cell that is watched.

    Attributes:
        workcell: a workcell file, or the name of a packaged cell.
        seconds: how long on the cell's clock; until Ctrl-C if left out.
        headless: no page, and as fast as the machine can.
        record: record everything into this new file (.mcap).
        pictures: of a recording: `small`, less than 100 MB a minute; `whole`, bit for bit.
        seed: of everything random.
        speed: simulated seconds a second; 0 for as fast as the machine can.
        page: where the live page is served.
    """

    workcell: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="WORKCELL")]
    seconds: float | None = None
    headless: bool = False
    record: Path | None = None
    pictures: Literal["small", "whole"] = "small"
    seed: int = 0
    speed: float | None = None
    page: Page = field(default_factory=Page)


@dataclass(frozen=True)
class Working(Watching):
    """A cell in which the arm works.

    Attributes:
        cell_is_empty: you have looked, and nobody is in the cell: what stands there is no person,
            and the arm works around it.
        watch_robots: look in the cameras' colour pictures for arms that no driver announces; what
            stands there counts as somebody who moves.
        json: write the run's figures here; `-` is standard output.
    """

    cell_is_empty: bool = False
    watch_robots: bool = False
    json: Path | None = None
