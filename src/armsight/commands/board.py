"""``armsight board``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class BoardCommand:
    """Draw a calibration board to print, true to scale.

    Example: armsight board --pdf board.pdf; armsight board --kind charuco:7x5:36:27 --pdf b.pdf

    Attributes:
        kind: which board, sizes in mm: `checkerboard:7x5:30`, `charuco:7x5:36:27`,
            `circles:7x5:30:15`, `acircles:4x11:20:12`, `apriltag:6x4:30:0.3`, `aruco:4x3:40`,
            `aprilgrid:6x6:25:0.3` (Kalibr's), `tag:48:10`.
        pdf: the file to write.
        paper: A4, A3, A2, A1 or letter.
    """

    pdf: Path
    kind: Annotated[str, tyro.conf.arg(metavar="KIND")] = "checkerboard:7x5:30"
    paper: str = "A4"

    def run(self) -> int:
        """Write the file."""
        from armsight.calibration.boards import parse_board
        from armsight.calibration.printing import board_pdf
        from armsight.writing import write_atomically

        board = parse_board(self.kind)
        write_atomically(self.pdf, board_pdf(board, self.paper))
        print(
            f"{self.pdf}: {board.describe()} on {self.paper}. Print at 100 %, without fitting to "
            "the page; measure it over its whole length, and mount it flat."
        )
        return 0
