"""Every bound of the fault watch from both sides: within it nothing is said, beyond it it is."""

import re
from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import JointState
from armsight.experiments.quick_cell import QuickCell
from armsight.mapping.snapshot import CameraStatus
from armsight.motion.faults import OUTSIDE, FaultWatch, Severity
from armsight.motion.guard_config import GuardConfig
from armsight.motion.obedience import HELD, STEP, TIMING
from armsight.robots import load_robot

from .scenes import make_snapshot

ROBOT = load_robot("ur5")
CONFIG = GuardConfig()
INFO = QuickCell([]).info
SLOW = replace(INFO, name="slow", rate=15.0, latency=0.04)
QUICK = replace(INFO, name="quick", rate=60.0, latency=0.0)
ALLOWED = {"slow": 0.04 + 2.5 / 15.0 + CONFIG.compute_latency, "quick": CONFIG.stale_after}
EMPTY = make_snapshot([])
HOME = ROBOT.home.copy()
STILL = np.zeros(6)
EPS = 1e-4


def one(joint, value):
    out = np.zeros(6)
    out[joint] = value
    return out


class Watched:
    """A fault watch that has seen nothing wrong for a second."""

    def __init__(self):
        self.watch = FaultWatch(ROBOT, [SLOW, QUICK], CONFIG)
        self.now, self.sequence, self.q = 10.0, 0, HOME
        for _ in range(130):
            verdict = self.tick()
        assert (verdict.severity, verdict.reason) == (Severity.NONE, "")

    def cameras(self, **changes):
        told = []
        for name in ("slow", "quick"):
            age, alive, excluded, dropped = changes.get(name, (0.03, True, False, 0))
            told.append(CameraStatus(name, self.now - age, alive, 9, dropped, "why", excluded))
        return tuple(told)

    def tick(self, step=0.008, joints=..., snapshot=..., statuses=None, **changes):
        self.now += step
        self.sequence += 1
        if joints is ...:
            joints = JointState(self.now, self.q, STILL)
        if snapshot is ...:
            statuses = self.cameras(**changes) if statuses is None else statuses
            snapshot = replace(
                EMPTY, sequence=self.sequence, stamp=self.now - 0.03, cameras=statuses
            )
        return self.watch.check(self.now, joints, snapshot)


def test_ticks_may_be_late_and_clocks_may_not_jump():
    for step, severity, jumped in (
        (CONFIG.late - EPS, Severity.NONE, False),
        (CONFIG.late + EPS, Severity.SLOW, False),
        (CONFIG.clock_jump - EPS, Severity.SLOW, False),
        (CONFIG.clock_jump + EPS, Severity.BRAKE, True),
        (-EPS, Severity.BRAKE, True),
    ):
        verdict = Watched().tick(step)
        assert (verdict.severity, verdict.jumped) == (severity, jumped)
    first = FaultWatch(ROBOT, [SLOW, QUICK], CONFIG).check(1e6, None, None)
    assert not first.jumped, "nobody knows what time it was before"
    for now in (np.nan, np.inf):
        verdict = Watched().watch.check(now, JointState(10.0, HOME, STILL), EMPTY)
        assert (verdict.severity, verdict.jumped, verdict.joints) == (Severity.BRAKE, True, None)


def test_after_a_fault_all_must_be_well_for_a_while():
    cell = Watched()
    assert cell.tick(CONFIG.late + EPS).severity == Severity.SLOW
    seen = []
    for _ in range(60):
        verdict = cell.tick()
        seen.append(verdict.severity)
        assert verdict.joints is not None
        assert verdict.snapshot is not None
        if verdict.severity == Severity.SLOW:
            assert verdict.reason.startswith("recovering: the guard was 40 ms late")
    waited = seen.index(Severity.NONE)
    assert waited * 0.008 == pytest.approx(CONFIG.recovery, abs=0.01)
    assert all(s == Severity.NONE for s in seen[waited:])
    cell.tick(CONFIG.late + EPS)
    for _ in range(20):
        cell.tick()
    cell.tick(CONFIG.late + EPS)
    for _ in range(20):
        assert cell.tick().severity == Severity.SLOW, "it begins anew"


