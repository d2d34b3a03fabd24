"""The way out of a contact: what it may slide along, and when it is over."""

import numpy as np
import pytest

from armsight.geometry.pose import make_pose
from armsight.geometry.shapes import Solid
from armsight.motion.collision import CollisionModel
from armsight.motion.escape import leaves
from armsight.motion.evasion import RUBS
from armsight.motion.nearest import MovingBody
from armsight.motion.permitted import Grant
from armsight.motion.retreat import gap
from armsight.robots.kinematics import tcp_jacobian, tcp_pose

from .scenes import make_snapshot
from .test_contact import ROBOT, TIP, Sprung
from .test_permits import sphere


def moved(q, shift):
    """(2, n) a path on which the tip goes (3,) that way [m]."""
    J = tcp_jacobian(ROBOT, q)
    return np.array([q, q + np.linalg.lstsq(J, np.array([*shift, 0, 0, 0]), rcond=None)[0]])


@pytest.mark.parametrize(
    ("deeper", "anywhere", "leaving"),
    [(-0.003, True, True), (0.003, False, True), (0.02, False, False)],
)
def test_what_is_left_may_be_slid_along(deeper, anywhere, leaving):
    """A map is two centimetres coarse: an arm that stood for half a millimetre was pressed on."""
    out = tcp_pose(ROBOT, ROBOT.home)[:3, 2]
    thing = Solid("thing", "sphere", (0.05, 0.0, 0.0), make_pose(None, TIP + 0.06 * out))
    seen, model = make_snapshot([thing], counts_unknown=False), CollisionModel(ROBOT)
    q = moved(ROBOT.home, 0.0025 * out)[1]
    assert -0.002 < model.clearance(q, seen) < 0.0, "it touches"
    path = moved(q, deeper * out)
    assert leaves(model, path, seen, q) == anywhere
    assert leaves(model, path, seen, q, RUBS) == leaving


def test_who_presses_on_unseen_is_left_by_what_is_felt():
    """The task has lost the face, and the arm hides it: it comes on, and then it stays there.

    Until November 2026 the arm stopped where the face had been, pressed with 13 N.
    """

    def coming(t):
        way = np.interp(t, [1.0, 1.6, 2.2], [0.0, 0.03, 0.18])
        return TIP + np.array([0.0, 0.0, way - 0.18])

    cell = Sprung(coming, "face", False, stiffness=150.0, radius=0.17, soft=150.0)
    cell.touch(6.0, lost=1.6)
    assert any("backs out" in s.reason for s in cell.log)
    assert max(force for _, force in cell.pushed) > 2.5
    assert cell.pushed[-1][1] < 2.5


def test_the_gap_of_what_may_touch_is_its_surface_s():
    """Other parts are nearer; sphere by sphere, and inside it is negative."""
    body = MovingBody(ROBOT, ROBOT.limits.acceleration)
    center, _ = body.motion(ROBOT.home, np.zeros(ROBOT.n))
    touching = np.zeros(len(ROBOT.spheres.radius), bool)
    touching[-3:] = True
    for at, radius in ((TIP + np.array([0.0, 0.3, 0.1]), 0.05), (center[0], 0.1), (TIP, 0.04)):
        away = np.linalg.norm(center - at, axis=1) - body.radius - radius
        found = gap(body, Grant(sphere(at, 1.0, radius=radius), touching), ROBOT.home, 1.0)
        assert found == pytest.approx(away[-3:].min(), abs=1e-9)
    nothing = Grant(sphere(TIP, 1.0), 0 * touching)
    assert gap(body, nothing, ROBOT.home, 1.0) == np.inf
