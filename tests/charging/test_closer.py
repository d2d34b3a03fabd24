"""Ports that no picture shows clearly: pictures that add up, and places where a port can be."""

import numpy as np
import pytest
from painted_ports import LENS, PAIR, facing, paint

from armsight.charging.closer import MOST, Stack, Where, find_closer
from armsight.charging.find import FindOptions
from armsight.charging.ports.table import PORTS
from armsight.charging.pose import locate
from armsight.charging.rings import _lean_of
from armsight.geometry.pose import exp, inverse

T = facing(0.02, 0.01, 0.9, (0.3, -0.25), 0.1)
T_RIGHT_LEFT = inverse(PAIR.T_left_right)
TYPES = ("type1", "type2")
DISTANCE = (0.4, 1.6)


def dark(seed, T_left_port=T, light=0.08):
    """A pair's pictures at dusk: a few levels of contrast, and as many of noise."""
    rng = np.random.default_rng(seed)
    made = []
    for lens, T_lens in ((LENS, np.eye(4)), (PAIR.right, T_RIGHT_LEFT)):
        seen = paint(PORTS["type2"], T_lens @ T_left_port, lens, 1) * light
        made.append(np.clip(seen + rng.normal(0.0, 3.0, seen.shape), 0, 255).astype(np.uint8))
    return made[0], made[1]


def stacked(count=MOST):
    stack = Stack()
    for k in range(count):
        bright = stack.add(dark(k), 0.3 * k)
    return bright


@pytest.fixture(scope="module")
def bright():
    return stacked()


def anywhere(pose):
    return True


def test_what_is_too_dark_for_one_picture_is_found_in_eight(bright):
    assert not locate(dark(0), PAIR, FindOptions(TYPES, DISTANCE))
    found = find_closer(bright, PAIR, TYPES, DISTANCE, Where(anywhere))
    assert found is not None
    assert found.port == "type2"
    assert np.linalg.norm((found.T_ref_port - T)[:3, 3]) < 3e-3


@pytest.mark.parametrize("off", [(0.0, 0.0, 0.0), (0.1, -0.08, 0.07)])
def test_it_is_found_about_the_place_where_cars_are_parked(bright, off):
    about = T @ exp(np.array([*off, 0.12, -0.1, 0.15]))
    found = find_closer(bright, PAIR, TYPES, DISTANCE, Where(anywhere, about, 0.18))
    assert found is not None
    assert found.port == "type2"
    assert np.linalg.norm((found.T_ref_port - T)[:3, 3]) < 3e-3


def test_nothing_is_found_where_no_port_can_be(bright):
    def low(pose):
        return pose[1, 3] > 0.2

    assert find_closer(bright, PAIR, TYPES, DISTANCE, Where(low)) is None
    turned = T @ exp(np.array([0.0, 0.0, 0.0, 0.0, 0.9, 0.0]))
    assert find_closer(bright, PAIR, TYPES, DISTANCE, Where(anywhere, turned, 0.1)) is None
    behind = facing(0.0, 0.0, 0.1, (0.0, 0.0), 0.0)
    assert find_closer(bright, PAIR, TYPES, DISTANCE, Where(anywhere, behind, 0.1)) is None


def test_a_bare_wall_shows_none():
    rng = np.random.default_rng(3)
    stack = Stack()
    for k in range(4):
        wall = [
            np.clip(rng.normal(10.0, 3.0, (lens.height, lens.width)), 0, 255).astype(np.uint8)
            for lens in (LENS, PAIR.right)
        ]
        bright = stack.add((wall[0], wall[1]), 0.3 * k)
    assert find_closer(bright, PAIR, TYPES, DISTANCE, Where(anywhere)) is None
    assert find_closer(bright, PAIR, TYPES, DISTANCE, Where(anywhere, T, 0.18)) is None


