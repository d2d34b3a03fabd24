"""Tasks and perceivers in a session: what they see, when, and what becomes of bad ones."""

import threading
import time
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from doubles import FakeGuard, FakeMap, FakePlanner, GoTo, make_cell

from armsight.errors import DeviceError, LoopError, UsageError
from armsight.mapping.snapshot import CameraStatus
from armsight.motion.face import Button, Curve, Face, Figure, FrameMark, PointsMark
from armsight.motion.intents import JointIntent, Rest, VelocityIntent
from armsight.motion.perception import CameraUse, SeenRobot
from armsight.motion.permits import Permit, PermitState
from armsight.motion.regions import Region
from armsight.motion.task import Subscriptions
from armsight.runtime.channels import Channels
from armsight.runtime.components import GuardComponent, MappingComponent
from armsight.runtime.config import SessionConfig, SessionMode
from armsight.runtime.latency import Latency
from armsight.runtime.parts import Parts
from armsight.runtime.session import Session


def session_of(task, cell=None, guard=None, patience=5.0, **kwargs):
    guard = guard or FakeGuard()
    parts = Parts(FakeMap(), FakePlanner(), guard)
    session = Session(
        cell or make_cell(), task, make=lambda c, k: parts,
        config=SessionConfig(patience=patience), **kwargs,
    )  # fmt: skip
    return session, guard


class Scripted:
    """Does what a function says at each round."""

    name = "scripted"
    period = 0.02

    def __init__(self, act, subscriptions=None, latency=0.004):
        self.act, self.latency = act, latency
        self.subscriptions = subscriptions or Subscriptions()
        self.seen = []
        self.resets = 0

    def update(self, observation):
        self.seen.append(observation)
        return self.act(observation)

    def reset(self):
        self.resets += 1


@dataclass(frozen=True)
class Count:
    stamp: float
    frames: int


class Counter:
    """Counts frames."""

    name = "counter"
    period = 0.01
    latency = 0.03
    cameras = (CameraUse("c", color_rate=5.0, color_scale=0.5),)

    def __init__(self):
        self.rounds = []

    def update(self, frames):
        self.rounds.append(frames)
        return Count(frames[-1].frame.stamp, len(self.rounds))


def test_a_task_runs_at_its_own_period_and_its_word_is_late_by_its_latency():
    goal = JointIntent("G", np.array([1.0, -1.0]))
    task = Scripted(lambda o: goal if o.now >= 0.1 else None)
    session, guard = session_of(task)
    session.run(0.5)
    assert [o.now for o in task.seen][:25] == pytest.approx(np.arange(25) * 0.02)
    first = next(s[0] for s in guard.seen if s[3] is not None)
    assert first == pytest.approx(0.104, abs=0.008)
    assert first >= 0.104


def test_the_task_never_delays_the_guard():
    """A round that takes 50 ms of the clock every 20 ms: the guard ticks as without a task."""
    task = Scripted(lambda o: None, latency=0.05)
    session, slow = session_of(task)
    session.run(0.5)
    alone, free = session_of(None)
    alone.run(0.5)
    assert [s[0] for s in slow.seen] == [s[0] for s in free.seen]
    assert len(task.seen) == pytest.approx(10, abs=1)
    missed = {h.name: h.missed for h in session.health()}
    assert missed["task/scripted"] >= 10
    assert missed["guard"] == 0


def test_the_new_port_gives_the_commands_of_a_task_inside_the_tick(monkeypatch):
    """The oracle: the task asked by the guard's own round, as before the port."""

    def run(inside):
        cell = make_cell()
        goal = {"k": 0}

        class Visits(GoTo):
            def update(self, o):
                # Changes its goal whenever the arm is near, as a patrol does.
                q = np.zeros(2) if o.joints is None else o.joints.position
                target = np.array([0.1, -0.1]) * (1 if goal["k"] % 2 == 0 else -1)
                if np.abs(q - target).max() < 0.1:
                    goal["k"] += 1
                return JointIntent(f"G{goal['k'] % 2}", target)

        task = Visits()
        session, _ = session_of(task, cell)
        if inside:
            component = session._task
            component.update = lambda now: None
            session._guard._intent = lambda now: task.update(component._observe(now))
        session.run(3.0)
        assert goal["k"] >= 2
        return cell.arm.log

    assert run(inside=False) == run(inside=True)


