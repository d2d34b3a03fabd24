"""What holds a part of the arm, as a socket does a plug, while somebody comes near."""

import numpy as np
import pytest

from armsight.devices.data import Wrench
from armsight.experiments.quick_cell import KEEP, Ball, QuickCell
from armsight.geometry.pose import make_pose
from armsight.motion.intents import VelocityIntent
from armsight.motion.permits import PermitRequest, PermitState
from armsight.motion.regions import Region
from armsight.robots import load_robot, load_tool
from armsight.robots.kinematics import flange_pose, tcp_pose

ROBOT = load_robot("ur5").with_tool(load_tool("pen"))
OUT = np.array([0.0, 0.0, 1.0])
TIP = tcp_pose(ROBOT, ROBOT.home)[:3, 3]
COMES, GOES = 1.5, 4.0


def felt(now, pushed=0.0):
    """A reading that nobody takes for a dead sensor's."""
    shakes = 0.01 * np.sin(1e3 * now)
    return Wrench(now - 0.001, np.array([pushed, shakes, 0.0]), np.zeros(3))


def ends_at(cell):
    """(3,) where the tip is [m]."""
    return tcp_pose(cell.robot, cell.q)[:3, 3]


class Socket:
    """A tip in a region that may be touched, balls about it, and one wish after the other."""

    def __init__(self, out, *balls):
        self.cell = QuickCell(balls, robot=ROBOT)
        port = Region("box", (0.1, 0.1, 0.1), make_pose(None, TIP), 0.0, drift=0.0)
        self.request = PermitRequest(
            "port", "thing", port, ("tool",), 0.12, 0.06, 60.0, 10.0, seconds=60.0, out=out
        )

    def round(self, asks=True, down=0.0, pushed=0.0, snapshot=None):
        """One tick: whether the permit is asked for, how fast down [m/s], what is felt [N].

        And the map, where that is not the newest.
        """
        cell = self.cell
        cell.guard.feel([felt(cell.now, pushed)])
        ask = self.request if asks else None
        wanted = np.array([0.0, 0.0, -down, 0.0, 0.0, 0.0])
        goal = VelocityIntent("in", wanted, "base", cell.now, cell.now + 0.1, ask)
        cell.tick(snapshot=KEEP if snapshot is None else snapshot, goal=goal)

    def rounds(self, seconds):
        """The ticks of so long [s]."""
        return range(round(seconds / self.cell.config.period))


def visited(out):
    """A tip in a region, wished to creep on at 1 cm/s; somebody is near from COMES to GOES [s]."""
    elbow = flange_pose(ROBOT, ROBOT.home)[:3, 3] + np.array([0.0, 0.0, 0.02])

    def place(t):
        away = np.interp(t, [COMES - 0.8, COMES, GOES, GOES + 0.8], [1.5, 0.24, 0.24, 1.5])
        return elbow + away * np.array([0.0, 1.0, 0.0])

    socket, places = Socket(out, Ball(place, 0.08)), []
    for _ in socket.rounds(7.0):
        socket.round(down=0.01)
        places.append(ends_at(socket.cell))
    return socket.cell, np.array(places)


def during(cell, begin, end):
    return slice(round(begin / cell.config.period), round(end / cell.config.period))


def test_it_stands_still_and_goes_on_when_they_have_gone():
    """Until November 2026 a plug was pulled out of its socket, of a car that charged as well,
    whenever somebody came within 15 cm of the arm; a visitor every 16 s, and no car was charged."""
    cell, places = visited(OUT)
    near = during(cell, COMES + 0.3, GOES)
    assert np.ptp(places[near], axis=0).max() < 1e-4
    assert all(s.permit.holds for s in cell.log[near])
    assert not cell.touches
    after = during(cell, GOES + 1.0, 7.0)
    assert places[after][-1][2] < places[near][-1][2] - 0.005


def test_what_holds_nothing_is_left():
    cell, places = visited(None)
    near = during(cell, COMES, GOES)
    assert any("backs out" in s.reason for s in cell.log[near])
    assert cell.log[near][-1].permit.state is PermitState.WITHDRAWN
    assert np.linalg.norm(places[near][-1] - places[near][0]) > 0.002
    assert not cell.touches


@pytest.mark.parametrize(("out", "stays"), [(OUT, 3.0), (OUT, 0.3), (None, 0.3)])
def test_who_is_beside_has_the_permit_withdrawn_until_they_have_gone(out, stays):
    """A socket's part stands until its permit is given again; others leave first."""

    def place(t):
        beside = COMES < t < COMES + stays
        return TIP + np.array([0.0, 0.10 if beside else 3.0, 0.0])

    socket, heights = Socket(out, Ball(place, 0.05)), []
    cell = socket.cell
    for _ in socket.rounds(4.0):
        permit = cell.log[-1].permit if cell.log else None
        lost = permit is not None and permit.state is PermitState.WITHDRAWN
        socket.round(asks=not lost)  # anew after a round without it
        heights.append(ends_at(cell)[2])
    beside = during(cell, COMES + 0.3, COMES + min(stays, 2.0))
    assert not any(s.permit.holds for s in cell.log[beside] if s.permit)
    assert any(s.permit and s.permit.state is PermitState.WITHDRAWN for s in cell.log)
    assert cell.log[-1].permit.holds == (out is not None and stays < 1.0)
    assert any("stands, held" in s.reason for s in cell.log) == (out is not None)
    rose = np.max(heights) - heights[0]
    assert rose > 0.02 if out is None else rose < 1e-3


def test_who_stands_in_a_socket_that_presses_comes_out():
    """Somebody is beside it, and the car moves: it cannot stand there."""

    def place(t):
        return TIP + np.array([0.0, 0.10 if t > COMES else 3.0, 0.0])

    socket = Socket(OUT, Ball(place, 0.05))
    cell = socket.cell
    for _ in socket.rounds(3.5):
        socket.round(asks=0.5 < cell.now < 1.8, pushed=30.0 if cell.now > 2.5 else 0.0)
    said = [s.reason for s in cell.log]
    before, after = round(2.4 / cell.config.period), round(2.7 / cell.config.period)
    assert "stands, held" in said[before]
    assert "backs out of contact: pressed with" in said[after]


@pytest.mark.parametrize("out", [OUT, None])
def test_a_socket_that_was_left_does_not_swing_back(out):
    """A plug that had left its port went 20 cm astray, away from what its own cable did to the
    force sensor: that was taken for what it had touched, come back."""
    socket = Socket(out)
    cell, left, backs = socket.cell, np.inf, False
    for _ in socket.rounds(8.0):
        pressed = 30.0 if 1.4 < cell.now < 1.5 else 0.0  # more than is permitted
        pushed = pressed or (6.0 if cell.now > left + 1.5 else 0.0)
        socket.round(asks=0.5 < cell.now < 1.5, pushed=pushed)
        backed, backs = backs, "backs out" in cell.log[-1].reason
        if backed and not backs:
            left = min(left, cell.now)
    assert left < 6.0
    assert any("pushes it" in s.reason for s in cell.log) == (out is None)
