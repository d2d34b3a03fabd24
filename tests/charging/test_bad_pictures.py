"""A pair whose pictures are not as they should be: what its eye says of a port that is there."""

from types import SimpleNamespace

import numpy as np
import pytest
from painted_ports import LENS, PAIR, facing, paint

from armsight.charging.eye import PortEye, picture_fault
from armsight.charging.ports.table import PORTS
from armsight.devices.camera_models import stereo_pair
from armsight.devices.data import StereoFrame, StereoInfo
from armsight.geometry.pose import inverse

T = facing(0.02, 0.01, 0.6, (0.3, -0.25), 0.2)
INFO = StereoInfo(
    "post", "pair", PAIR.left, PAIR.right, PAIR.T_left_right, "base", np.eye(4), 2.0, 0.1
)


@pytest.fixture(scope="module")
def pictures():
    right = paint(PORTS["type2"], inverse(PAIR.T_left_right) @ T, PAIR.right, 3)
    return paint(PORTS["type2"], T, LENS, 2), right


def look(left, right):
    frame = StereoFrame("post", 1, 0.5, 0.6, left, right)
    view = SimpleNamespace(frame=frame, info=INFO, T_base_camera=np.eye(4))
    return PortEye("post", ("type2",)).update([view])


def test_grey_pictures_are_searched_as_coloured_ones_are(pictures):
    grey = look(*pictures)
    colored = look(*(np.dstack([picture] * 3) for picture in pictures))
    assert len(grey.ports) == 1
    assert np.linalg.norm((grey.ports[0].T_base_port - T)[:3, 3]) < 2e-3
    np.testing.assert_array_equal(grey.ports[0].T_base_port, colored.ports[0].T_base_port)
    np.testing.assert_array_equal(grey.picture, colored.picture)


@pytest.mark.parametrize(
    ("spoilt", "words"),
    [
        (lambda a, b: (np.zeros_like(a), b), "the left picture shows nothing: covered"),
        (lambda a, b: (a, np.full_like(b, 128)), "the right picture shows nothing: covered"),
        (lambda a, b: (a, b[:240]), "the right picture is 640x240, its lens 640x480"),
        (
            lambda a, b: (np.broadcast_to(a[:1, :1], (9000, 12000)), b),
            "the left picture is 12000x9000, its lens 640x480",
        ),
        (lambda a, b: (a[:0], b), "the left picture is 640x0"),
        (lambda a, b: (256 * a.astype(np.uint16), b), "the left picture is uint16 of 480x640"),
        (lambda a, b: (a, np.dstack([b] * 4)), "the right picture is uint8 of 480x640x4"),
        (lambda a, b: (b, a), "no port in the pictures"),  # their cables were exchanged
    ],
)
def test_a_pair_that_is_not_as_it_should_be_is_said(pictures, spoilt, words):
    seen = look(*spoilt(*pictures))
    assert seen.ports == ()
    assert words in seen.reason
    assert seen.picture.ndim == 3


@pytest.mark.parametrize(
    ("named", "shows", "words"),
    [
        ("converging_pair", "flange_pair", "the left picture is 800x600, its lens 1280x960"),
        ("flange_pair", "converging_pair", "the left picture is 1280x960, its lens 800x600"),
    ],
)
def test_pairs_that_were_exchanged_by_name_are_said(named, shows, words):
    """Those of the packaged cells: what stands on the post is called flange, and the other way."""
    true, believed = stereo_pair(shows), stereo_pair(named)
    picture = paint(PORTS["type2"], facing(0.02, 0.01, 0.6, (0.3, -0.25), 0.2), true.left, 2)
    assert words in picture_fault(picture, picture, believed.left, believed.right)
