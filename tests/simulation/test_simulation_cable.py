"""The cable: what its curve pulls with, beside a chain in MuJoCo and beside published forms."""

import numpy as np
import pytest

from armsight.simulation.cable import GRAVITY, CableChain, cable_points, cable_pull
from armsight.simulation.spec import CableSpec

HANGER = (-0.3, 0.0, 2.0)


@pytest.mark.parametrize(
    ("end", "length", "within"),
    [((0.6, 0.05, 0.85), 1.9, 0.8), ((0.3, -0.3, 1.1), 1.6, 0.8)],
)
def test_the_curve_pulls_as_the_bending_chain_does(end, length, within):
    """Half a second of the processor each. A stiffer cable pulls otherwise: that is said."""
    limp = CableSpec(HANGER, length, bending=0.05)
    chain = CableChain(limp, np.array(end))
    hung = chain.settle(3.0)
    np.testing.assert_allclose(hung, cable_pull(limp, np.array(end)), atol=within)
    curve = cable_points(limp, np.array(end), 25)[:-1]
    assert np.linalg.norm(chain.joints - curve, axis=1).max() < 0.04


def test_a_curve_is_as_long_as_its_cable_and_carries_its_weight():
    """Both ends together hold the whole weight, and nothing pulls aside but they each other."""
    spec, end = CableSpec(HANGER, 1.9), np.array([0.6, 0.05, 0.85])
    points = cable_points(spec, end, 2000)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(1.9, rel=1e-4)
    np.testing.assert_allclose(points[[0, -1]], [end, HANGER], atol=1e-9)
    there = CableSpec(tuple(end), 1.9)
    both = cable_pull(spec, end) + cable_pull(there, np.array(HANGER))
    np.testing.assert_allclose(both, [0, 0, -GRAVITY * 2.26 * 1.9], atol=1e-6)


def test_straight_below_its_hanger_it_carries_half_of_what_hangs_below():
    spec = CableSpec((0.0, 0.0, 2.0), 1.6)
    np.testing.assert_allclose(
        cable_pull(spec, np.array([0.0, 0.0, 1.0])), [0, 0, -0.5 * GRAVITY * 2.26 * 0.6]
    )
    aside = cable_pull(spec, np.array([0.005, 0.0, 1.0]))
    assert aside[2] == pytest.approx(-0.5 * GRAVITY * 2.26 * 0.6, rel=0.01)


def test_a_cable_that_is_too_short_pulls_hard_towards_its_hanger():
    spec = CableSpec(HANGER, 1.0)
    end = np.array([0.6, 0.0, 0.85])
    pull = cable_pull(spec, end)
    assert np.linalg.norm(pull) > 100.0
    way = np.asarray(HANGER) - end
    assert pull @ way / (np.linalg.norm(pull) * np.linalg.norm(way)) > 0.99
