"""Collision shapes, the law of plugging in, and one whole trial in contact physics."""

import numpy as np
import pytest

from armsight.charging.admittance import Admittance
from armsight.charging.insert import Felt, Insertion, InsertOptions, Phase
from armsight.charging.insert_paper import PaperInsertion
from armsight.charging.ports.collision import plug_contours, sleeves, socket_contours
from armsight.charging.ports.outline import inside_any, sample_union
from armsight.charging.ports.table import PORTS
from armsight.charging.spiral import Spiral, SpiralOptions
from armsight.experiments.insertion_bench import (
    T_FLANGE_PLUG,
    T_PORT_PLUG,
    draw,
    joints_at,
)
from armsight.experiments.insertion_curves import traced
from armsight.geometry.pose import inverse, make_pose, transform
from armsight.robots import load_robot
from armsight.simulation import plugging, plugs

PLUGS = ("type1_plug", "type2_plug", "ccs2_plug")


@pytest.mark.parametrize("name", PLUGS)
def test_a_socket_is_open_where_its_plug_goes_and_closed_beside_it(name: str) -> None:
    plug = PORTS[name]
    clearance = 0.4e-3
    socket = socket_contours(plug, clearance, 1.5e-3, plug.depth)
    rng = np.random.default_rng(0)
    p = rng.uniform(-0.09, 0.09, (8000, 2))
    for z in (-0.0002, -0.001, -0.003, -0.01, -0.03):
        lead = max(0.0, 1.5e-3 + z)  # wider above the chamfer
        inner = inside_any([s.grown(clearance + lead) for s in sleeves(plug)], p, 0.3e-3)
        free = np.column_stack([p[inner], np.full(inner.sum(), z)])
        for T, half in zip(socket.boxes, socket.half):
            assert not (np.abs(transform(inverse(T), free)) < half).all(axis=1).any()
    rim, _ = sample_union([s.grown(clearance + 0.15e-3) for s in sleeves(plug)], 1e-3)
    wall = np.column_stack([rim, np.full(len(rim), -0.01)])
    closed = np.zeros(len(wall), bool)
    for T, half in zip(socket.boxes, socket.half):
        closed |= (np.abs(transform(inverse(T), wall)) < half).all(axis=1)
    assert closed.mean() > 0.9  # but for the corner where two sleeves meet
    capsules = plug_contours(plug)
    tips = capsules.capsules[:, :2]
    assert inside_any([s.grown(1e-9) for s in sleeves(plug)], tips).all()


def test_the_admittance_is_stable_behind_its_delay_and_not_when_told_a_third_of_it() -> None:
    """A spring pressed with 20 N, the answer a delay late: less than a tenth over, or swinging."""

    def peak(believed: float) -> float:
        law = Admittance(delay=believed, speed=(1.0, 1.0), acceleration=(1e3, 1e3))
        x, dt, late = 0.0, 0.001, [np.zeros(6)] * 72
        most, ripple = 0.0, []
        for i in range(4000):
            wrench = np.array([0.0, 0.0, -5000.0 * x, 0.0, 0.0, 0.0])
            late.append(law.answer(wrench, np.array([0, 0, 20.0, 0, 0, 0])))
            x += float(late.pop(0)[2]) * dt
            most = max(most, 5000.0 * x)
            if i > 3000:
                ripple.append(5000.0 * x)
        return most + float(np.ptp(ripple))

    assert peak(0.072) < 22.0
    assert peak(0.024) > 40.0


def _felt(now: float, z: float, force: float) -> Felt:
    return Felt(now, make_pose(None, [0, 0, z]), np.array([0, 0, force, 0, 0, 0]))


def test_depth_alone_is_not_seated() -> None:
    """At the right depth but without force, or with a moment, it does not say so."""
    for force, moment in ((-10.0, 0.0), (-80.0, 4.0)):
        law = Insertion(InsertOptions(depth=0.035, tries=99))
        law.phase = Phase.INSERT
        for i in range(400):
            give = -force / 5000.0
            felt = _felt(0.008 * i, give, force)
            felt.wrench[3] = moment
            law.step(felt)
            assert law.phase is not Phase.SEATED


def test_a_wall_ends_in_a_named_failure_and_the_twist_is_bounded() -> None:
    law = Insertion(InsertOptions(seconds=20.0))
    z, last = -0.046, np.zeros(6)
    for i in range(4000):
        force = -5000.0 * max(z + 0.036, 0.0)
        answer = law.step(_felt(0.008 * i, z, force))
        assert np.linalg.norm(answer.twist[:3]) <= 0.0251
        assert np.linalg.norm(answer.twist[:3] - last[:3]) <= 0.4 * 0.008 + 1e-9
        z, last = z + 0.008 * float(answer.twist[2]), answer.twist
        if law.phase is Phase.FAILED:
            break
    assert law.phase is Phase.FAILED
    assert "no socket" in law.words or "gave up" in law.words


def test_an_edge_that_touches_first_is_not_the_face() -> None:
    """A tilted CCS2 plug touched 5 mm early, lay flat, and was believed to have dropped in."""
    law = Insertion(InsertOptions(depth=0.035))
    z = {Phase.APPROACH: -0.041, Phase.TOUCH: -0.040, Phase.SETTLE: -0.0346}
    for i in range(100):
        law.step(_felt(0.008 * i, z[law.phase], -8.0))
        if law.phase not in z:
            break
    assert law.phase is Phase.SEARCH


