"""When a station says that it wants to be calibrated again."""

import numpy as np
import pytest

from armsight.charging.eye import PortLook, SeenPort
from armsight.charging.residual import PairsApart
from armsight.geometry.pose import make_pose


def look(pair, stamp, y, port="type2"):
    T = make_pose(None, (0.9, y, 0.4))
    seen = (SeenPort(port, 0.9, T, np.eye(6) * 1e-6, False),)
    return PortLook(stamp, pair, seen, np.zeros((4, 4, 3), np.uint8))


def visits(gaps, between=5.0, port="type2"):
    apart = PairsApart("post", "flange", "station")
    for k, gap in enumerate(gaps):
        apart.take(look("post", 100.0 * k, 0.0))
        apart.take(look("flange", 100.0 * k + between, gap, port))
    return apart.words


def test_pairs_that_go_on_disagreeing_ask_for_a_calibration():
    assert "22 mm apart" in visits([0.02, 0.022, 0.03])
    assert visits([0.02, 0.022, 0.03]).endswith("armsight calibrate station --plug")


@pytest.mark.parametrize(
    "given",
    [
        {"gaps": [0.02, 0.03]},  # too few
        {"gaps": [0.004, 0.005, 0.09]},  # a car that was pushed once
        {"gaps": [0.004, 0.02, 0.004]},
        {"gaps": [0.3, 0.3, 0.3]},  # another place altogether
        {"gaps": [0.03, 0.03, 0.03], "between": 30.0},  # not of one visit
        {"gaps": [0.03, 0.03, 0.03], "port": "type1"},
    ],
)
def test_nothing_is_said_without_a_reason(given):
    assert visits(**given) == ""


def test_only_the_newest_visits_count():
    assert visits([0.03, 0.03, 0.03, 0.004, 0.004]) == ""
    assert visits([0.004, 0.004, 0.03, 0.03, 0.03])


def test_a_station_without_a_second_pair_says_nothing():
    apart = PairsApart("post", "", "station")
    apart.take(PortLook(0.0, "post", (), np.zeros((4, 4, 3), np.uint8), "no port"))
    assert apart.words == ""