@pytest.mark.parametrize("wall", [False, True])
def test_a_task_that_raises_ends_and_the_arm_rests_with_the_reason(wall):
    def act(o):
        if o.now > 0.1:
            raise ValueError("no ball of mine")
        return JointIntent("G", np.array([1.0, -1.0]))

    session, guard = session_of(Scripted(act), mode=SessionMode(wall=wall))
    session.run(0.6)
    last = guard.seen[-1][3]
    assert isinstance(last, Rest)
    assert last.fault
    assert last.reason == "task scripted failed: ValueError: no ball of mine"
    assert session.task_failure == last.reason
    assert {h.name: h.problem for h in session.health()}["task/scripted"] == last.reason
    assert guard.seen[-1][0] > 0.5  # the loop went on


@pytest.mark.parametrize("wall", [False, True])
def test_a_task_that_hangs_is_given_up_and_the_run_ends_in_time(wall):
    never = threading.Event()

    def act(o):
        if o.now > 0.1:
            never.wait(60.0)
        return JointIntent("G", np.array([1.0, -1.0]))

    session, guard = session_of(Scripted(act), patience=0.5, mode=SessionMode(wall=wall))
    session.run(1.2 if wall else 0.6)
    never.set()
    reasons = [s[3].reason for s in guard.seen if isinstance(s[3], Rest)]
    assert reasons[-1] == "task scripted failed: did not return within 0.5 s"
    if wall:  # before it is given up, its word grows old
        assert any("task scripted has said nothing for" in r for r in reasons)


def test_a_task_that_is_silent_under_the_wall_clock_is_not_taken_at_its_old_word():
    slow = threading.Event()

    def act(o):
        if 0.1 < o.now < 0.2:
            slow.wait(0.6)
        return JointIntent("G", np.array([1.0, -1.0]))

    session, guard = session_of(Scripted(act), mode=SessionMode(wall=True))
    session.run(1.4)
    kinds = [type(s[3]).__name__ for s in guard.seen]
    assert "Rest" in kinds
    assert kinds[-1] == "JointIntent"  # and it goes on when the task is back
    assert not session.task_failure


def test_perceivers_see_frames_with_joints_and_wake_the_task():
    counter = Counter()
    task = Scripted(lambda o: None, Subscriptions(perceivers=("counter",)), latency=0.0)
    task.perceivers = (counter,)
    cell = make_cell()
    session, _ = session_of(task, cell)
    session.run(0.5)
    assert cell.cameras[0].color == (5.0, 0.5)
    posed = counter.rounds[-1][0]
    assert posed.frame.camera == "c"
    assert posed.joints.stamp == pytest.approx(posed.frame.stamp)
    assert np.array_equal(posed.T_base_camera, np.eye(4))
    for observation in task.seen:
        found = observation.newest(Count)
        assert found is observation.result("counter")
        if found is not None:
            assert observation.now >= found.stamp + 0.03 - 1e-9
    # A new observation starts a round of the task at once, besides its own grid of 20 ms.
    extra = [o for o in task.seen if abs(o.now / 0.02 - round(o.now / 0.02)) > 1e-6]
    assert extra
    assert all(o.newest(Count).stamp == pytest.approx(o.now - 0.03) for o in extra)


def test_a_perceiver_that_raises_loses_the_round_only():
    class Moody(Counter):
        def update(self, frames):
            super().update(frames)
            if len(self.rounds) % 2:
                raise RuntimeError("blurred")
            return Count(frames[-1].frame.stamp, len(self.rounds))

    moody = Moody()
    task = Scripted(lambda o: None, Subscriptions(perceivers=("counter",)))
    session, _ = session_of(task, perceivers=[moody])
    session.run(0.6)
    assert len(moody.rounds) > 10
    assert task.seen[-1].newest(Count) is not None
    session.run(0.034)
    problems = {h.name: h.problem for h in session.health()}
    assert problems["perceiver/counter"] in ("", "RuntimeError: blurred")


def test_what_a_perceiver_publishes_needs_a_stamp():
    class Stampless(Counter):
        def update(self, frames):
            return "a ball"

    task = Scripted(lambda o: None, Subscriptions(perceivers=("counter",)))
    session, _ = session_of(task, perceivers=[Stampless()])
    session.run(0.3)
    assert task.seen[-1].result("counter") is None
    assert "its str has no finite stamp" in {h.name: h.problem for h in session.health()}.values()


