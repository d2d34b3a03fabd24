"""Showing the plug to the pair: the moves and the solve, and one look in rendered pictures."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from armsight.calibration.arm import flange_poses
from armsight.calibration.live.seen import LookAt, Looked, MoveTo, Picture
from armsight.calibration.robot_errors import RobotErrors
from armsight.charging import looks_file, plug_procedure
from armsight.charging.admittance import Admittance
from armsight.charging.eye import mounting_spread
from armsight.charging.hanging import hung
from armsight.charging.plug_procedure import PlugSetup, read_look
from armsight.charging.plug_views import hidden_by_arm, in_both, plug_views
from armsight.devices.data import StereoInfo
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, inverse, log, look_at
from armsight.geometry.stereo import converging_pair
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import sphere_centers
from armsight.robots.tools import load_tool
from armsight.simulation.world import SimulatedWorld
from armsight.tasks.room import BESIDE, RESTS, Room
from armsight.workcell import robot_in, world_spec
from armsight.workcell.packaged import load

ROBOT = load_robot("ur10").with_tool(load_tool("type2_plug"))
LENS = PinholeCamera(1280, 960, 1200.0, 1200.0, 640.0, 480.0)
PAIR = converging_pair(LENS, 0.2, np.arctan(0.2 / 1.2))
MOUNT = Admittance((5000.0, 30.0), 0.07)
TRUE_X = look_at([1.5, 0.1, 0.8], [0.6, 0.0, 0.5])
TRUE_Z = ROBOT.tool.T_flange_tcp @ exp(np.array([0.01, -0.02, 0.01, 0.03, -0.02, 0.04]))
SIGMA = np.array([1e-4, 1e-4, 2e-4, 5e-3, 5e-3, 2e-3])


def setup(looks=16, wrong=(0.04, -0.03, 0.02, 0.03, -0.04, 0.02), **changes):
    X = TRUE_X @ exp(np.array(wrong))
    info = StereoInfo("post", "pair", PAIR.left, PAIR.right, PAIR.T_left_right, "base", X, 2.0, 0.1)
    base = PlugSetup(
        ROBOT, RobotErrors(ROBOT), info, "type2_plug", MOUNT, lambda q: True, looks=looks
    )
    return replace(base, **changes)


@dataclass
class Cell:
    """An arm whose plug hangs in its mount, and a pair that sees it to ``SIGMA``."""

    rng: np.random.Generator
    blind: tuple[int, ...] = ()
    stuck: tuple[int, ...] = ()
    looks: int = 0
    moves: int = 0
    at: np.ndarray | None = None

    def see(self, setup, answer, looked):
        self.looks += 1
        if self.looks in self.blind:
            return None, "no type2_plug in the pictures"
        A = flange_poses(ROBOT, looked.joints[None])[0]
        T = inverse(TRUE_X) @ A @ hung(TRUE_Z, looked.wrench, MOUNT)
        T = T @ exp(SIGMA * self.rng.standard_normal(6))
        return SimpleNamespace(T_ref_port=T, covariance=np.diag(SIGMA**2), score=0.9), ""

    def answer(self, request):
        if isinstance(request, MoveTo):
            self.moves, self.at = self.moves + 1, request.joints
            return self.moves not in self.stuck
        assert isinstance(request, LookAt)
        R = flange_poses(ROBOT, self.at[None])[0][:3, :3]
        force = R.T @ [0.0, 0.0, -30.0]
        wrench = np.concatenate([force, np.cross([0.0, 0.0, 0.12], force)])
        return Looked(self.at, [Picture(None, None, None)], wrench)


def carry_out(monkeypatch, cell, steps, most=1000):
    """Be the cell; the result, or None where it was stopped after so many requests."""
    monkeypatch.setattr(plug_procedure, "read_look", cell.see)
    try:
        request = next(steps)
        for _ in range(most):
            request = steps.send(cell.answer(request))
    except StopIteration as end:
        return end.value
    return None


def test_pair_and_plug_are_found_from_cold(monkeypatch):
    """Pair 5 cm and 3 deg off, plug 2.4 cm and 3 deg, hanging by 6 mm: to what the looks allow."""
    cell = Cell(np.random.default_rng(1), blind=(3, 8), stuck=(2,))
    steps = plug_procedure.plug_procedure(setup(), np.random.default_rng(0))
    result = carry_out(monkeypatch, cell, steps)
    assert cell.moves == 19  # what was not reached or not seen was replaced
    assert cell.looks == 18
    assert len(result.looks) == 16
    assert sorted(result.dropped) == [
        "no type2_plug in the pictures", "no type2_plug in the pictures",
        "the arm did not get there",
    ]  # fmt: skip
    camera = log(inverse(TRUE_X) @ result.answer.T_base_camera)
    plug = log(inverse(TRUE_Z) @ result.answer.T_flange_plug)
    sigma = np.sqrt(np.diagonal(result.answer.covariance))[:12]
    assert (np.abs(np.concatenate([camera, plug])) < 4.0 * sigma).all()
    assert np.linalg.norm(plug[:3]) < 5e-4
    assert result.sigma < 5e-4


def test_an_arm_that_is_held_up_somewhere_looks_elsewhere(monkeypatch):
    """The guard keeps it from half of the places: seven looks came of 24 tries before."""
    cell = Cell(np.random.default_rng(1))
    s, answer = setup(), cell.answer
    rng = np.random.default_rng(3)
    joints, _ = plug_views(s.believed, ROBOT, s.pair.lenses, "type2_plug", 60, rng)
    middle = float(np.median(joints[:, 0]))

    def held(request):
        reply = answer(request)
        return reply and request.joints[0] < middle if isinstance(request, MoveTo) else reply

    cell.answer = held
    steps = plug_procedure.plug_procedure(setup(), np.random.default_rng(0))
    result = carry_out(monkeypatch, cell, steps)
    assert len(result.looks) == 16


def test_places_where_somebody_could_be_are_not_gone_to():
    """Unseen space 0.4 m from the elbow, say: the guard would stop the arm on its way there."""
    room = Room(ROBOT)
    q = np.array([0.0, -1.7, 2.4, -0.7, 1.6, 0.0])
    assert room.left(q) == np.inf
    elbow = sphere_centers(ROBOT, q)[np.asarray(ROBOT.spheres.link) == 3][0]
    for away in (0.4, 2.5):
        hazards = np.asarray(elbow + np.array([[0.0, away, 0.0]]), np.float32)
        room.snapshot = SimpleNamespace(sequence=away, hazards=hazards, hazard_radius=0.02)
        centers = sphere_centers(ROBOT, q)[np.asarray(ROBOT.spheres.link) > 0]
        radius = np.asarray(ROBOT.spheres.radius)[np.asarray(ROBOT.spheres.link) > 0]
        gap = np.linalg.norm(centers - hazards[0], axis=1) - radius - 0.02
        assert room.left(q) == pytest.approx(gap.min() - RESTS - BESIDE, abs=1e-6)
        assert (room.left(q) > 0.0) == (away > 1.0)
    asked = []
    s = setup(room=lambda joints: asked.append(joints) or -0.6 - joints[0])
    steps = plug_procedure.plug_procedure(s, np.random.default_rng(0))
    assert next(steps).joints[0] < -0.6
    assert max(joints[0] for joints in asked) > -0.6


def test_where_nowhere_is_room_enough_the_roomiest_places_are_gone_to():
    """A map of which no camera had told anything yet left the choice to chance: 49 s for none."""
    s = setup(room=lambda joints: -10.0 - abs(joints[0]))
    steps = plug_procedure.plug_procedure(s, np.random.default_rng(0))
    first = abs(next(steps).joints[0])
    drawn = plug_views(
        s.believed, ROBOT, s.pair.lenses, "type2_plug", 400, np.random.default_rng(0)
    )[0]
    assert first == np.abs(drawn[:, 0]).min()


def test_a_place_that_has_no_room_any_more_is_left_out(monkeypatch):
    """The arm's shadow goes along with it: what was chosen by an older map is asked for again."""
    cell, places = Cell(np.random.default_rng(1)), []
    answer = cell.answer

    def noted(request):
        if isinstance(request, MoveTo):
            places.append(request.joints[0])
        return answer(request)

    cell.answer = noted
    s = setup(room=lambda joints: 1.0 if not places else joints[0] - places[0])
    steps = plug_procedure.plug_procedure(s, np.random.default_rng(0))
    result = carry_out(monkeypatch, cell, steps)
    assert len(result.looks) == 16
    assert min(places[1:]) > places[0]


