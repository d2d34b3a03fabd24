"""Two arms by what both know: a fixed camera beside them, or a fixed board that both see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.calibration import se3
from armsight.calibration.calibrate import Calibration
from armsight.errors import CalibrationError
from armsight.geometry.pose import inverse


@dataclass(frozen=True)
class TwoArms:
    """One arm's base in the other's.

    Attributes:
        T_first_second: base of the second arm in that of the first.
        covariance: (6, 6) of that (translation [m], rotation [rad], in the second's axes).
        by: what both know.
    """

    T_first_second: Pose
    covariance: Floats
    by: str

    def words(self) -> str:
        """One line for people."""
        x, y, z = 1e3 * self.T_first_second[:3, 3]
        sigma = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))
        return (
            f"second arm's base in the first's, by {self.by}: x {x:.1f} y {y:.1f} z {z:.1f} mm, "
            f"sigma {1e3 * sigma[:3].max():.2f} mm and {np.rad2deg(sigma[3:].max()):.3f} deg"
        )


def two_arms(first: Calibration, second: Calibration) -> TwoArms:
    """One arm's base in the other's, from a calibration of each with the same camera or board.

    ``T_1_2 = A inv(B)`` with the shared thing's poses A and B in the two bases; errors of both are
    independent.

    Raises:
        CalibrationError: nothing that both know stands still.
    """
    ways = [_standing(first), _standing(second)]
    for by in ways[0]:
        if by in ways[1]:
            (A, C_a), (B, C_b) = ways[0][by], ways[1][by]
            turn = se3.adjoints(B[None])[0]
            return TwoArms(A @ inverse(B), turn @ (C_a + C_b) @ turn.T, by)
    known = [", ".join(w) or "nothing" for w in ways]
    raise CalibrationError(
        f"two arms: nothing that both know stands still (the first knows {known[0]}, the second "
        f"{known[1]}): show one fixed camera boards on both arms, or both cameras one fixed board"
    )


def _standing(answer: Calibration) -> dict[str, tuple[Pose, Floats]]:
    """What stands still in an arm's base: poses and covariances by name."""
    out: dict[str, tuple[Pose, Floats]] = {}
    for k, rig in enumerate(answer.problem.rigs):
        if rig.mount == "base":
            place = (answer.camera_pose(k), answer.covariance.camera_pose(k))
            out[f"camera {rig.name}"] = place
    for k, board in enumerate(answer.problem.boards):
        if board.mount == "base":
            at = answer.solution.model.board_slice(k)
            out["the board"] = (answer.board_pose(k), answer.covariance.block(at))
    return out