def test_a_face_is_shown_with_its_past_and_its_buttons_come_back():
    pressed = []

    class Faced(Scripted):
        def face(self):
            value = self.seen[-1].now
            return Face(
                "working", "", (Figure("age", 1.0, "s"),), (Curve("time", value, "s"),),
                buttons=(Button("again", "Again"),),
            )  # fmt: skip

        def press(self, button):
            pressed.append((button, threading.current_thread().name))

    session, _ = session_of(Faced(lambda o: None))
    session.run(1.0)
    session.press("again")
    session.run(0.1)
    shown = session.view().face
    assert shown.task == "scripted"
    assert shown.face.state == "working"
    trace = shown.traces[0]
    assert trace.times == pytest.approx(trace.values)
    assert 15 <= len(trace.times) <= 25
    assert pressed == [("again", "task/scripted")]


class FakeGripper:
    """Notes where it is told to go; refuses what is wider than it is."""

    def __init__(self):
        self.told = []

    def move(self, width):
        if not 0.0 <= width <= 0.085:
            raise DeviceError(f"no width of {width} m")
        self.told.append(width)

    def read(self):
        return None


def test_the_width_of_an_intent_moves_the_gripper_once():
    cell = make_cell()
    cell.gripper = FakeGripper()
    widths = {0: None, 1: 0.02, 2: 0.02, 3: None, 4: 0.08}
    session, _ = session_of(
        Scripted(lambda o: Rest("", width=widths[min(int(10 * o.now), 4)])), cell
    )
    session.run(1.0)
    assert cell.gripper.told == [0.02, 0.08]


def test_a_width_that_cannot_be_is_said_and_the_task_goes_on():
    cell = make_cell()
    cell.gripper = FakeGripper()
    session, _ = session_of(Scripted(lambda o: Rest("", width=0.5)), cell)
    session.run(0.3)
    (health,) = [h for h in session.health() if h.name == "task/scripted"]
    assert "gripper: no width of 0.5 m" in health.problem
    assert session.task_failure == ""


def test_what_a_task_says_stands_in_the_cell_is_passed_on_where_it_changes():
    box, other = (object(),), (object(),)
    said = {0: {}, 1: {"car": box}, 2: {"car": box}, 3: {"car": other}, 4: {}}

    def script(observation):
        task.standing = dict(said[min(int(10 * observation.now), 4)])
        return Rest("")

    task, told = Scripted(script), []
    session, _ = session_of(task, make_cell())
    session._task.on_standing = lambda name, solids: told.append((name, solids))
    session.run(1.0)
    assert told == [("car", box), ("car", ()), ("car", other), ("car", ())]


def test_what_cannot_stand_in_the_cell_is_said_and_the_task_goes_on():
    task = Scripted(lambda o: Rest(""))
    task.standing = {"car": ()}
    session, _ = session_of(task, make_cell())

    def refuse(name, solids):
        raise UsageError(f"'{name}' has 0 solids")

    session._task.on_standing = refuse
    session.run(0.3)
    (health,) = [h for h in session.health() if h.name == "task/scripted"]
    assert "what stands in the cell: 'car' has 0 solids" in health.problem
    assert session.task_failure == ""


def test_a_face_that_cannot_be_shown_is_said_and_does_no_harm():
    class Faced(Scripted):
        def face(self):
            return Face(figures=(Figure("x", 1.0), Figure("x", 2.0)))

    task = Faced(lambda o: JointIntent("G", np.array([1.0, -1.0])))
    session, guard = session_of(task)
    session.run(0.3)
    problem = {h.name: h.problem for h in session.health()}["task/scripted"]
    assert problem == "task scripted: figures have the name x twice"
    assert session.view().face is None
    assert isinstance(guard.seen[-1][3], JointIntent)


@pytest.mark.parametrize(
    ("face", "words"),
    [
        (Face(curves=(Button("a", "A"),)), "curves: a: a Button is none of the curves"),
        (Face(figures=(Figure("a", "3"),)), "figures: a: its value must be a number, not '3'"),
        (Face(figures=(Figure("a", np.ones(1)),)), "its value must be a number"),
        (Face(marks=(FrameMark("a", np.eye(4), float("nan")),)), "its length must be above 0"),
        (Face(marks=(PointsMark("a", np.ones((1, 3)), 0.1, "red"),)), "its color is 'red'"),
        (Face(marks=(PointsMark("a", np.ones((1, 3)), 0.1, (0, 0, 256)),)), "its color is"),
    ],
)
def test_no_face_ends_a_run(face, words):
    """What page, recorder or the loop itself would raise for is said before it comes there."""

    class Faced(Scripted):
        def face(self):
            return face

    session, _ = session_of(Faced(lambda o: None))
    session.run(0.2)
    assert words in {h.name: h.problem for h in session.health()}["task/scripted"]
    assert session.view().face is None
    assert session.task_failure == ""


