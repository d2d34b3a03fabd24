"""From sightings to an answer: start, robust solve, outliers out, honest errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.calibration.arm_field import ArmField, field_covariance, fit_field
from armsight.calibration.covariance import Covariance, covariance
from armsight.calibration.left_out import LeftOut, left_out_errors
from armsight.calibration.model_selection import Selection, select_model
from armsight.calibration.noise import WHITE, solve_with_noise
from armsight.calibration.outliers import reject_outliers
from armsight.calibration.problem import (
    Freedom,
    Priors,
    Problem,
    Sighting,
    lens_from_vector,
)
from armsight.calibration.solver import Solution, SolverOptions
from armsight.calibration.start import HandEyeStart, find_start
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera


@dataclass(frozen=True)
class CalibrationOptions:
    """How a calibration is made.

    Attributes:
        solve_lenses: lenses are part of the answer, each held by its prior.
        select: choose the error model by left-out views (recorded sets of unknown arms); otherwise
            everything that can be wrong is modelled with its prior.
        left_out: test the answer on views left out.
        folds: of that test.
        priors: beliefs about the board.
        solver: of every solve.
    """

    solve_lenses: bool = True
    select: bool = False
    left_out: bool = True
    folds: int = 5
    priors: Priors | None = None
    solver: SolverOptions | None = None


@dataclass(frozen=True)
class Calibration:
    """The answer.

    Attributes:
        problem: what was kept, with start values.
        solution, covariance: the chosen model's.
        freedom: what it moved.
        selection: all models that were tried, or None.
        left_out: test on unseen views, or None.
        rejected: (sighting, reason) of what was left out of the solve.
        starts: of each rig.
        field: errors of the arm that similar poses share, where its kinematics are not solved.
    """

    problem: Problem
    solution: Solution
    covariance: Covariance
    freedom: Freedom
    selection: Selection | None
    left_out: LeftOut | None
    rejected: tuple[tuple[Sighting, str], ...]
    starts: tuple[HandEyeStart | None, ...]
    field: ArmField | None = None

    def camera_pose(self, rig: int) -> Pose:
        """``T_mount_rig``."""
        return np.asarray(self.solution.state.T_mount_rig[rig])

    def board_pose(self, board: int = 0) -> Pose:
        """``T_mount_board``."""
        return np.asarray(self.solution.state.T_mount_board[board])

    def lens(self, lens: int) -> PinholeCamera:
        """A lens as solved (or kept)."""
        camera = self.problem.lenses[lens].camera
        return lens_from_vector(self.solution.state.lens[lens], camera.width, camera.height)

    def lens_pose(self, lens: int) -> Pose:
        """``T_rig_lens``."""
        return np.asarray(self.solution.state.T_rig_lens[lens])

    def main_lens(self, rig: int) -> int:
        """Index of a rig's first lens."""
        return next(i for i, lens in enumerate(self.problem.lenses) if lens.rig == rig)

    def corner_sigma(self) -> dict[int, float]:
        """Usual standard deviation of a corner's coordinate through each lens [px]."""
        model = self.solution.model
        return {
            int(lens): float(np.median(model.sigma[model.lens_of == lens]))
            for lens in np.unique(model.lens_of)
        }

    def target_sigma(self, lens: int) -> float:
        """Expected 3D error of a point seen 1.0-1.5 m away anywhere in the image [m]."""
        return self.covariance.target_sigma(lens, *target_points(self.problem.lenses[lens].camera))


def target_points(
    lens: PinholeCamera, depths: tuple[float, ...] = (1.0, 1.25, 1.5)
) -> tuple[Floats, Floats]:
    """(t, 2) pixels over the image and (t,) depths [m]: where accuracy is asked for."""
    u = np.linspace(0.1, 0.9, 5) * (lens.width - 1)
    v = np.linspace(0.1, 0.9, 4) * (lens.height - 1)
    grid = np.array([(a, b, d) for d in depths for b in v for a in u])
    return grid[:, :2], grid[:, 2]


def calibrate(
    problem: Problem,
    rng: np.random.Generator,
    options: CalibrationOptions | None = None,
    progress: Callable[[str], None] | None = None,
) -> Calibration:
    """Solve a calibration from cold.

    Raises:
        CalibrationError: there is too little to solve; says what is missing.
    """
    options = options or CalibrationOptions()
    say = progress or (lambda _: None)
    if not problem.sightings:
        raise CalibrationError(
            "no board was seen in any image: check the board's kind and size, the light and that "
            "the board is in the camera's view"
        )
    say("start values")
    start = find_start(problem, rng)
    if not start.problem.sightings:
        raise CalibrationError(
            "no sighting fits another: the arm's poses and the images do not belong together "
            "(wrong order, wrong units, or a wrong board size)"
        )
    say("boards that contradict the rest")
    full = full_freedom(start.problem, options.solve_lenses)
    # A lens that may turn out wrong must not make boards near the image's edge look wrong.
    loose = full_freedom(start.problem, options.solve_lenses or options.select)
    kept, rejected = reject_outliers(start.problem, loose, options.priors, options.solver)
    selection: Selection | None = None
    field: ArmField | None = None
    if options.select:
        chosen = select_model(
            kept,
            lens=options.solve_lenses,
            priors=options.priors,
            options=options.solver,
            folds=options.folds,
            progress=say,
        )
        selection, best = chosen, chosen.best
        solution, freedom, left_out = best.solution, best.freedom, best.left_out
        say("errors of the arm that similar poses share")
        field = fit_field(solution)
        if field is not None:
            solution = field.solution
    else:
        say("solve")
        left_out = None
        solution, freedom = solve_with_noise(kept, full, options.priors, options.solver)
        if options.left_out:
            say("unseen views")
            left_out = left_out_errors(
                solution.model.problem,
                freedom,
                solution,
                options.folds,
                options.priors,
                options.solver,
            )
    return Calibration(
        solution.model.problem,
        solution,
        covariance(solution, options.select) if field is None else field_covariance(field),
        freedom,
        selection,
        left_out,
        (*start.rejected, *rejected),
        start.hand_eye,
        field,
    )


def full_freedom(problem: Problem, lenses: bool) -> Freedom:
    """Everything that can be wrong, held by its prior."""
    return Freedom(lens=lenses, shape=True, robot=problem.robot is not None, white=WHITE)