@pytest.mark.parametrize(
    ("position", "velocity", "age", "says"),
    [
        (HOME[:5], STILL, 0.0, "has (5,) values"),
        (HOME, STILL[:5], 0.0, "values"),
        (HOME + one(2, np.nan), STILL, 0.0, "not finite"),
        (HOME, one(4, np.inf), 0.0, "not finite"),
        (HOME, STILL, np.nan, "not finite"),
        (HOME, one(1, 1.5 * ROBOT.limits.velocity[1] + EPS), 0.0, "shoulder_lift_joint says"),
        (HOME, one(1, 1.5 * ROBOT.limits.velocity[1] - EPS), 0.0, ""),
        (HOME, one(1, -1.5 * ROBOT.limits.velocity[1] - EPS), 0.0, "shoulder_lift_joint says"),
        (HOME, STILL, -CONFIG.future - EPS, "in the future"),
        (HOME, STILL, -CONFIG.future + EPS, ""),
        (HOME, STILL, CONFIG.joints_stale + EPS, "ms old"),
        (HOME, STILL, CONFIG.joints_stale - EPS, ""),
    ],
)
def test_joint_readings_that_cannot_be_are_none(position, velocity, age, says):
    cell = Watched()
    verdict = cell.tick(joints=JointState(cell.now + 0.008 - age, position, velocity))
    assert (verdict.joints is None) == bool(says)
    assert verdict.severity == (Severity.BRAKE if says else Severity.NONE)
    assert says in verdict.reason
    assert Watched().tick(joints=None).severity == Severity.BRAKE