def test_subscriptions_that_raise_in_a_run_end_the_task_and_not_the_run():
    class Fickle(Scripted):
        @property
        def subscriptions(self):
            if len(self.seen) > 5:
                raise KeyError("which camera?")
            return Subscriptions()

        @subscriptions.setter
        def subscriptions(self, value):
            pass

    class Blank(Fickle):
        @property
        def subscriptions(self):
            return None if len(self.seen) > 5 else Subscriptions()

        @subscriptions.setter
        def subscriptions(self, value):
            pass

    for task, words in ((Fickle, "KeyError: 'which camera?'"), (Blank, "its subscriptions: ")):
        session, guard = session_of(task(lambda o: Rest("")))
        session.run(0.4)
        assert session.task_failure.startswith(f"task scripted failed: {words}")
        assert guard.seen[-1][3].fault


def test_a_pair_that_is_wanted_in_a_run_and_not_there_ends_the_task_in_words():
    def act(observation):
        task.subscriptions = Subscriptions(stereo=("wrist",) if observation.now > 0.1 else ())
        return Rest("")

    task = Scripted(act)
    session, _ = session_of(task)
    session.run(0.3)
    assert "no stereo pair 'wrist' in this cell; there are: none" in session.task_failure


def test_a_gripper_that_was_lost_is_told_again_and_its_fault_is_forgotten():
    """A width that came while it was being opened again was lost for good."""

    class Lost(FakeGripper):
        times = 0

        def move(self, width):
            Lost.times += 1
            if Lost.times < 3:
                raise DeviceError("gripper: no answer")
            super().move(width)

    cell = make_cell()
    cell.gripper = Lost()
    session, _ = session_of(Scripted(lambda o: Rest("", width=0.02)), cell)
    session.run(0.4)
    assert Lost.times == 1
    (health,) = [h for h in session.health() if h.name == "task/scripted"]
    assert "gripper: no answer" in health.problem
    session.run(1.0)
    assert cell.gripper.told == [0.02]
    assert Lost.times == 3
    (health,) = [h for h in session.health() if h.name == "task/scripted"]
    assert health.problem == ""


@pytest.mark.parametrize("width", [np.array([0.01, 0.02]), "wide", float("nan")])
def test_a_width_that_is_no_number_is_said(width):
    cell = make_cell()
    cell.gripper = FakeGripper()
    session, _ = session_of(Scripted(lambda o: Rest("", width=width)), cell)
    session.run(0.2)
    assert "gripper: " in {h.name: h.problem for h in session.health()}["task/scripted"]
    assert session.task_failure == ""


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ({"excluded": ("c",)}, "cannot be read: ValueError"),
        ({"excluded": (("c", None),)}, "expected a camera's name and a reason"),
        ({"excluded": None}, "cannot be read: TypeError"),
        ({"placed": ("c",)}, "has placed a str"),
        ({"robots": ("ur5",)}, "has seen a str"),
        ({"robots": (SeenRobot("ur5", np.zeros(3), np.zeros((0, 3)), 0.0),)}, "expected (k, 3)"),
        ({"robots": (SeenRobot("a", np.full((2, 3), np.nan), np.zeros((0, 3)), 0.0),)}, "(k, 3)"),
    ],
)
def test_what_a_perceiver_says_of_cameras_ends_no_run(extra, words):
    class Odd(Counter):
        def update(self, frames):
            word = Count(frames[-1].frame.stamp, 1)
            for key, value in extra.items():
                object.__setattr__(word, key, value)
            return word

    session, _ = session_of(None, perceivers=[Odd()])
    session.run(0.3)
    assert words in {h.name: h.problem for h in session.health()}["perceiver/counter"]


def test_a_stamp_of_single_precision_is_a_stamp_and_no_warning_is_none():
    @dataclass(frozen=True)
    class Single:
        stamp: np.float32
        warning: None = None

    class Half(Counter):
        def update(self, frames):
            return Single(np.float32(frames[-1].frame.stamp))

    task = Scripted(lambda o: None, Subscriptions(perceivers=("counter",)))
    session, _ = session_of(task, perceivers=[Half()])
    session.run(0.3)
    assert task.seen[-1].result("counter") is not None
    assert {h.name: h.problem for h in session.health()}["perceiver/counter"] == ""