def test_without_a_force_sensor_how_it_hangs_stays_in_it(monkeypatch):
    """The same looks, nothing felt: what the mount gives way by is taken for the pair's place."""
    cell = Cell(np.random.default_rng(1))
    steps = plug_procedure.plug_procedure(setup(mount=None), np.random.default_rng(0))
    result = carry_out(monkeypatch, cell, steps)
    camera = log(inverse(TRUE_X) @ result.answer.T_base_camera)
    assert np.linalg.norm(camera[:3]) > 3e-3  # 6 mm down wherever the arm stands


def test_a_stopped_run_goes_on_from_its_looks(monkeypatch, tmp_path):
    file, about = tmp_path / "looks.jsonl", {"cell": "here", "plug": "type2_plug"}
    looks_file.begin(file, about)
    cell = Cell(np.random.default_rng(2))
    steps = plug_procedure.plug_procedure(
        setup(), np.random.default_rng(0), kept=lambda look: looks_file.append(file, look)
    )
    assert carry_out(monkeypatch, cell, steps, most=11) is None
    with file.open("a") as stream:
        stream.write('{"joints": [0.1, 0.2')  # cut short by the stop
    done = looks_file.read(file, about)
    assert len(done) == 5
    again = Cell(np.random.default_rng(3))
    steps = plug_procedure.plug_procedure(setup(), np.random.default_rng(1), done=done)
    result = carry_out(monkeypatch, again, steps)
    assert (again.looks, len(result.looks)) == (11, 16)
    np.testing.assert_array_equal(result.looks[2].T_camera_plug, done[2].T_camera_plug)
    assert np.linalg.norm(log(inverse(TRUE_X) @ result.answer.T_base_camera)[:3]) < 2e-3
    whole = plug_procedure.plug_procedure(setup(), np.random.default_rng(1), done=result.looks)
    with pytest.raises(StopIteration) as end:  # it was stopped after its last look
        next(whole)
    assert 0.0 < end.value.value.sigma < 2e-3
    with pytest.raises(CalibrationError, match=r"views are of plug type2_plug, not ccs2_plug"):
        looks_file.read(file, {"cell": "here", "plug": "ccs2_plug"})