def test_pictures_add_up_until_something_moves():
    clean = dark(0, light=0.5)
    noise = {}
    stack = Stack()
    for k in range(MOST):
        left, _ = stack.add(dark(k, light=0.5), 0.3 * k)
        noise[k] = float((left.astype(float) - left.mean())[:60].std())
    assert noise[MOST - 1] < 0.6 * noise[0]
    elsewhere = facing(0.12, 0.01, 0.9, (0.3, -0.25), 0.1)
    alone = Stack().add(dark(9, elsewhere, 0.5), 0.0)
    together = stack.add(dark(9, elsewhere, 0.5), 0.3 * MOST)
    assert np.array_equal(alone[0], together[0])
    late = stack.add(clean, 0.3 * MOST + 5.0)
    assert np.array_equal(late[0], Stack().add(clean, 0.0)[0])


def test_at_dusk_too_another_car_is_noticed():
    stack = Stack()
    for k in range(3):
        stack.add(dark(k), 0.3 * k)
    elsewhere = facing(0.12, 0.01, 0.9, (0.3, -0.25), 0.1)
    assert np.array_equal(
        stack.add(dark(9, elsewhere), 1.0)[0], Stack().add(dark(9, elsewhere), 0.0)[0]
    )


def test_a_picture_of_another_size_begins_anew():
    stack = Stack()
    stack.add(dark(0), 0.0)
    left, right = dark(1)
    assert stack.add((left[:200], right[:200]), 0.3)[0].shape == (200, 640)


def test_a_pose_leans_as_it_was_made_to():
    rng = np.random.default_rng(0)
    from armsight.charging.kernels.rigid import flat_pose

    for _ in range(50):
        lean, roll = rng.uniform(-0.8, 0.8, 2), float(rng.uniform(-1.0, 1.0))
        at = [float(v) for v in rng.uniform((-0.5, -0.5, 0.5), (0.5, 0.5, 2.0))]
        pose = flat_pose(*at, float(lean[0]), float(lean[1]), roll)
        np.testing.assert_allclose(_lean_of(pose), lean, atol=1e-6)


def test_a_near_look_searches_about_where_the_port_was_seen(bright):
    """The eye's own way: nothing clear, and a belief that is off by a centimetre."""
    from armsight.charging.eye import PortEye
    from armsight.devices.data import StereoFrame, StereoInfo
    from armsight.motion.perception import PosedPair

    info = StereoInfo(
        "flange", "painted", LENS, PAIR.right, PAIR.T_left_right, "flange", np.eye(4), 2.0, 0.0
    )
    eye = PortEye("flange", ("type2",), DISTANCE)
    for expected in (None, T @ exp(np.array([0.01, 0.0, 0.01, 0.0, 0.0, 0.0]))):
        eye.expected = expected
        for k in range(MOST):
            left, right = (np.dstack([image] * 3) for image in dark(k))
            frame = StereoFrame("flange", k, 0.3 * k, 0.3 * k, left, right)
            look = eye.update([PosedPair(frame, info, None, np.eye(4))])
        assert look is not None
        assert len(look.ports) == (expected is not None)
    assert np.linalg.norm((look.ports[0].T_base_port - T)[:3, 3]) < 3e-3


def test_pictures_from_elsewhere_do_not_add_up():
    """A pair on an arm that has moved on sees the same dark wall, a centimetre aside."""
    from types import SimpleNamespace

    from armsight.charging.eye import PortEye

    eye = PortEye("flange", ("type2",), DISTANCE)
    lenses = SimpleNamespace(lenses=PAIR)
    places = [np.eye(4), np.eye(4), exp(np.array([0.01, 0.0, 0.0, 0.0, 0.0, 0.0]))]
    counts = []
    for k, place in enumerate(places):
        frame = SimpleNamespace(stamp=0.3 * k)
        view = SimpleNamespace(frame=frame, info=lenses, T_base_camera=place)
        eye._closer(view, dark(k), (), Where(lambda pose: False, T, 0.03))
        counts.append(eye._stack._count)
    assert counts == [1, 2, 1]
