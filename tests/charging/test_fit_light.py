"""What light does to edges, in lenses that stand side by side and far apart."""

import numpy as np
import pytest
from painted_ports import LENS, facing, paint

from armsight.charging import fit as module
from armsight.charging.fit import fit
from armsight.charging.looks import Look, look
from armsight.charging.ports.table import PORTS
from armsight.experiments.ccs1_pictures import PAIR
from armsight.geometry.pose import inverse, make_pose


def looks_from(baseline: float) -> tuple[list[Look], np.ndarray]:
    """A port at 0.5 m and the looks of two lenses that are turned towards it."""
    T = facing(0.0, 0.0, 0.5, (0.2, 0.1), 0.0)
    angle = np.arctan2(baseline, 0.5)
    c, s = np.cos(angle), np.sin(angle)
    turn = [[c, 0, -s], [0, 1, 0], [s, 0, c]]
    poses = (np.eye(4), inverse(make_pose(turn, (baseline, 0.0, 0.5 - 0.5 * c))))
    return [look(paint(PORTS["type2"], P @ T, LENS, i), LENS, P) for i, P in enumerate(poses)], T


def tilt_sigma(looks: list[Look], T: np.ndarray) -> float:
    found = fit(looks, PORTS["type2"], T)
    return float(np.sqrt(np.trace(found.covariance[3:5, 3:5])))


def test_lenses_side_by_side_share_their_light(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tilt is surer then; of lenses that stand far apart it is as sure as it was."""
    near, far = looks_from(0.05), looks_from(0.5)
    alike = tilt_sigma(*near), tilt_sigma(*far)
    monkeypatch.setattr(module, "ALIKE", 0.0)
    apart = tilt_sigma(*near), tilt_sigma(*far)
    assert alike[0] < 0.97 * apart[0]
    assert alike[1] == pytest.approx(apart[1], rel=0.05)


def test_the_middle_of_a_rendered_picture_is_half_a_pixel_before_half_its_size() -> None:
    """Our pixels have their middle at whole numbers."""
    assert (PAIR.left.cx, PAIR.left.cy) == (319.5, 239.5)
