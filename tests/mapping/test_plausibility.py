"""Pictures that cannot be true are refused with a reason, honest ones are not; truth by numpy."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import DepthNoise, JointState
from armsight.devices.history import JointHistory
from armsight.geometry.pose import inverse, transform
from armsight.mapping import plausibility
from armsight.mapping.plausibility import ARM_DEEP, ARM_POINTS, _deep_points
from armsight.mapping.self_filter import body_fields
from armsight.mapping.snapshot import FREE
from armsight.mapping.workspace_map import WorkspaceMap

from . import scenes
from .test_map_oracle import CONFIG

NOISE = DepthNoise(0.002, 0.0, 0.0)
HOME = np.array([-0.7, 0.3])
TABLE = scenes.box("table", (0.1, 0.0, -0.05), (1.6, 1.2, 0.1))
WALL = scenes.box("wall", (-1.4, 0.3, 0.5), (0.1, 1.5, 2.0))
BACK = scenes.box("back", (-3.0, 0.0, 0.5), (0.1, 9.0, 9.0))  # nobody declares it
INFO = scenes.camera_info("a", (1.3, 0.5, 1.1), (0.0, 0.0, 0.2), (256, 212), noise=NOISE)
PERIOD = 1 / 30


def arm_at(q, now):
    history = JointHistory()
    for stamp in np.arange(now - 0.2, now + 0.02, 0.01):
        history.add(JointState(stamp, np.asarray(q, float), np.zeros(2)))
    return history


class Cell:
    """A camera before an arm, a table and a wall; pictures with noise, or lies."""

    def __init__(self, declared=(TABLE, WALL), info=INFO, noise=0.002):
        self.robot = scenes.two_link_arm()
        self.info, self.noise = info, noise
        config = replace(CONFIG, lower=(-1.3, -1.3, -0.2), upper=(1.3, 1.3, 1.4), voxel=0.04)
        self.map = WorkspaceMap(self.robot, [info], declared, config)
        self.rng = np.random.default_rng(5)
        self.count = 0

    def true(self, *things, arm=HOME, without=()):
        solids = [s for s in (TABLE, WALL, BACK) if s.name not in without]
        solids += [] if arm is None else scenes.arm_solids(self.robot, arm)
        depth = scenes.ray_cast(self.info.depth, self.info.T_mount_camera, [*solids, *things])
        return (depth + self.rng.normal(0.0, self.noise, depth.shape)).astype(np.float32)

    def tell(self, depth, q=HOME):
        self.count += 1
        stamp = self.count * PERIOD
        frame = scenes.frame(self.info, stamp, depth, self.count)
        self.snapshot = self.map.update([frame], arm_at(q, stamp), stamp + 0.001)
        return self.snapshot.cameras[0]


@pytest.fixture
def cell():
    made = Cell()
    for _ in range(4):
        assert made.tell(made.true()).reason == ""
    return made


@pytest.fixture
def settled(cell):
    """After so many pictures that its noise and its usual returns are known."""
    for _ in range(16):
        assert cell.tell(cell.true()).reason == ""
    return cell


def test_people_and_things_in_view_are_no_lie(cell):
    """Before the arm, before the wall, over half of the table: still honest."""
    for place, radius in (((0.8, 0.3, 0.6), 0.2), ((0.2, 0.0, 0.3), 0.3), ((-0.9, 0, 0.6), 0.5)):
        assert cell.tell(cell.true(scenes.sphere("person", place, radius))).reason == ""


def test_everything_far_away(cell):
    said = cell.tell(np.full_like(cell.true(), 4.0)).reason
    assert "sees through declared solids, 'table'" in said


def test_a_declared_solid_that_is_not_there_is_named():
    cell = Cell()
    said = [cell.tell(cell.true(without=("wall",))).reason for _ in range(15)][-1]
    assert "'wall'" in said


def test_the_arm_elsewhere(cell):
    """As in a picture of another minute: declared solids are all in their places."""
    said = cell.tell(cell.true(arm=(-1.2, 0.3))).reason
    assert "sees through the arm" in said
    assert "sees through the arm" in cell.tell(cell.true(arm=None)).reason


def test_an_arm_that_was_taken_for_something_else_is_forgotten(cell):
    """Joints whose readings stood still while it moved tell the truth again: the arm hides from all
    cameras what they saw of it meanwhile, in part for ever."""
    there = HOME + np.array([0.2, 0.1])
    for _ in range(3):
        cell.tell(cell.true(arm=there))
    assert len(cell.snapshot.cloud) > 50
    for _ in range(18):
        cell.tell(cell.true(arm=there), there)
    assert len(cell.snapshot.cloud) == 0


def test_the_points_at_which_the_arm_is_looked_for_are_deep_in_it_and_far_apart():
    """Each is, of a part's deep nodes, one of those farthest from all before it (Gonzalez 1985)."""
    fields = body_fields(scenes.two_link_arm())
    parts, points = _deep_points(fields)
    assert set(parts) == set(range(len(fields.offset)))
    for m, (start, shape) in enumerate(zip(fields.offset, fields.shape)):
        values = fields.values[start : start + np.prod(shape)].reshape(shape)
        nodes = np.argwhere(values <= max(-ARM_DEEP, values.min() * 2 / 3))
        own = points[parts == m]
        assert len(own) == min(ARM_POINTS // len(fields.offset), len(nodes))
        assert values[tuple(own[0].astype(int))] == values.min()
        for k in range(1, len(own)):
            away = np.linalg.norm(nodes[:, None] - own[:k], axis=2).min(axis=1)
            assert np.linalg.norm(own[k] - own[:k], axis=1).min() == pytest.approx(away.max())
            assert values[tuple(own[k].astype(int))] <= max(-ARM_DEEP, values.min() * 2 / 3)


def test_an_arm_behind_somebody_is_no_lie(cell):
    assert cell.tell(cell.true(scenes.sphere("person", (0.8, 0.3, 0.6), 0.25), arm=None)).alive


def test_mirrored(cell):
    assert "sees through" in cell.tell(cell.true()[:, ::-1].copy()).reason


def test_noise_never_repeats(settled):
    earlier = settled.true()
    assert settled.tell(earlier).reason == ""
    for _ in range(5):
        assert settled.tell(settled.true()).reason == ""
    assert "repeats an earlier picture" in settled.tell(earlier).reason


def test_pictures_without_noise_may_repeat():
    """Of a camera that never showed noise nothing can be told by that."""
    cell = Cell(noise=0.0)
    for _ in range(20):
        assert cell.tell(cell.true()).reason == ""


def test_a_lie_frees_nothing_and_honest_pictures_count_again(cell):
    ball = scenes.sphere("person", (0.5, -0.4, 0.5), 0.25)
    for _ in range(4):
        cell.tell(cell.true(ball))
    before = cell.snapshot.state
    lie = cell.true(arm=(-1.2, 0.3))  # and no ball
    for _ in range(3):
        assert cell.tell(lie).reason != ""
        assert not ((cell.snapshot.state == FREE) & (before != FREE)).any()
    assert cell.tell(cell.true(ball)).reason == ""
    assert cell.snapshot.cameras[0].alive


def test_a_covered_lens_is_said_and_believed(settled):
    half = settled.true()
    half[:, :128] = np.nan
    said = settled.tell(half)
    assert "is its lens covered" in said.reason
    assert said.alive
    assert settled.tell(settled.true()).reason == ""


def test_only_so_many_pictures_are_remembered(monkeypatch):
    """What is kept of them does not grow with time; the oldest are forgotten first."""
    monkeypatch.setattr(plausibility, "REMEMBERED", 20)
    cell = Cell()
    for _ in range(12):
        assert cell.tell(cell.true()).reason == ""
    early, late = cell.true(), cell.true()
    assert cell.tell(early).reason == ""
    for _ in range(10):
        assert cell.tell(cell.true()).reason == ""
    assert cell.tell(late).reason == ""
    for _ in range(10):
        assert cell.tell(cell.true()).reason == ""
    assert "repeats an earlier picture" in cell.tell(late).reason
    assert cell.tell(early).reason == "", "21 pictures ago"


@pytest.mark.parametrize(("share", "lies"), [(0.5, True), (0.2, False)])
def test_a_solid_that_is_not_there_has_to_be_missed_in_enough_pixels(share, lies):
    """What is seen through in few pixels only is an edge, however many of its own those are."""
    size = np.sqrt(share)
    cup = scenes.box("cup", (0.5, 0.1, 0.4), (0.02, size, size))
    cell = Cell((TABLE, WALL, cup))
    said = [cell.tell(cell.true()) for _ in range(4)][-1]
    assert ("'cup'" in said.reason) == lies
    assert said.alive != lies


def test_few_points_of_the_arm_that_are_seen_through_are_an_edge(cell):
    """Somebody stands before most of it, and what is left of the view shows the wall."""
    hidden = scenes.box("board", (0.9, 0.35, 0.6), (0.02, 0.9, 1.4))
    assert cell.tell(cell.true(hidden, arm=None)).reason == ""


def test_a_lens_that_is_covered_bit_by_bit_is_said_once_a_quarter_is_lost(settled):
    half = settled.true()
    half[:106] = np.nan
    lost = settled.tell(half).reason.partition("%")[0]
    near, far = settled.info.range
    usual, now = (((d > near) & (d < far))[6::12, 6::12].mean() for d in (settled.true(), half))
    assert float(lost) == pytest.approx(100.0 * (1.0 - now / usual), abs=3.0)
    for rows, said in ((30, False), (60, True), (120, True), (20, False)):
        part = settled.true()
        part[:rows] = np.nan
        assert ("is its lens covered" in settled.tell(part).reason) == said


def test_of_the_first_pictures_nobody_knows_how_many_returns_are_usual():
    cell = Cell()
    half = cell.true()
    half[:, :128] = np.nan
    assert cell.tell(cell.true()).reason == ""
    assert cell.tell(half).reason == ""


def test_an_arm_far_beside_the_picture_is_not_sought_in_its_middle():
    """A lens's polynomial folds back beyond what it was fitted to: 66 deg aside seems ahead."""
    bent = (-0.2, 0.0, 0.0, 0.0, 0.0)
    info = scenes.camera_info(
        "a", (0.4, 1.2, 0.35), (-1.4, 1.2, 0.35), (256, 212), (1.05, 0.87), distortion=bent
    )
    stretched = np.array([np.pi, 0.0])
    cell = Cell((), info, 0.0)
    centers = [s.T_frame_solid[:3, 3] for s in scenes.arm_solids(cell.robot, stretched)]
    pixels = info.depth.project(transform(inverse(info.T_mount_camera), np.array(centers)))
    lens = info.depth
    folded = ((pixels > 0) & (pixels < [lens.width, lens.height])).all(axis=1)
    assert folded.any(), "else this tests nothing"
    for _ in range(3):
        said = cell.tell(cell.true(arm=stretched, without=("table", "wall")), stretched)
    assert said.reason == ""
    assert said.alive