@pytest.mark.parametrize("name", ["ur5", "panda"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_joints_may_be_a_little_outside_their_limits_and_no_more(name, side):
    robot = load_robot(name)
    limits = robot.limits
    for joint in range(robot.n):
        for beyond, refused in ((OUTSIDE - EPS, False), (OUTSIDE + EPS, True)):
            q = robot.home.copy()
            q[joint] = limits.upper[joint] + beyond if side > 0 else limits.lower[joint] - beyond
            watch = FaultWatch(robot, [], CONFIG)
            verdict = watch.check(1.0, JointState(1.0, q, np.zeros(robot.n)), EMPTY)
            assert (verdict.joints is None) == refused
            if refused:
                assert verdict.reason.startswith(f"{robot.joint_names[joint]} at {q[joint]:.3f}")


@pytest.mark.parametrize(("joint", "side"), [(0, 1.0), (3, -1.0)])
@pytest.mark.parametrize("speed", [0.0, 1.2])
@pytest.mark.parametrize("ramp", [0.0, 1.0, -1.0])
def test_a_joint_moves_as_its_own_speed_says_and_does_not_step(joint, side, speed, ramp):
    """0.01 rad, 10 ms of its speed, and a ramp that the two speeds do not tell."""
    step = 0.03
    most = ROBOT.limits.acceleration[joint]
    faster = speed + ramp * most * step  # at its ramp's end
    allowed = STEP + TIMING * abs(faster) + 0.5 * most * step * step
    for beyond, refused in ((-EPS, False), (EPS, True)):
        cell = Watched()
        first = JointState(cell.now + 0.008, HOME, one(joint, speed))
        assert cell.tick(joints=first).severity == Severity.NONE
        way = 0.5 * (speed + faster) * step + side * (allowed + beyond)
        there = HOME + one(joint, way)
        verdict = cell.tick(step, joints=JointState(cell.now + step, there, one(joint, faster)))
        said = verdict.reason.startswith(f"{ROBOT.joint_names[joint]} jumped by")
        assert said == refused
        assert verdict.severity == Severity.BRAKE or not refused


def test_a_joint_that_stepped_is_left_alone_and_then_believed():
    cell = Watched()
    cell.q = HOME + one(2, STEP + 2.0 * EPS + 0.5 * ROBOT.limits.acceleration[2] * 0.008**2)
    assert cell.tick().reason.startswith("elbow_joint jumped by 0.6 deg")
    until = cell.now + HELD
    while cell.now + 0.009 < until:
        assert cell.tick().severity == Severity.BRAKE, "nobody knows which of the two was right"
    while cell.tick().severity != Severity.NONE:
        assert cell.now < until + CONFIG.recovery + 0.02


def test_of_before_a_jump_of_the_clock_nothing_is_known():
    cell = Watched()
    cell.q = HOME + one(0, 5.0)
    verdict = cell.tick(-0.01)
    assert verdict.jumped
    assert verdict.joints is not None
    assert "the clock jumped back" in verdict.reason


def test_what_lost_time_has_made_old_is_said_with_its_cause():
    cell = Watched()
    assert cell.tick(0.3).reason == "the guard was 300 ms late"
    old = {"slow": (0.4, True, False, 0)}
    first = cell.tick(**old).reason
    assert first == "camera slow is 400 ms old (why) (since the guard was 300 ms late)"
    assert cell.tick().reason == f"recovering: {first}"
    while cell.tick().severity != Severity.NONE:
        pass
    assert cell.tick(**old).reason == "camera slow is 400 ms old (why)", "that was then"


def test_a_map_that_says_nothing_is_named_and_not_its_cameras_alone():
    cell = Watched()
    snapshot = replace(EMPTY, sequence=500, stamp=cell.now, cameras=cell.cameras())
    while (verdict := cell.tick(snapshot=snapshot)).severity == Severity.NONE:
        pass
    assert re.match(r"camera \w+ is \d+ ms old \(the map has been silent", verdict.reason)


def test_maps_that_are_old_or_of_a_time_to_come_are_not_taken():
    cell = Watched()
    good = replace(EMPTY, sequence=500, stamp=cell.now, cameras=cell.cameras())
    assert cell.tick(snapshot=good).snapshot is good
    for change, says in (
        ({"sequence": 499}, "came after map 500"),
        ({"sequence": 501, "stamp": cell.now + 0.016 + CONFIG.future + EPS}, "in the future"),
    ):
        verdict = cell.tick(snapshot=replace(good, **change))
        assert verdict.snapshot is good
        assert verdict.severity == Severity.SLOW
        assert says in verdict.reason
    cell = Watched()
    soon = replace(good, stamp=cell.now + 0.008 + CONFIG.future - EPS, cameras=cell.cameras())
    verdict = cell.tick(snapshot=soon)
    assert (verdict.severity, verdict.snapshot) == (Severity.NONE, soon)
    verdict = cell.tick(snapshot=None)
    assert (verdict.severity, verdict.snapshot) == (Severity.SLOW, soon)
    assert verdict.reason == "no map yet"


@pytest.mark.parametrize("name", ["slow", "quick"])
def test_each_camera_may_be_as_old_as_its_latency_and_rate_have_it(name):
    for beyond, severity in ((-EPS, Severity.NONE), (EPS, Severity.SLOW)):
        verdict = Watched().tick(**{name: (ALLOWED[name] + beyond, True, False, 0)})
        assert verdict.severity == severity
        if severity:
            assert verdict.reason.startswith(f"camera {name} is ")
            assert verdict.reason.endswith("ms old (why)")


def test_what_is_said_of_cameras_that_are_silent_untrusted_or_excluded():
    told = {
        (0.03, False, False, 0): "camera slow is not trusted (why)",
        (np.inf, False, False, 0): "camera slow has sent nothing yet",
        (np.inf, False, False, 3): "camera slow has sent nothing usable (why)",
        (0.03, False, True, 0): "",
        (9.0, False, True, 0): "",
    }
    for status, says in told.items():
        verdict = Watched().tick(slow=status)
        assert verdict.reason == says
        assert verdict.severity == (Severity.SLOW if says else Severity.NONE)
    excluded = (0.03, False, True, 0)
    verdict = Watched().tick(slow=excluded, quick=excluded)
    assert verdict.reason == "no camera can be trusted: slow why"
    cell = Watched()
    cell.now += 0.008
    only = cell.cameras()[:1]
    cell.now -= 0.008
    assert cell.tick(statuses=only).reason == "camera quick has sent nothing yet"


def test_a_map_is_as_old_as_the_oldest_picture_that_counts():
    assert Watched().tick(slow=(0.09, True, False, 0)).age == pytest.approx(0.09)
    assert Watched().tick(quick=(0.08, True, False, 0)).age == pytest.approx(0.08)
    assert Watched().tick(slow=(0.09, False, True, 0)).age == pytest.approx(0.03)
    dead = (0.03, False, True, 0)
    assert Watched().tick(slow=dead, quick=dead).age == np.inf
    none = FaultWatch(ROBOT, [], CONFIG)
    assert none.check(200.0, JointState(200.0, HOME, STILL), EMPTY).age == 0.0
    assert none.check(200.008, JointState(200.008, HOME, STILL), None).snapshot is EMPTY


def test_the_worst_of_several_faults_is_answered():
    verdict = Watched().tick(CONFIG.late + EPS, joints=None)
    assert verdict.severity == Severity.BRAKE
    assert "no joint state" in verdict.reason