def test_the_spiral_rests_where_the_plug_is_caught_and_winds_on_when_it_is_not_in() -> None:
    options = SpiralOptions(caught=0.0012, rest=0.5)
    spiral, at = Spiral(options, np.zeros(2)), np.array([0.004, 0.0])
    for _ in range(100):
        spiral.advance(0.0, 0.008)
    assert 0.0 < np.linalg.norm(spiral.pull(at)) <= options.pull + 1e-9
    rested = 0
    while not np.linalg.norm(spiral.pull(at)) > 0.0 or not rested:
        spiral.advance(0.002, 0.008)
        rested += 1
    assert rested * 0.008 == pytest.approx(0.5, abs=0.02)  # and no longer
    assert np.linalg.norm(spiral.velocity()) > 0.0
    while not spiral.ended:
        spiral.advance(0.002, 0.008)


def test_a_wedge_is_not_pressed_hard_and_the_axis_goes_round() -> None:
    """What is pressed into a wedge leaps when it comes loose: 146 N across were measured."""
    law = Insertion(InsertOptions(depth=0.035))
    law.phase = Phase.INSERT
    turns, force = [], 0.0
    for i in range(250):  # 13 mm deep, not a hair's breadth farther; the mount is pressed as asked
        answer = law.step(_felt(0.008 * i, -0.022 + force / 5000.0, -force))
        force = max(0.0, force + 5000.0 * 0.008 * float(answer.twist[2]))
        turns.append(answer.twist[3:5])
    assert 25.0 < force < 31.0
    assert np.ptp(np.cumsum(turns, axis=0) * 0.008, axis=0).min() > np.deg2rad(2.0)


def test_an_arm_that_was_slowed_does_not_leap_when_it_is_let_go() -> None:
    """Slowed for a visitor it felt 10 N while 105 were wanted; let go, 100 N came in an instant."""
    law = Insertion(InsertOptions(depth=0.035), out=True)
    for i in range(500):
        answer = law.step(_felt(0.008 * i, -0.002, 10.0))
    assert -0.03 < answer.twist[2] < -0.01


def test_an_arm_that_is_held_still_is_no_jam() -> None:
    law = Insertion(InsertOptions(depth=0.035, tries=1, seconds=3.0))
    law.phase = Phase.INSERT
    for i in range(1000):
        felt = _felt(0.008 * i, -0.015, -15.0)
        law.step(Felt(felt.now, felt.T_seat_plug, felt.wrench, held=i > 20))
    assert law.phase is Phase.INSERT
    for i in range(1000, 1400):
        law.step(_felt(0.008 * i, -0.015, -15.0))
    assert law.phase is Phase.FAILED
    assert "jammed" in law.words


def test_the_papers_way_halts_where_it_is_pressed() -> None:
    law = PaperInsertion()
    assert law.step(_felt(0.0, -0.03, -10.0)).phase is Phase.INSERT
    assert law.step(_felt(0.1, -0.02, -90.0)).phase is Phase.SEATED
    assert "halted at 16.0 mm" in law.words


def test_steps_of_a_millisecond_strike_like_finer_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plug that comes loose at 60 N leaps from wall to wall: how hard is no matter of the step.

    A contact of 2 ms in fine steps is what is meant; in steps of 1 ms it struck 1.7 times as hard.
    """
    plug, robot = PORTS["ccs2_plug"], load_robot("ur10")
    T_port = make_pose([[0, 0, -1], [-1, 0, 0], [0, 1, 0]], [0.95, 0.16, 0.78])
    sleeve, socket = plug_contours(plug), socket_contours(plug, 0.59e-3, 1.9e-3, plug.depth)
    setup = plugging.PlugSetup(
        T_port, T_FLANGE_PLUG, socket.boxes, socket.half, sleeve.capsules, sleeve.radius,
        friction=0.33, contacts=20.0, cable=0.0,
    )  # fmt: skip
    T_plug = T_port @ T_PORT_PLUG @ make_pose(None, [0.0, 0.0, plug.depth - 1e-3])
    q = joints_at(robot, T_plug @ inverse(T_FLANGE_PLUG))

    def struck(step: float) -> float:
        """Greatest force across, as the mean of a millisecond [N]."""
        monkeypatch.setattr(plugging, "STEP", step)
        bench = plugging.PlugBench(robot, setup, q)
        bench._model.opt.gravity[:] = 0.0, 0.0, -4.0  # hangs a little, touches nothing
        bench._data.qpos[8] -= 0.012  # of the mount's spring, along
        bench._data.qvel[7] = 0.05
        forces = []
        for _ in range(round(0.05 / step)):
            bench.step()
            forces.append(np.linalg.norm(bench.truth()[1][:2]))
        return float(np.reshape(forces, (50, -1)).mean(axis=1).max())

    shipped = struck(0.001)
    monkeypatch.setitem(plugs.SOFT, "solref", [0.002, 1.0])
    assert 0.75 < shipped / struck(0.000125) < 1.3


def test_a_plug_goes_in_and_out_in_contact_physics() -> None:
    """Physics decides: from 5 mm and 5 deg off, fully in, gently, and out again (about 4 s)."""
    curve, result = traced(draw(np.random.default_rng(5), 5e-3, 5.0), paper=False)
    assert result["full"]
    assert result["said"]
    assert result["axial_n"] < 110.0
    assert result["lateral_n"] < 50.0
    assert result["sunk_mm"] < 0.1
    assert result["unplugged"]
    time, depth, along, across = curve.T  # what is drawn of it is what was scored
    assert (np.diff(time) > 0.0).all()
    assert depth[0] == pytest.approx(-15.0, abs=3.0)
    assert depth.max() == pytest.approx(1e3 * result["true_depth"], abs=0.5)
    assert depth[-1] < 0.0
    assert along.max() >= result["axial_n"] - 1e-9  # what comes out may press before it pulls
    assert -along.min() >= result["unplug_n"] - 1e-9
    assert across.max() >= result["lateral_n"] - 1e-9
