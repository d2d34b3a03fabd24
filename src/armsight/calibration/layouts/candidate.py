"""One reading of a set's poses, with how well arm and board agree by it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.calibration.hand_eye_fit import HandEyeFit
from armsight.calibration.layouts.conventions import Reading
from armsight.calibration.layouts.pairing import Pairing
from armsight.calibration.problem import Mount

UNITS = ((1.0, "metres"), (1e-3, "millimetres"), (1e-2, "centimetres"), (0.0254, "inches"))


@dataclass(frozen=True)
class Candidate:
    """One reading with its fit."""

    reading: Reading
    pairing: Pairing
    mount: Mount
    fit: HandEyeFit

    @property
    def length(self) -> tuple[float, str]:
        """The unit of the positions [m], and its name; the nearest one to the scale that fits."""
        said = next((u for u in UNITS if u[0] == self.reading.table.length), None)
        if said is not None and abs(np.log(self.fit.scale / said[0])) < 0.35:
            return said
        near = min(UNITS, key=lambda u: abs(np.log(self.fit.scale / u[0])))
        if near[1] == "inches" and abs(np.log(self.fit.scale / near[0])) > 0.12:
            near = min(UNITS[:3], key=lambda u: abs(np.log(self.fit.scale / u[0])))
        return near

    def words(self) -> str:
        """The reading for people."""
        where = "on the arm" if self.mount == "flange" else "beside the arm"
        return f"{self.reading.words}, {self.length[1]}, {self.pairing.words}; camera {where}"

    @property
    def meaning(self) -> tuple[str, bool, Mount, str]:
        """What makes two candidates different."""
        return self.reading.kind, self.reading.degrees, self.mount, self.reading.table.source

    @property
    def of_the_board(self) -> bool:
        """The poses are those of the board in the camera, not the arm's: both mounts are none."""
        parts = (self.fit.X, self.fit.Z)
        turn = max(float(np.arccos(np.clip((np.trace(T[:3, :3]) - 1) / 2, -1, 1))) for T in parts)
        away = max(float(np.linalg.norm(T[:3, 3])) for T in parts)
        return turn < 0.03 and away < 0.03
