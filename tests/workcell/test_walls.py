"""A mapped box that reaches past a wall is told of, with where to end it."""

import numpy as np
import pytest

from armsight.workcell import parse_workcell
from armsight.workcell.packaged import load, packaged
from armsight.workcell.walls import past_walls

CELL = """
[cell]
name = "cell"
[robot]
model = "ur5"
[[camera]]
name = "front"
model = "kinect_v2"
position = [{eye}, 0.0, 2.0]
look_at = [0.5, 0.0, 0.5]
[[solid]]
name = "wall"
size = {size}
position = {place}
rpy_deg = [0, 0, {yaw}]
[mapping]
lower = [-1.0, -1.0, 0.0]
upper = [1.0, 1.0, 1.5]
"""


def told(size=(0.1, 3.0, 2.4), place=(0.8, 0.0, 1.2), yaw=0.0, eye=-1.5):
    text = CELL.format(size=list(size), place=list(place), yaw=yaw, eye=eye)
    cell = parse_workcell(text)
    return past_walls(cell, np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, 1.5]))


def test_a_wall_with_a_strip_of_the_map_behind_it_is_told_of():
    [words] = told()
    assert words.startswith("the map reaches 0.15 m past wall, where no camera looks")
    assert words.endswith("[mapping] upper x between 0.75 and 0.85")
    [words] = told(place=(-0.8, 0.0, 1.2), eye=1.5)
    assert words.endswith("[mapping] lower x between -0.85 and -0.75")
    [words] = told(place=(0.0, 0.8, 1.2), yaw=90.0, eye=0.0)  # turned: it bounds the map along y
    assert words.endswith("[mapping] upper y between 0.75 and 0.85")


@pytest.mark.parametrize(
    "changes",
    [
        {"place": (0.98, 0.0, 1.2)},  # the map ends in it
        {"place": (1.2, 0.0, 1.2)},  # or before it
        {"eye": 1.5},  # a camera stands behind it
        {"size": (0.1, 0.5, 2.4)},  # a post is no wall
        {"yaw": 30.0},
    ],
)
def test_what_leaves_no_unseen_strip_is_not(changes):
    assert told(**changes) == []


def test_no_packaged_cell_is_mapped_past_a_wall():
    for name in packaged():
        cell = load(name)
        lower, upper = cell.mapping.lower, cell.mapping.upper
        if lower is not None and upper is not None:
            assert past_walls(cell, np.array(lower), np.array(upper)) == [], name
