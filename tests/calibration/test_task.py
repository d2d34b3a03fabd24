"""The task that carries the procedure out: when it moves, when it looks, what it makes of it."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.calibration.live.seen import LookAt, MoveTo
from armsight.calibration.live.setup import CameraSetup, Setup
from armsight.devices.camera_models import camera_info
from armsight.devices.data import JointState, RgbdFrame
from armsight.errors import CalibrationError
from armsight.motion.data import GuardMode, GuardStatus
from armsight.motion.intents import JointIntent, Rest
from armsight.motion.perception import PosedFrame
from armsight.motion.task import Observation
from armsight.tasks import calibrate
from armsight.tasks.calibrate import CalibrateTask
from armsight.tasks.procedure_task import STUCK, WAIT

GOAL = np.array([0.5, -1.0, 1.0, 0.0, 0.0, 0.0])
INFO = camera_info("cam", "kinect_v2")


class Script:
    """A procedure that wishes what it is told and keeps the replies."""

    def __init__(self, *wishes, end="done"):
        self.wishes, self.replies, self.end = wishes, [], end

    def __call__(self, *_):
        for wish in self.wishes:
            self.replies.append((yield wish))
        if isinstance(self.end, Exception):
            raise self.end
        return self.end


def task_of(monkeypatch, arm5, script):
    monkeypatch.setattr(calibrate, "procedure", script)
    camera = CameraSetup("cam", INFO.depth, INFO.color, INFO.T_depth_color)
    board = type("B", (), {"points": np.zeros((4, 3))})()
    return CalibrateTask(Setup(arm5, (camera,), board, np.eye(4)), None, np.random.default_rng(0))


def seen(now, arm5, q=None, speed=0.0, goal="", reached=False, frames=()):
    q = np.zeros(arm5.n) if q is None else q
    joints = JointState(now, q, np.full(arm5.n, speed))
    guard = GuardStatus(
        now, GuardMode.IDLE, "", goal, reached, np.zeros(arm5.n), 1.0, np.inf, 0.0, None, None,
        None, None, 0, 0.0,
    )  # fmt: skip
    return Observation(now, arm5, joints, guard, frames=tuple(frames))


def frame(stamp, sequence, grey=100, q=None):
    depth = np.full((INFO.depth.height, INFO.depth.width), 1.0 + 0.01 * sequence, np.float32)
    color = np.full((INFO.color.height, INFO.color.width, 3), grey, np.uint8)
    infrared = np.full(depth.shape, grey + 10, np.uint8)
    joints = None if q is None else JointState(stamp, q, np.zeros_like(q))
    taken = RgbdFrame("cam", sequence, stamp, stamp, depth, color, infrared=infrared)
    return PosedFrame(taken, INFO, joints, np.eye(4))


def test_a_move_ends_where_the_arm_rests(monkeypatch, arm5):
    script = Script(MoveTo(GOAL, "find"), MoveTo(-GOAL, "tilt"))
    task = task_of(monkeypatch, arm5, script)
    intent = task.update(seen(0.0, arm5))
    assert isinstance(intent, JointIntent)
    np.testing.assert_array_equal(intent.position, GOAL)
    assert task.subscriptions.cameras == ()  # nobody looks while the arm moves
    task.update(seen(0.1, arm5, GOAL, speed=0.3))  # there, and still moving
    assert script.replies == []
    intent = task.update(seen(0.2, arm5, GOAL))
    assert script.replies == [True]
    np.testing.assert_array_equal(intent.position, -GOAL)


def test_an_arm_that_does_not_get_there(monkeypatch, arm5):
    """The guard holds it: the procedure hears of it and goes on with something else."""
    script = Script(MoveTo(GOAL, "learn"), MoveTo(-GOAL, "learn"))
    task = task_of(monkeypatch, arm5, script)
    task.update(seen(0.0, arm5))
    task.update(seen(1.0, arm5))
    assert script.replies == []
    task.update(seen(1.2 + STUCK, arm5))
    assert script.replies == [False]


def test_pictures_are_of_the_resting_arm_and_averaged(monkeypatch, arm5):
    script = Script(LookAt((0,), 0.2, 2))
    task = task_of(monkeypatch, arm5, script)
    assert isinstance(task.update(seen(0.0, arm5, speed=0.1)), Rest)
    assert task.subscriptions.cameras[0].infrared
    task.update(seen(0.1, arm5, GOAL))  # rests from here on
    task.update(seen(0.25, arm5, GOAL, frames=[frame(0.22, 1, 10)]))  # rested too short
    task.update(seen(0.35, arm5, GOAL, frames=[frame(0.32, 2, 100, GOAL)]))
    task.update(seen(0.36, arm5, GOAL, frames=[frame(0.32, 2, 100, GOAL)]))  # the same again
    assert script.replies == []
    task.update(seen(0.45, arm5, GOAL, frames=[frame(0.40, 3, 103, GOAL)]))
    (looked,) = script.replies
    np.testing.assert_allclose(looked.joints, GOAL)
    picture = looked.pictures[0]
    assert set(np.unique(picture.color)) <= {101, 102}
    assert set(np.unique(picture.infrared)) <= {111, 112}
    np.testing.assert_allclose(picture.depth, 1.025, rtol=1e-6)
    assert task.result == "done"
    assert task.subscriptions.cameras == ()


def test_a_move_in_the_middle_of_a_look_begins_it_anew(monkeypatch, arm5):
    script = Script(LookAt((0,), 0.1, 2))
    task = task_of(monkeypatch, arm5, script)
    task.update(seen(0.0, arm5))
    task.update(seen(0.2, arm5, frames=[frame(0.15, 1)]))
    task.update(seen(0.3, arm5, speed=0.2))  # somebody came near: the guard moved it
    task.update(seen(0.4, arm5))
    task.update(seen(0.6, arm5, frames=[frame(0.55, 2)]))
    assert script.replies == []
    task.update(seen(0.7, arm5, frames=[frame(0.65, 3)]))
    assert len(script.replies) == 1


def test_a_camera_that_sends_nothing_is_not_waited_for_long(monkeypatch, arm5):
    script = Script(LookAt((0,), 0.1, 2))
    task = task_of(monkeypatch, arm5, script)
    task.update(seen(0.0, arm5))
    task.update(seen(0.2, arm5))
    task.update(seen(0.4 + WAIT, arm5))
    assert script.replies[0].pictures[0].problem == "the camera sent no picture"


def test_a_procedure_that_fails_leaves_the_arm_at_rest(monkeypatch, arm5):
    wrong = CalibrationError("no camera saw the board")
    task = task_of(monkeypatch, arm5, Script(end=wrong))
    assert isinstance(task.update(seen(0.0, arm5)), Rest)
    assert task.done
    assert task.error is wrong


def test_nothing_happens_before_the_arm_has_spoken(monkeypatch, arm5):
    script = Script(MoveTo(GOAL, "find"))
    task = task_of(monkeypatch, arm5, script)
    assert isinstance(task.update(replace(seen(0.0, arm5), joints=None)), Rest)
    assert not task.done


@pytest.mark.slow
def test_calibrating_lowers_the_cameras_true_error(tmp_path, monkeypatch, gl):
    """Calibrate, then let the map run as in a patrol: within 1.5 mm of the truth."""
    from armsight.cli import run
    from armsight.runtime.session import Session
    from armsight.workcell import open_cell
    from armsight.workcell.packaged import load

    monkeypatch.chdir(tmp_path)
    assert run(["calibrate", "ur5_calibration", "--headless"]) == 0
    errors = {}
    for calibrated in (False, True):
        with open_cell(load("ur5_calibration"), 0, calibrated=calibrated) as cell:
            session = Session(cell, None, seed=0)
            session.run(1.0)
            errors[calibrated] = [
                1e3 * cell.world.camera_error(c.name, c.T_believed_corrected, c.gain)
                for c in session.snapshot().corrections
            ]
    assert max(errors[True]) < 1.5
    assert max(errors[False]) > 20.0
    assert all(after < 0.1 * before for before, after in zip(errors[False], errors[True]))


def test_views_of_a_cell_drawn_with_another_seed_are_not_gone_on_from(
    tmp_path, monkeypatch, gl, capsys
):
    """Its true errors are others: the two would contradict each other."""
    from armsight.calibration import views_file
    from armsight.cli import run
    from armsight.workcell.packaged import load

    monkeypatch.chdir(tmp_path)
    workcell = load("ur5_calibration")
    about = {"cell": workcell.name, "cameras": [c.name for c in workcell.camera], "seed": 0}
    about |= {"board": workcell.board.kind, "lenses": "solved"}
    file = tmp_path / "calibration" / "views.jsonl"
    views_file.begin(file, about)
    before = file.read_text()
    assert run(["calibrate", "ur5_calibration", "--headless", "--seed", "1"]) == 1
    assert "views are of seed 0, not 1; use --fresh" in capsys.readouterr().err
    assert file.read_text() == before
