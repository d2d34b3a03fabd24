"""Ways to where the plug is shown: the guard lets the arm go some, and not others."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from armsight.calibration.live.seen import LookAt, Looked, MoveTo, Picture
from armsight.charging import plug_procedure
from armsight.charging.admittance import Admittance
from armsight.charging.plug_procedure import PlugSetup
from armsight.charging.plug_views import plug_views
from armsight.devices.data import StereoInfo
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import look_at
from armsight.geometry.stereo import converging_pair
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import sphere_centers
from armsight.robots.tools import load_tool
from armsight.tasks.room import Room

ROBOT = load_robot("ur10").with_tool(load_tool("type2_plug"))
HERE = np.array([0.0, -1.7, 2.0, -0.7, 1.6, 0.0])
FAR = HERE + np.array([2.4, 0.0, 0.0, 0.0, 0.0, 0.0])


def test_a_way_is_as_free_as_where_it_is_least_so():
    """Of five moves that failed three led past unseen space to a place that was free."""
    room = Room(ROBOT)
    assert room.on_way(FAR) == np.inf
    half = sphere_centers(ROBOT, 0.5 * (HERE + FAR))[-1]
    hazards = np.asarray((half * [1.2, 1.2, 1.0])[None], np.float32)
    room.snapshot = SimpleNamespace(sequence=1, hazards=hazards, hazard_radius=0.02)
    room.here = HERE
    ways = [HERE + share * (FAR - HERE) for share in np.linspace(0.0, 1.0, 11)]
    left = [room.left(q) for q in ways]
    assert min(left[0], left[-1]) > 0.0 > min(left)
    assert room.on_way(FAR) == pytest.approx(min(left), abs=1e-6)
    room.here = ways[5]  # it stands where it has too little: to where it has more it may go
    assert room.on_way(FAR) == pytest.approx(0.0, abs=0.02)


def test_a_way_beside_somebody_lasts_as_long_as_the_guard_makes_it():
    """Measured: at 0.64 m from unseen space 0.07 m/s, at 0.54 m 0.011."""
    room = Room(ROBOT)
    assert room.lasts(FAR) == 0.0
    room.here = HERE
    tip = sphere_centers(ROBOT, HERE)[-1]
    radius = np.asarray(ROBOT.spheres.radius)
    there = HERE + np.array([0.02, 0.0, 0.0, 0.0, 0.0, 0.0])
    way = np.linalg.norm(sphere_centers(ROBOT, there) - sphere_centers(ROBOT, HERE), axis=1).max()
    for gap, speed in ((0.64, 0.07), (0.54, 0.011)):
        outwards = tip * [1.0, 1.0, 0.0] / np.linalg.norm(tip[:2])
        hazards = np.asarray((tip + (gap + 0.02 + radius[-1]) * outwards)[None], np.float32)
        room.snapshot = SimpleNamespace(sequence=gap, hazards=hazards, hazard_radius=0.02)
        least = room.left(HERE) + 0.56  # a wrist may be nearer than the tip
        assert least == pytest.approx(gap, abs=0.06)
        expected = way / (speed * (least - 0.52) / (gap - 0.52))
        assert room.lasts(there) == pytest.approx(expected, rel=0.4)


def setup(**changes):
    lens = PinholeCamera(1280, 960, 1200.0, 1200.0, 640.0, 480.0)
    pair = converging_pair(lens, 0.2, np.arctan(0.2 / 1.2))
    X = look_at([1.5, 0.1, 0.8], [0.6, 0.0, 0.5])
    info = StereoInfo("post", "pair", pair.left, pair.right, pair.T_left_right, "base", X, 2.0, 0.1)
    mount = Admittance((5000.0, 30.0), 0.07)
    base = PlugSetup(ROBOT, None, info, "type2_plug", mount, lambda q: True, looks=12)
    return replace(base, **changes)


def gone_to(taken, places):
    """In which order it goes to (c, n) [rad]."""
    steps, order = taken.round(places, "look", setup().believed), []
    for request in steps:
        order.append(next(i for i, q in enumerate(places) if (q == request.joints).all()))
    return order


def test_a_place_to_which_the_way_is_closed_waits_for_those_beside_it():
    near, beside, far = (ROBOT.home + turn * np.eye(6)[0] for turn in (0.2, 0.5, 2.6))
    places = np.array([near, beside, far])

    def taken(**changes):
        looks = setup(**changes)
        return plug_procedure._Taken(looks, lambda news: None, lambda look: None, [])

    # nobody answers: the generator is sent None, which says that the arm did not get there
    assert gone_to(taken(), places)[0] == 0
    behind = taken(on_way=lambda q: -1.0 if q[0] == near[0] else 1.0)
    assert gone_to(behind, places)[0] == 1


def test_of_near_places_the_one_is_gone_to_first_that_the_guard_lets_it_go_to_soonest():
    """A way of 2 s beside unseen space lasted 18."""
    near, beside, far = (ROBOT.home + turn * np.eye(6)[0] for turn in (0.2, 0.5, 2.6))
    places = np.array([near, beside, far])
    slow = setup(lasts=lambda q: 18.0 if q[0] == near[0] else 0.0)
    taken = plug_procedure._Taken(slow, lambda news: None, lambda look: None, [])
    assert taken._soonest(places) == [1, 2, 0]


@pytest.mark.parametrize(("many", "least"), [(True, 0.1), (False, 0.0)])
def test_places_with_room_to_spare_are_chosen_where_there_are_enough(many, least):
    rooms = {}
    s = setup(room=lambda q: rooms[q.tobytes()])
    rng = np.random.default_rng(3)
    joints, _ = plug_views(s.believed, ROBOT, s.pair.lenses, "type2_plug", 60, rng)
    assert len(joints) > 24
    spacious = 20 if many else 5
    for k, q in enumerate(joints):
        rooms[q.tobytes()] = 0.2 if k < spacious else 0.02
    taken = plug_procedure._Taken(s, lambda news: None, lambda look: None, [])
    kept = plug_procedure._promising(s, taken, joints, closed=False)
    assert len(kept) == (20 if many else len(joints))
    assert min(rooms[joints[k].tobytes()] for k in kept) > least


def test_places_to_which_the_way_is_closed_wait(monkeypatch):
    """The guard held the arm on its way to three places one after the other, from where it was held
    the first time; all the while others were free."""
    at, asked, crossed, base = [ROBOT.home], [], [], setup()
    rng = np.random.default_rng(3)
    drawn, _ = plug_views(base.believed, ROBOT, base.pair.lenses, "type2_plug", 60, rng)
    middle = float(np.median(drawn[:, 0]))

    def apart(q):
        return (q[0] < middle) != (at[-1][0] < middle)

    wanted = setup(on_way=lambda q: -1.0 if apart(q) else 1.0, here=lambda: at[-1])
    X = wanted.pair.T_mount_camera

    def see(setup, answer, looked):
        T = np.linalg.inv(X) @ answer.base_tip(looked.joints)
        return SimpleNamespace(T_ref_port=T, covariance=1e-8 * np.eye(6), score=0.9), ""

    monkeypatch.setattr(plug_procedure, "read_look", see)
    steps = plug_procedure.plug_procedure(wanted, np.random.default_rng(0))
    looks, request = 0, next(steps)
    while looks < 12:
        if isinstance(request, MoveTo):
            asked.append(request.joints)
            crossed.append(len(asked) > 1 and apart(request.joints))
            at.append(request.joints)
            request = steps.send(True)
        else:
            assert isinstance(request, LookAt)
            looks += 1
            if looks < 12:
                request = steps.send(Looked(at[-1], [Picture(None, None, None)], None))
    assert len(asked) == 12
    assert not any(crossed)
