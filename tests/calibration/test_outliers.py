"""Boards seen wrongly as a whole are left out, among few as among many; good ones are not."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.calibration import arm, outliers
from armsight.calibration.calibrate import full_freedom
from armsight.calibration.model import Model
from armsight.calibration.outliers import reject_outliers
from armsight.calibration.solver import SolverOptions, solve
from armsight.calibration.start import find_start
from armsight.calibration.synthetic import ErrorLevels, make_cell, observe, random_views

FEW = 10
"""Views of three cameras: no lens has nine boards."""


def good_cell(robot, seed, views=FEW):
    rng = np.random.default_rng((seed, views))
    cell = make_cell(robot, rng, replace(ErrorLevels(), wrong_boards=0.0))
    return observe(cell, random_views(cell, views, rng), rng), rng


def key(sighting):
    return sighting.view, sighting.lens


def left_out(problem):
    """(view, lens) of all that go, by the start or by the rule, with the rule's reasons."""
    start = find_start(problem, np.random.default_rng(0))
    _, rejected = reject_outliers(start.problem, full_freedom(start.problem, True))
    gone = {key(s) for s, _ in (*start.rejected, *rejected)}
    return gone, {key(s): reason for s, reason in rejected}


WRONG = {
    "slipped by a column": lambda p: p + (p[1] - p[0]),
    "slipped by a row": lambda p: p - (p[6] - p[0]),
    "upside down": lambda p: p[::-1].copy(),
    "another thing": lambda p: p + np.array([31.0, -24.0]),
}


@pytest.mark.parametrize("kind", WRONG)
def test_one_wrong_board_among_few_is_left_out_and_no_other(arm5, kind):
    problem, rng = good_cell(arm5, 2001)
    count = np.bincount([s.lens for s in problem.sightings])
    assert count.max() < 9
    at = int(rng.choice([k for k, s in enumerate(problem.sightings) if count[s.lens] >= 4]))
    wrong = problem.sightings[at]
    seen = list(problem.sightings)
    seen[at] = replace(wrong, pixel=WRONG[kind](wrong.pixel))
    gone, reasons = left_out(replace(problem, sightings=tuple(seen)))
    assert gone == {key(wrong)}
    for reason in reasons.values():
        assert "squares) from where all other views" in reason
        assert reason.endswith("wrongly seen board")


def test_a_wrong_arm_pose_among_few_is_left_out_whole(arm5):
    problem, rng = good_cell(arm5, 2002)
    views = list(problem.views)
    joints = views[4].joints + rng.normal(0, 0.03, 6)
    pose = arm.flange_poses(arm5, joints[None])[0]
    views[4] = replace(views[4], joints=joints, T_base_flange=pose)
    gone, reasons = left_out(replace(problem, views=tuple(views)))
    assert gone == {key(s) for s in problem.sightings if s.view == 4}
    assert all(reason.endswith("wrong arm pose") for reason in reasons.values())


@pytest.mark.parametrize("views", [6, FEW, 24])
def test_good_boards_are_kept(arm5, views):
    """Lenses and arm wrong by all error levels, corners on other things: none is lost."""
    problem, _ = good_cell(arm5, 2003, views)
    assert not left_out(problem)[0]


def test_what_the_others_cannot_judge_is_kept(arm5):
    """The only board of a lens whose numbers and place are unknown fits anything: it stays."""
    problem, _ = good_cell(arm5, 2004)
    one = next(s for s in problem.sightings if s.lens == 5)
    slipped = replace(one, pixel=one.pixel + (one.pixel[1] - one.pixel[0]))
    seen = [*(s for s in problem.sightings if s.lens != 5), slipped]
    assert not left_out(replace(problem, sightings=tuple(seen)))[0]


def test_many_wrong_boards_among_many(arm5):
    problem, rng = good_cell(arm5, 2005, 24)
    wrong = {int(k) for k in np.flatnonzero(rng.random(len(problem.sightings)) < 0.1)}
    seen = tuple(
        replace(s, pixel=WRONG["slipped by a column"](s.pixel)) if k in wrong else s
        for k, s in enumerate(problem.sightings)
    )
    gone, _ = left_out(replace(problem, sightings=seen))
    assert gone == {key(problem.sightings[k]) for k in wrong}


def test_a_board_is_judged_by_a_solve_without_it(arm5):
    """The downdate against the thing itself: solve again without each board, then predict it."""
    problem, _ = good_cell(arm5, 2006)
    problem = find_start(problem, np.random.default_rng(0)).problem
    freedom = replace(full_freedom(problem, True), white=None)
    exact = SolverOptions(huber=np.inf, iterations=60)
    jury = outliers.Jury(problem, freedom, None, exact)
    everyone = np.ones(len(problem.sightings), bool)
    solution = jury.solve(everyone, None)
    judged = jury.judge(solution, everyone)
    for at in (0, 7, 20):
        keep = everyone.copy()
        keep[at] = False
        without = jury.solve(keep, solution.state)
        model = Model(replace(problem, sightings=(problem.sightings[at],)), freedom)
        r = model.linearise(without.state, False).residual * model.sigma[0]
        told = float(np.median(np.linalg.norm(r[0], axis=-1)))
        assert judged.px[at] == pytest.approx(told, rel=0.25, abs=0.05)
    assert solve(jury.model).rms_px() < 1.0
