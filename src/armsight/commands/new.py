"""``armsight new``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class New:
    """Start a workcell file from the commented blank.

    Example: armsight new my_cell.toml --robot ur10
    Example: armsight new my_cell.toml --robot ./my_arm.urdf

    Attributes:
        file: to write; never overwrites one.
        robot: key of the robot catalogue (`armsight robots`), or path of an arm of your own.
        name: of the cell; the file's name if left out.
    """

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    robot: str = "ur5"
    name: str | None = None

    def run(self) -> int:
        """Write the file, whole or not at all."""
        import json
        import os
        import shlex

        from armsight.commands.running import say
        from armsight.errors import UsageError
        from armsight.robots import ROBOT_NAMES
        from armsight.robots.catalogue import is_path
        from armsight.workcell import parse_workcell
        from armsight.workcell.packaged import folder
        from armsight.workcell.problems import nearest
        from armsight.writing import write_text

        own = is_path(self.robot)
        if not own and self.robot not in ROBOT_NAMES:
            raise UsageError(f'unknown robot "{self.robot}"; {nearest(self.robot, ROBOT_NAMES)}')
        file = self.file if self.file.suffix else self.file.with_suffix(".toml")
        if os.path.lexists(file):
            raise UsageError(f"{file} exists already; choose another name, or remove it first")
        text = (folder() / "blank.toml").read_text(encoding="utf-8")
        text = text.replace('name = "blank"', f'name = "{self.name or cell_name(file)}"')
        folder_of_cell = file.parent.resolve()
        # In the file a path begins where the file lies; here, where one stands.
        arm = self.robot
        if own and not Path(arm).is_absolute():
            arm = f"./{os.path.relpath(arm, folder_of_cell)}"
        text = text.replace('model = "ur5"', f"model = {json.dumps(arm, ensure_ascii=False)}")
        # A bad --name or arm is told before anything is written.
        parse_workcell(text, str(file), folder_of_cell)
        write_text(file, text)
        # What begins with a dash would be taken for an option.
        typed = f"./{file}" if str(file).startswith("-") else str(file)
        say(f"wrote {file}; edit it, then: armsight check {shlex.quote(typed)}")
        return 0


def cell_name(file: Path) -> str:
    """A cell's name from a file's: letters, digits, ``_`` and ``-``."""
    name = "".join(c if c.isascii() and (c.isalnum() or c in "_-") else "_" for c in file.stem)
    return name if name[:1].isalpha() else f"cell_{name}"