def test_a_pair_that_never_sees_the_plug_is_said(monkeypatch):
    cell = Cell(np.random.default_rng(1), blind=tuple(range(1, 40)))
    steps = plug_procedure.plug_procedure(setup(), np.random.default_rng(0))
    with pytest.raises(CalibrationError, match=r"0 good looks of 9.*no type2_plug in the pic"):
        carry_out(monkeypatch, cell, steps)


def test_a_pair_that_looks_away_is_said(monkeypatch):
    away = setup(wrong=(0.0, 0.0, -9.0, 0.0, 0.0, 0.0))
    steps = plug_procedure.plug_procedure(away, np.random.default_rng(0))
    with pytest.raises(CalibrationError, match=r"before the pair post in 0 places only"):
        carry_out(monkeypatch, Cell(np.random.default_rng(1)), steps)


def test_the_arm_is_not_between_the_pair_and_its_plug():
    """In the first rendered picture the upper arm hid it (a guarded run, eighth look)."""
    s = packaged()
    for q, hidden in (
        ((-0.4, -1.928, 2.144, 2.478, 1.584, 2.477), True),
        ((-0.187, -1.864, 1.924, 3.057, 0.705, -2.572), False),
        ((0.763, -1.409, 2.17, -3.686, 0.731, 3.137), False),
    ):
        C = inverse(s.believed.T_base_camera) @ s.believed.base_tip(np.array(q))
        told = hidden_by_arm(
            s.robot, np.array(q), s.believed.T_base_camera, C, s.pair.lenses, 0.032
        )
        assert told == hidden
    rng = np.random.default_rng(2)
    joints, C = plug_views(s.believed, s.robot, s.pair.lenses, "type2_plug", 40, rng)
    X, links = s.believed.T_base_camera, np.asarray(s.robot.spheres.link) < s.robot.n
    for q, T in zip(joints, C):
        centers = sphere_centers(s.robot, q)[links]
        for eye in (X[:3, 3], (X @ s.pair.lenses.T_left_right)[:3, 3]):
            line = eye + np.linspace(0.0, 1.0, 300)[:, None] * ((X @ T)[:3, 3] - eye)
            away = np.linalg.norm(line[:, None] - centers, axis=2)
            assert (away > np.asarray(s.robot.spheres.radius)[links]).all()


def test_what_is_chosen_is_in_both_pictures():
    s = setup()
    joints, C = plug_views(
        s.believed,
        ROBOT,
        s.pair.lenses,
        "type2_plug",
        60,
        np.random.default_rng(3),
        lambda q: q[0] > 0,
    )
    assert len(joints) > 5
    assert (joints[:, 0] > 0).all()
    X, Z = s.believed.T_base_camera, s.believed.T_flange_plug
    for q, c in zip(joints, C):
        np.testing.assert_allclose(X @ c, flange_poses(ROBOT, q[None])[0] @ Z, atol=2e-3)
        for lens, T in ((PAIR.left, np.eye(4)), (PAIR.right, inverse(PAIR.T_left_right))):
            u, v = lens.project((T @ c)[None, :3, 3])[0]
            assert 40 < u < 1240
            assert 40 < v < 920
    assert not in_both(PAIR, C[:1] @ exp(np.array([3.0, 0, 0, 0, 0, 0])), 0.03).any()