def test_a_perceiver_that_cannot_bear_doubts_harms_no_map():
    class Upset(Counter):
        def doubted(self, camera, excluded):
            raise RuntimeError("not mine")

    session, _ = session_of(None, perceivers=[Upset()])
    perceiver = session._components[3]
    perceiver.doubted("c", True)
    assert perceiver.problem == "doubted() failed: RuntimeError: not mine"


def test_a_perceiver_without_its_parts_is_refused_in_words():
    class Bare:
        name, period = "bare", 0.1

    with pytest.raises(UsageError, match="perceiver bare has no cameras, update"):
        session_of(None, perceivers=[Bare()])


def test_perceivers_and_the_task_are_prepared_once_before_time_begins():
    class Slow(Counter):
        def warm_up(self):
            prepared.append(("counter", cell.clock.now()))

    class SlowTask(Scripted):
        def warm_up(self):
            prepared.append(("task", cell.clock.now()))

    prepared, cell = [], make_cell()
    session, _ = session_of(SlowTask(lambda o: None), cell, perceivers=[Slow()])
    session.warm_up()
    session.run(0.1)
    session.warm_up()
    assert prepared == [("counter", 0.0), ("task", 0.0)]


def test_what_cannot_be_prepared_is_said():
    class Lame(Counter):
        def warm_up(self):
            raise OSError("no weights")

    session, _ = session_of(None, perceivers=[Lame()])
    with pytest.raises(LoopError, match=r"counter cannot be prepared \(OSError: no weights\)"):
        session.warm_up()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"period": 0.0}, "task scripted: period is 0.0; expected 0.001 to 10 seconds"),
        ({"latency": float("nan")}, "task scripted: latency is nan"),
        (
            {"subscriptions": Subscriptions(cameras=(CameraUse("left"),))},
            "task scripted: no camera 'left' in this cell; there are: c",
        ),
        (
            {"subscriptions": Subscriptions(perceivers=("ball",))},
            "task scripted: no perceiver 'ball' runs in this session; there are: none",
        ),
    ],
)
def test_impossible_subscriptions_are_refused_when_the_session_is_built(change, message):
    task = Scripted(lambda o: None)
    for key, value in change.items():
        setattr(task, key, value)
    with pytest.raises(UsageError, match=message):
        session_of(task)


def test_two_perceivers_of_one_name_are_refused():
    with pytest.raises(UsageError, match="two perceivers have the same name"):
        session_of(None, perceivers=[Counter(), Counter()])


def test_a_perceiver_takes_a_camera_out_of_the_map_and_warns():
    @dataclass(frozen=True)
    class Bumped(Count):
        excluded: tuple[tuple[str, str], ...] = ()
        warning: str = ""

    class Watch(Counter):
        def update(self, frames):
            stamp = frames[-1].frame.stamp
            out = (("c", "was moved"),) if stamp > 0.3 else ()
            return Bumped(stamp, 1, out, "the board slipped" if out else "")

    session, _ = session_of(None, perceivers=[Watch()])
    session.run(0.25)
    calls = session._parts.workspace.calls
    assert ("c", "was moved") not in calls
    session.run(0.5)
    first = calls.index(("c", "was moved"))
    before = [call for call in calls[:first] if len(call) == 3]
    assert before[-1][0] >= 0.3 + 0.03 - 0.02 - 1e-9  # not before it could be known
    assert "the board slipped" in {h.name: h.problem for h in session.health()}.values()


def test_an_arm_that_nobody_announces_goes_to_the_map_once_a_sighting_and_to_whoever_looks():
    @dataclass(frozen=True)
    class Word(Count):
        robots: tuple[SeenRobot, ...] = ()

    none = np.zeros((0, 3))
    first, second = (SeenRobot("ur5", np.ones((k, 3)), none, 0.1 * k) for k in (3, 7))

    class Watch(Counter):
        def update(self, frames):
            stamp = frames[-1].frame.stamp
            seen = () if stamp > 0.9 else (second,) if stamp > 0.5 else (first,)
            return Word(stamp, 1, seen)

    session, _ = session_of(None, perceivers=[Watch()])
    session.run(0.4)
    assert session.view().robots == (first,)
    session.run(0.4)
    assert session.view().robots == (second,)
    session.run(0.4)
    assert session.view().robots == ()
    told = [call for call in session._parts.workspace.calls if call[0] == "animated"]
    assert told == [("animated", 3), ("animated", 7)]


