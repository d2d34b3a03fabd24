"""Where the board is looked for once it is roughly known; and the choice of views by Cholesky."""

from dataclasses import replace

import numpy as np
import pytest
from fake_cell import FakeCell
from test_procedure import LEVELS, calibrated

from armsight.calibration.boards import Miss
from armsight.calibration.live.seen import OUT_OF_SIGHT, read_pictures
from armsight.calibration.live.windows import board_windows
from armsight.calibration.synthetic import true_flanges
from armsight.calibration.views import Candidates, choose

MARGIN = 20.0


@pytest.fixture(scope="module")
def known(arm5):
    cell = FakeCell(arm5, 3, LEVELS)
    return cell, calibrated(cell).calibration


def test_what_a_lens_truly_sees_lies_in_its_window(known):
    """For random poses of the arm; and hardly anything is looked for where it cannot be."""
    cell, answer = known
    rng = np.random.default_rng(0)
    seen = spared = 0
    for q in cell.setup.robot.home + rng.normal(0, 0.5, (150, 6)):
        windows = board_windows(cell.setup, answer, q, MARGIN)
        assert set(windows) == set(range(6))
        flange = true_flanges(cell.truth, q[None], cell.rng)
        for k, lens in enumerate(cell.truth.sheet.lenses):
            found, window = cell._seen(flange, k, lens.rig), windows[k]
            if isinstance(found, Miss):
                spared += window is None
                continue
            seen += 1
            assert window is not None
            x0, y0, x1, y1 = window
            assert (found.pixel > [x0, y0]).all()
            assert (found.pixel < [x1, y1]).all()
            assert (x1 - x0) * (y1 - y0) < 0.8 * lens.camera.width * lens.camera.height
    assert seen > 30
    assert spared > 5 * seen


def test_pixels_of_a_window_are_those_of_the_picture(known):
    cell, answer = known
    view = answer.problem.views[-1].joints
    cell.q = np.array(view)
    pictures = cell.look((0, 1, 2), 0.0, 1)
    whole = read_pictures(cell.setup, view, "learn", 0.0, pictures)
    windows = board_windows(cell.setup, answer, view, MARGIN)
    part = read_pictures(cell.setup, view, "learn", 0.0, pictures, windows)
    assert [k for k, _, _ in part.found] == [k for k, _, _ in whole.found]
    assert part.found
    for (_, _, a), (_, _, b) in zip(whole.found, part.found):
        np.testing.assert_allclose(a, b, atol=1e-9)
    nowhere = read_pictures(cell.setup, view, "learn", 0.0, pictures, dict.fromkeys(range(6)))
    assert not nowhere.found
    assert {reason for _, reason in nowhere.missed} == {OUT_OF_SIGHT}


def test_a_lens_that_saw_little_is_searched_whole(known):
    cell, answer = known
    few = [s for s in answer.problem.sightings if s.lens != 4]
    poor = replace(answer, problem=replace(answer.problem, sightings=tuple(few)))
    assert set(board_windows(cell.setup, poor, cell.setup.robot.home, MARGIN)) == {0, 1, 2, 3, 5}


def test_the_choice_is_that_of_the_inverse():
    """Against the plain formula: trace(weight @ inv(information))."""
    rng = np.random.default_rng(4)
    g, c = 30, 12
    A = rng.normal(size=(g, 2 * g)) * 10.0 ** rng.uniform(-3, 3, g)[:, None]
    S = A @ A.T
    D = rng.normal(size=(9, g))
    weight = D.T @ D
    looks = rng.normal(size=(c, g, 6)) * 10.0 ** rng.uniform(-3, 3, g)[:, None]
    more = looks @ np.swapaxes(looks, 1, 2)
    seconds = rng.uniform(1, 3, c)
    found = choose(S, weight, Candidates(np.zeros((c, 6)), more, np.ones((c, 1), bool)), seconds)
    expected = np.array([np.trace(weight @ np.linalg.inv(S + m)) for m in more])
    now = np.trace(weight @ np.linalg.inv(S))
    assert found.index == int(np.argmax((now - expected) / seconds))
    assert found.present == pytest.approx(np.sqrt(now), rel=1e-6)
    assert found.expected == pytest.approx(np.sqrt(expected[found.index]), rel=1e-6)
