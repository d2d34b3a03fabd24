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


def test_a_way_is_closed_where_it_leads_too_near_to_who_may_be_somewhere():
    """Of five moves that failed three led past unseen space to a place that was free."""
    room = Room(ROBOT)
    assert room.left(FAR) == np.inf
    half = sphere_centers(ROBOT, 0.5 * (HERE + FAR))[-1]
    hazards = np.asarray((half * [1.2, 1.2, 1.0])[None], np.float32)
    room.snapshot = SimpleNamespace(sequence=1, hazards=hazards, hazard_radius=0.02)
    room.here = HERE
    ways = [HERE + share * (FAR - HERE) for share in np.linspace(0.0, 1.0, 11)]
    left = [room.left(q) for q in ways]
    assert min(left[0], left[-1]) > 0.0 > min(left)
    assert room.lasts(FAR) == np.inf
    assert np.isfinite(room.lasts(ways[int(np.argmax(np.array(left) < 0.0)) - 1]))
    room.here = ways[5]  # it stands where it has too little: to where it has more it may go
    assert np.isfinite(room.lasts(FAR))
    room.here, room.rests = HERE, room.rests + min(left) - 0.02  # of a guard that asks for less
    assert np.isfinite(room.lasts(FAR))


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


def places(wanted, rng=3):
    """Some to look from, and nothing taken yet."""
    drawn = plug_views(
        wanted.believed, ROBOT, wanted.pair.lenses, "type2_plug", 60, np.random.default_rng(rng)
    )
    assert len(drawn[0]) > 24
    of = plug_procedure._Places(
        wanted, "look about", wanted.believed, drawn, np.random.default_rng(0)
    )
    taken = plug_procedure._Taken(wanted, lambda news: None, lambda look: None, [])
    return of, taken, drawn[0]


def gone_to(wanted):
    """(c, n) all the places that it goes to, one after the other, [rad]; (d, n) what was drawn."""
    of, taken, drawn = places(wanted)
    order = []
    while (goal := of.next(taken)) is not None:
        order.append(goal)
    return np.array(order), drawn


def test_a_place_to_which_the_way_is_closed_waits_for_those_beside_it():
    everywhere, drawn = gone_to(setup())
    assert sorted(map(tuple, everywhere)) == sorted(map(tuple, drawn))
    middle = float(np.median(drawn[:, 0]))
    order, _ = gone_to(setup(lasts=lambda q: np.inf if q[0] < middle else 0.0))
    assert sorted(map(tuple, order)) == sorted(map(tuple, drawn[drawn[:, 0] >= middle]))


def test_of_like_places_the_one_is_gone_to_first_that_the_guard_lets_it_go_to_soonest():
    """A way of 2 s beside unseen space lasted 18."""
    free, drawn = gone_to(setup())
    first = tuple(free[0])
    order, _ = gone_to(setup(lasts=lambda q: 18.0 if tuple(q) == first else 0.0))
    assert tuple(order[0]) != first
    assert tuple(order[-1]) == first  # what takes so long waits for all others
    order, _ = gone_to(setup(lasts=lambda q: 18.0 if tuple(q) == first else 17.0))
    assert tuple(order[0]) != first
    assert len(order) == len(drawn)


@pytest.mark.parametrize("many", [True, False])
def test_places_with_room_to_spare_come_first_where_there_are_some(many):
    rooms = {}
    wanted = setup(room=lambda q: rooms.setdefault(q.tobytes(), 0.02))
    _, _, drawn = places(wanted)
    spacious = [q.tobytes() for q in drawn[: 20 if many else 5]]
    rooms |= dict.fromkeys(spacious, 0.2)
    order, _ = gone_to(wanted)
    first = [q.tobytes() in spacious for q in order]
    assert len(order) == len(drawn)
    if many:  # as long as there are a dozen
        assert all(first[:9])
    else:
        assert not all(first[:5])


def test_places_to_which_the_way_is_closed_wait(monkeypatch):
    """The guard held the arm on its way to three places one after the other, from where it was held
    the first time; all the while others were free."""
    at, asked, crossed, base = [ROBOT.home], [], [], setup()
    rng = np.random.default_rng(3)
    drawn, _ = plug_views(base.believed, ROBOT, base.pair.lenses, "type2_plug", 60, rng)
    middle = float(np.median(drawn[:, 0]))

    def apart(q):
        return (q[0] < middle) != (at[-1][0] < middle)

    wanted = setup(lasts=lambda q: np.inf if apart(q) else 1.0, here=lambda: at[-1])
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
