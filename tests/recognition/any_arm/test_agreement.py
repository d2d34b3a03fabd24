"""Which link is where tells poses apart; against link maps drawn from arms that are known."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.pose import inverse, look_at
from armsight.recognition.any_arm.agreement import LEAST, links_surprise
from armsight.recognition.any_arm.solver import Fit
from armsight.recognition.any_arm.views import SIDE, Crop
from armsight.recognition.own_arm.surface import arm_surface, render
from armsight.robots.catalogue import load_robot

CELLS = SIDE // 4
SURE = 0.91


def _scene(name: str) -> tuple[Fit, np.ndarray, Crop]:
    """An arm, and what a network that is right and 91 % sure says of its links."""
    robot = load_robot(name)
    q = np.random.default_rng(3).uniform(-1.0, 1.0, robot.n)
    surface = arm_surface(robot)
    corners = surface.posed(q)
    T = inverse(look_at(np.array([1.6, 1.0, 0.7]), tuple(corners.mean(axis=0))))
    p = corners @ T[:3, :3].T + T[:3, 3]
    f = 0.38 * SIDE / np.abs(p[:, :2] / p[:, 2:]).max()
    lens = np.array([f / 4, f / 4, 0.5 * (CELLS - 1), 0.5 * (CELLS - 1), 0, 0, 0, 0, 0.0])
    drawn = render(surface, corners, T, lens, (CELLS, CELLS))
    links = np.full((10, CELLS, CELLS), 0.01, np.float32)
    link = np.zeros((CELLS, CELLS), int)
    link[drawn.at[:, 0], drawn.at[:, 1]] = drawn.owner + 1
    np.put_along_axis(links, link[None], SURE, 0)
    crop = Crop(np.zeros((SIDE, SIDE, 3), np.uint8), np.eye(3), f)
    return Fit(robot, T, q, 0.0, np.eye(6 + robot.n)), links, crop


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_the_truth_surprises_least_even_where_the_outline_is_the_same(name: str) -> None:
    true, links, crop = _scene(name)
    best = links_surprise(true, links, crop)
    assert best == pytest.approx(-np.log(SURE), rel=1e-5)
    bent = replace(true, q=true.q + np.array([0, 0, 0.3] + [0] * (true.robot.n - 3)))
    assert links_surprise(bent, links, crop) > best + 0.2
    swapped = links[[0, *range(9, 0, -1)]]  # one outline, other links
    assert links_surprise(true, swapped, crop) > best + 1.0


def test_one_cell_counts_no_more_than_a_floor_and_none_beyond_the_picture() -> None:
    true, links, crop = _scene("ur5")
    none = np.zeros_like(links)
    none[0] = 1.0
    assert links_surprise(true, none, crop) == pytest.approx(-np.log(LEAST))
    wrong = links.copy()
    wrong[:, :, : CELLS // 2] = none[:, :, : CELLS // 2]
    cut = np.ones((SIDE, SIDE), np.uint8)
    cut[:, : SIDE // 2] = 0
    outside = replace(crop, inside=cut > 0)
    assert links_surprise(true, wrong, crop) > 1.0
    assert links_surprise(true, wrong, outside) == pytest.approx(-np.log(SURE), rel=1e-5)