@pytest.mark.parametrize(("kind", "words"), [("hand", 3), ("face", 3), ("thing", 0)])
def test_what_a_task_asks_to_touch_of_somebody_is_no_thing_for_as_long_as_it_asks(kind, words):
    workspace, channels = FakeMap(), Channels()
    mapping = MappingComponent(channels, workspace, Latency(0.03))
    center = np.array([0.4, -0.1, 0.3])
    T = np.eye(4)
    T[:3, 3] = center
    region = Region("sphere", (0.1, 0.1, 0.1), T, 0.0)
    status = SimpleNamespace(permit=Permit("it", kind, PermitState.REFUSED, "why", region))
    channels.status.publish(status, 0.0)
    for now in np.arange(0.0, 2.5, 0.1):
        mapping.update(float(now))
    said = [call for call in workspace.calls if call[0] == "animated"]
    assert said == [("animated", 27)] * words
    channels.status.publish(SimpleNamespace(permit=None), 2.5)
    mapping.update(4.0)
    assert len([c for c in workspace.calls if c[0] == "animated"]) == words


def test_a_camera_that_was_placed_counts_again_until_it_is_blamed_anew():
    @dataclass(frozen=True)
    class Word(Count):
        excluded: tuple[tuple[str, str], ...] = ()
        placed: tuple[object, ...] = ()

    class Watch(Counter):
        def update(self, frames):
            stamp, there = frames[-1].frame.stamp, frames[-1].info
            # The old word against it is repeated; one more comes later.
            blamed = (("c", "old"),) + ((("c", "new"),) if stamp > 0.6 else ())
            return Word(stamp, 1, blamed, (there,) if stamp > 0.3 else ())

    session, _ = session_of(None, perceivers=[Watch()])
    session.run(0.5)
    calls = [c for c in session._parts.workspace.calls if len(c) == 2]
    assert calls.count(("placed", "c")) == 1
    assert calls[-1] == ("placed", "c")
    assert set(calls[:-1]) == {("c", "old")}
    session.run(0.3)
    later = [c for c in session._parts.workspace.calls if len(c) == 2][len(calls) :]
    assert set(later) == {("c", "new")}


@pytest.mark.parametrize(("excluded", "at"), [(True, 0.2), (False, 1.0)])
def test_perceivers_are_told_once_of_a_camera_that_does_not_count(excluded, at):
    told = []

    class Watch(Counter):
        def doubted(self, camera, excluded):
            told.append((camera, excluded))

    session, _ = session_of(None, perceivers=[Watch()])
    workspace = session._parts.workspace
    plain = workspace.update

    def update(frames, joints, now, tracked=None):
        snapshot = plain(frames, joints, now, tracked)
        bad = 0.2 < now < 1.6
        one = CameraStatus("c", now, not bad, 1, 0, "is odd" if bad else "", excluded and bad)
        short = CameraStatus("d", now, not 0.3 < now < 0.7, 1, 0, "late" if now < 0.7 else "")
        snapshot.cameras = (one, short)
        return snapshot

    workspace.update = update
    session.run(at)
    assert told == []
    session.run(1.0)
    assert told == [("c", excluded)]


def test_a_reset_begins_task_and_perceivers_anew():
    task = Scripted(lambda o: None)
    session, _ = session_of(task)
    session.run(0.2)
    session.reset()
    assert task.resets == 1


def test_two_runs_with_a_slow_task_and_a_perceiver_are_the_same_bit_for_bit():
    logs = []
    for pause in (0.0, 0.003):  # however long the computing really takes

        def act(o, pause=pause):
            time.sleep(pause)
            found = o.newest(Count)
            k = 0 if found is None else found.frames
            return JointIntent(f"G{k}", np.array([0.01 * k, -0.01 * k]))

        cell = make_cell()
        task = Scripted(act, Subscriptions(perceivers=("counter",)))
        session, _ = session_of(task, cell, perceivers=[Counter()])
        session.run(1.0)
        logs.append(cell.arm.log)
    assert logs[0] == logs[1]


def test_the_guard_component_takes_what_the_task_says():
    seen = []

    class Spy(FakeGuard):
        def step(self, now, joints, snapshot, intent, plan):
            seen.append(intent)
            return super().step(now, joints, snapshot, None, plan)

    wish = VelocityIntent("v", np.zeros(2), "joint", 0.0, 0.5)
    session, _ = session_of(Scripted(lambda o: wish), guard=Spy())
    session.run(0.1)
    assert isinstance(session._guard, GuardComponent)
    assert seen[-1] is wish
