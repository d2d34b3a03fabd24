"""Two pictures judged together, painted: what one shows badly, and what has another size."""

from dataclasses import replace

import numpy as np
import pytest
from painted_ports import LENS, PAIR, facing, paint

from armsight.charging.find import FindOptions, find_ports
from armsight.charging.pairs import _by_one, _enough, find_in_pair
from armsight.charging.ports.table import PORTS
from armsight.errors import UsageError
from armsight.geometry.pose import inverse

T = facing(0.02, 0.01, 0.6, (0.3, -0.25), 0.2)
T_RIGHT_LEFT = inverse(PAIR.T_left_right)
ONLY = FindOptions(ports=("type1", "type2"))


def _right(stretch=1.0, contrast=1.0):
    """What the right lens sees of a port that is so much larger, and as much farther."""
    T_lens = T_RIGHT_LEFT.copy()
    T_lens[:3, 3] /= stretch
    return paint(PORTS["type2"], T_lens @ T, PAIR.right, 3, contrast)


@pytest.fixture(scope="module")
def left():
    return paint(PORTS["type2"], T, LENS, 2)


def test_a_port_is_found_where_both_pictures_show_it(left) -> None:
    (seen,) = find_in_pair((left, _right()), PAIR, ONLY)
    assert seen.port == "type2"
    assert seen.score > 0.9
    assert np.linalg.norm((seen.T_left_port - T)[:3, 3]) < 2e-3


def test_what_one_picture_hardly_shows_is_found_by_the_other(left) -> None:
    """Most of the port is washed out in the right picture: alone it says nothing."""
    right = _right()
    u, v = PAIR.right.project((T_RIGHT_LEFT @ T)[None, :3, 3])[0].astype(int)
    right[v - 80 : v + 80, u + 5 : u + 90] = 118
    assert not find_ports(right, PAIR.right, ONLY)
    (seen,) = find_in_pair((left, right), PAIR, ONLY)
    assert seen.port == "type2"
    assert len(seen.matches) == 2
    away = np.abs(seen.T_left_port - T)[:3, 3]
    assert away[:2].max() < 1e-3
    assert away[2] < 0.012


def test_what_one_picture_shows_clearly_the_pair_does_not_refuse(left) -> None:
    """Nothing of the port is left in the right picture: dirt, or a lamp in the glass."""
    right = _right()
    u, v = PAIR.right.project((T_RIGHT_LEFT @ T)[None, :3, 3])[0].astype(int)
    right[v - 90 : v + 90, u - 90 : u + 90] = 118
    (alone,) = find_ports(left, LENS, ONLY)
    (seen,) = find_in_pair((left, right), PAIR, ONLY)
    assert seen.port == "type2"
    assert len(seen.matches) == 1
    assert np.allclose(seen.T_left_port, alone.T_camera_port, atol=2e-3)


def test_one_picture_has_to_be_clearer_where_the_other_looks_there(left) -> None:
    (alone,) = find_ports(left, LENS, ONLY)

    def judged(score, evidence, other=()):
        match = replace(alone.match, score=score, evidence=evidence)
        seen = replace(alone, score=score, match=match)
        return _by_one(((seen,), other), PAIR, ONLY)

    assert judged(0.8, 3.5)
    assert not judged(0.8, 1.5)  # enough where only one of them looks
    assert not judged(0.65, 3.5)
    assert not judged(0.8, 3.5, (alone,))  # the other shows one of its own, elsewhere


def test_a_thing_of_another_size_is_no_port_however_alike(left) -> None:
    """Each picture alone takes it for one; where the rays meet it would be a third too large."""
    right = _right(stretch=1.33)
    assert find_ports(left, LENS, ONLY)[0].port == "type2"
    assert find_ports(right, PAIR.right, ONLY)[0].port == "type2"
    assert find_in_pair((left, right), PAIR, ONLY) == ()


def test_a_port_that_only_one_picture_looks_at_is_still_found() -> None:
    aside = facing(-0.09, 0.0, 0.35, (0.1, -0.1), 0.0)
    left, right = (
        paint(PORTS["type2"], T_lens @ aside, lens, 5)
        for T_lens, lens in ((np.eye(4), LENS), (T_RIGHT_LEFT, PAIR.right))
    )
    (seen,) = find_in_pair((left, right), PAIR, ONLY)
    assert len(seen.matches) == 1


def test_exchanged_pictures_show_no_port(left) -> None:
    """Cameras that were swapped: better no port than one at a wrong place."""
    assert find_in_pair((_right(), left), PAIR, ONLY) == ()


def test_a_picture_of_another_size_is_refused(left) -> None:
    with pytest.raises(UsageError, match="its lens 640x480"):
        find_in_pair((left, left[:240]), PAIR)


def test_half_of_the_edges_do_not_do_where_whole_rims_are_missing(left) -> None:
    """The same score: spread over all rims, as of a port in bad light, or on a few, as of nuts."""
    (seen,) = find_in_pair((left, _right()), PAIR, ONLY)
    options = FindOptions(least_together=0.5)

    def judged(score, evidence):
        half = replace(seen.matches[0], score=score, evidence=0.5 * evidence)
        return _enough(replace(seen, score=score, matches=(half, half)), options)

    assert judged(0.51, 1.4)
    assert judged(0.45, 1.4)
    assert not judged(0.45, 1.2)
    assert not judged(0.41, 2.0)
    assert not judged(0.54, 1.2)