def rendered(q):
    """(looked, truth) of the packaged cell with its arm at (n,) [rad]: what its pair sees there."""
    spec = world_spec(load("ur10_charging"))
    spec = replace(spec, cameras=(), stereo=spec.stereo[:1], arm=replace(spec.arm, home=q))
    with SimulatedWorld(spec, 3) as world:
        pair, frame, felt = world.stereo_cameras[0], None, []
        pair.want_pictures(True)
        while frame is None or frame.stamp < 0.8:
            world.advance(world.clock.now() + 0.02)
            while (wrench := world.wrench.read()) is not None:
                felt.append(np.concatenate([wrench.force, wrench.torque]))
            frame = pair.read() or frame
        left, second = (cv2.cvtColor(i, cv2.COLOR_RGB2GRAY) for i in (frame.left, frame.right))
        looked = Looked(q, [Picture(left, None, None, right=second)], np.mean(felt[-150:], axis=0))
        T_world_plug = world.plugged.T_world_socket @ world.plugged.T_socket_plug
        return looked, inverse(pair.T_mount_camera) @ T_world_plug


def packaged():
    """The packaged cell's setup."""
    cell = load("ur10_charging")
    post = world_spec(cell).stereo[0]
    info = StereoInfo(
        "post", "converging_pair", post.info.depth, post.info.color, post.info.T_depth_color,
        "base", post.info.T_mount_camera, 2.0, 0.06,
    )  # fmt: skip
    return PlugSetup(robot_in(cell), None, info, "type2_plug", MOUNT, lambda q: True)


def test_the_plug_in_the_cell_is_seen_as_it_hangs():
    """Rendered: its front and contacts can be seen; the pair is believed to be 4 cm off."""
    right, rng = packaged(), np.random.default_rng(0)
    joints, C = plug_views(right.believed, right.robot, right.pair.lenses, "type2_plug", 30, rng)
    q = joints[np.argmax(-C[:, 2, 2])]  # the one that faces the pair most
    looked, truth = rendered(q)
    left, second = looked.pictures[0].color, looked.pictures[0].right
    off = replace(right, pair=replace(right.pair, T_mount_camera=right.pair.T_mount_camera @ exp(
        np.array([0.03, -0.02, 0.02, 0.02, 0.02, -0.02]))))  # fmt: skip
    seen, problem = read_look(off, off.believed, looked)
    assert problem == ""
    step = log(inverse(truth) @ seen.T_ref_port)
    assert np.linalg.norm(step[:3]) < 1.5e-3
    assert np.linalg.norm(step[3:]) < np.deg2rad(3.0)
    blank = Looked(q, [Picture(np.full_like(left, 90), None, None, right=second)])
    assert read_look(off, off.believed, blank)[1].startswith("the left picture shows nothing")
    alone = Looked(q, [Picture(left, None, None)])
    assert read_look(off, off.believed, alone)[1] == "the pair sent one picture only"


def test_a_plug_that_is_seen_from_aside_is_in_the_roll_in_which_the_arm_holds_it(monkeypatch):
    """At 37 deg another roll fitted its rims as well: a third of the looks were not used."""
    right, rng = packaged(), np.random.default_rng(1)
    joints, _ = plug_views(right.believed, right.robot, right.pair.lenses, "type2_plug", 60, rng)
    looked, truth = rendered(joints[3])
    monkeypatch.setattr(plug_procedure, "locate", lambda *args: ())
    seen, problem = read_look(right, right.believed, looked)
    assert problem == ""
    step = log(inverse(truth) @ seen.T_ref_port)
    assert np.linalg.norm(step[:3]) < 1.5e-3
    assert np.linalg.norm(step[3:]) < np.deg2rad(3.0)


def test_what_is_not_known_of_a_pair_is_not_known_of_the_port():
    """By finite samples: a pair that is off by its covariance puts the port off by as much."""
    C = np.diag([1e-6, 4e-6, 1e-6, 1e-6, 2e-6, 3e-6])
    info = replace(setup().pair, covariance=C)
    T = exp(np.array([0.1, -0.2, 1.0, 0.3, 0.2, 0.1]))
    drawn = np.random.default_rng(0).multivariate_normal(np.zeros(6), C, 4000)
    steps = np.array([log(inverse(T) @ exp(twist) @ T) for twist in drawn])
    np.testing.assert_allclose(np.cov(steps.T), mounting_spread(info, T), atol=2.5e-7)
    assert not mounting_spread(setup().pair, T).any()
