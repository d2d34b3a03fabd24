"""Solving a calibration: three cameras of two lenses each, 50 frames a camera, everything unknown.

``solve_s`` is the whole way from corners to an answer: start values, mis-seen boards, lenses,
cameras, board, arm and noise. ``next_view_s`` is the choice among 80 candidates, made at each view
of a live calibration. ``detect_s`` finds the board in a colour picture of 1920 x 1080. The corners
are synthetic (T1's cell, arm errors, outliers); times of a busy machine are its neighbours' too, so
processor time is what the budgets are for.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np

from armsight.calibration import views
from armsight.calibration.boards import Checkerboard, Detection, raster
from armsight.calibration.calibrate import CalibrationOptions, calibrate
from armsight.calibration.synthetic import make_cell, observe, random_views
from armsight.robots import load_robot
from common import Report

CAMERAS, FRAMES = 3, 50


def seconds(work: Callable[[], object], rounds: int) -> np.ndarray:
    """Processor time of each of some rounds [s], after one that is not counted."""
    work()
    out = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        out.append(time.process_time() - start)
    return np.array(out)


def spread(times: np.ndarray) -> tuple[float, float]:
    """10th and 90th percentile."""
    return float(np.percentile(times, 10)), float(np.percentile(times, 90))


def picture() -> np.ndarray:
    """A colour camera's picture of T1's board, tilted, 1.1 m away, on a grey room."""
    image, _, _ = raster(Checkerboard(), 3000, 0.02)
    h, w = image.shape
    corners = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32)
    places = np.array([[870, 460], [1095, 485], [1080, 655], [880, 610]], np.float32)
    M = cv2.getPerspectiveTransform(corners, places)
    room = np.full((1080, 1920), 120, np.uint8)
    board = cv2.warpPerspective(image, M, (1920, 1080), flags=cv2.INTER_AREA)
    cover = cv2.warpPerspective(np.full_like(image, 255), M, (1920, 1080)) > 127
    room[cover] = board[cover]
    noise = np.random.default_rng(0).normal(0, 3, room.shape)
    return np.clip(cv2.GaussianBlur(room, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


def main() -> None:
    """Run and print."""
    report = Report("calibration", __doc__)
    rounds = max(2, report.rounds(5))
    rng = np.random.default_rng(0)
    cell = make_cell(load_robot("ur5"), rng)
    problem = observe(cell, random_views(cell, CAMERAS * FRAMES, rng), rng)
    options = CalibrationOptions(left_out=False)

    def solve() -> object:
        return calibrate(problem, np.random.default_rng(0), options)

    times = seconds(solve, rounds)
    report.add(
        "solve_s",
        float(np.median(times)),
        "s",
        spread=spread(times),
        must="<= 10",
        aim="<= 2",
        note=f"{len(problem.sightings)} boards in {len(problem.views)} views, processor time",
    )
    answer = calibrate(problem.only_views(range(21)), np.random.default_rng(0), options)
    solution = answer.solution
    S = solution.normal.reduced()
    W = views.target_weight(solution, solution.normal.free)
    near = problem.views[0].joints
    assert near is not None

    def look() -> object:
        draw = np.random.default_rng(1)
        offers = views.propose(answer.problem, solution.state, cell.robot, draw, 80, near=near)
        looks = views.information(
            answer.problem, solution.state, answer.freedom, cell.robot, offers,
            sigma=answer.corner_sigma(),
        )  # fmt: skip
        return views.choose(S, W, looks, np.ones(len(offers)))

    times = seconds(look, rounds)
    report.add("next_view_s", float(np.median(times)), "s", spread=spread(times), aim="<= 0.3")
    image = picture()
    board = Checkerboard()
    assert isinstance(board.detect(image), Detection)
    times = seconds(lambda: board.detect(image), rounds)
    report.add("detect_s", float(np.median(times)), "s", spread=spread(times))
    report.finish()


if __name__ == "__main__":
    main()
