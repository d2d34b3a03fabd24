"""Robots that a network learns later: fitted rows, their file, and that nothing else changes."""

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from tests.recognition.data.test_own_robot import own_arm

from armsight.errors import RecognitionError, RobotError, UsageError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy
from armsight.recognition.any_arm import recogniser
from armsight.recognition.any_arm.best_outline import Outlined
from armsight.recognition.any_arm.drawing import draw
from armsight.recognition.any_arm.extension import (
    Extension,
    Rows,
    apply,
    joints_of,
    mark_of,
    read_extension,
    shuffled,
    write_extension,
)
from armsight.recognition.any_arm.heat import read_heat
from armsight.recognition.any_arm.landmarks import SLOTS, find_landmarks
from armsight.recognition.any_arm.learning import extend as extending
from armsight.recognition.any_arm.learning import rows as fitting
from armsight.recognition.any_arm.learning.examples import UNSEEN, Examples
from armsight.recognition.any_arm.learning.extend import Wish, extend
from armsight.recognition.any_arm.learning.rows import Shots, fit_rows
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.any_arm.recogniser import ArmRecogniser
from armsight.recognition.any_arm.solver import Fit
from armsight.recognition.any_arm.trust import FEATURES, GAP
from armsight.recognition.data.crews import Batch
from armsight.recognition.data.generate import generate
from armsight.recognition.data.order import Order, make_order
from armsight.recognition.data.rows import Drawn, Row
from armsight.recognition.inference.pictures import Picture
from armsight.robots.catalogue import load_robot
from armsight.robots.robot import Robot

from .test_bad_input import lamp
from .test_model import bright_card, bright_network

pytestmark = pytest.mark.usefixtures("without_landmarks")

SIDE = 8
"""Places of the features, each way."""


def _shots(count: int) -> tuple[Shots, np.ndarray]:
    """Features that show where landmark 0 and 1 are, and a hidden number that shows the robot."""
    rng = np.random.default_rng(0)
    points = np.full((count, SLOTS, 2), np.nan, np.float32)
    points[:, :2] = rng.uniform(1.0, 2 * SIDE - 2.0, (count, 2, 2))
    points[: count // 4, 1] = -5.0  # beyond the edge
    at = np.arange(SIDE) * 2 + 0.5
    y, x = np.meshgrid(at, at, indexing="ij")
    features = np.zeros((count, 8, SIDE, SIDE), np.float32)
    for k in range(2):
        dx, dy = x - points[:, k, 0, None, None], y - points[:, k, 1, None, None]
        features[:, 4 * k] = np.exp(-0.25 * (dx**2 + dy**2))
        features[:, 4 * k + 1] = features[:, 4 * k] * dx
        features[:, 4 * k + 2] = features[:, 4 * k] * dy
    hidden = rng.normal(0.0, 0.3, (count, 5)).astype(np.float32)
    hidden[:, 0] += 2.0
    hidden[:, 1] = points[:, 1, 0] < 0
    cells = (count, 2 * SIDE, 2 * SIDE)
    links = np.zeros((count, 10, *cells[1:]), np.float32)
    links[:, 0, :, :6], links[:, 3, :, 6:] = 1.0, 1.0
    features[:, 7] = np.arange(SIDE) >= 3
    coordinates = np.broadcast_to(0.5 * features[:, 7].repeat(2, 1).repeat(2, 2)[:, None],
                                  (count, 3, *cells[1:])).astype(np.float32)  # fmt: skip
    shots = Shots(
        features.astype(np.float16), hidden, links, coordinates, np.ones(cells, np.float32), points
    )
    others = rng.normal(0.0, 0.3, (40, 5)).astype(np.float32)
    return shots, others


def test_rows_find_what_the_features_show() -> None:
    shots, others = _shots(96)
    held = slice(80, 96)
    learned = Shots(**{k: v[:80] for k, v in vars(shots).items()})
    fitted = fit_rows(learned, others[:30], np.full(110, 1.5, np.float32), 200, 0)
    away = []
    for features, hidden, points in zip(
        shots.features[held], shots.hidden[held], shots.points[held], strict=True
    ):
        seen = apply(fitted, features.astype(np.float32), hidden)
        places = read_heat(seen.heat, seen.outside)
        away.append(np.linalg.norm(places.mean[:2] - points[:2], axis=1))
        assert seen.type > 1.5
        np.testing.assert_array_equal(seen.surface[:10].argmax(0)[:, 8:], 3)
        np.testing.assert_allclose(seen.surface[10:13, :, 8:], 0.5, atol=0.1)
    # Of 16 cells; by chance it would be 8.
    assert np.median(away) < 1.0
    gone = apply(fitted, shots.features[0].astype(np.float32), shots.hidden[0])
    assert read_heat(gone.heat, gone.outside).mass[1] < 0.5
    for hidden in others[30:]:
        assert apply(fitted, shots.features[0].astype(np.float32), hidden).type < 1.5


def test_gradients_are_those_of_the_terms() -> None:
    rng = np.random.default_rng(1)
    points = np.array([[[1.2, 2.4], [np.nan, np.nan], [-3.0, 1.0]]], np.float32)
    heat, outside = rng.normal(size=(1, 3, 4, 4)), rng.normal(size=(1, 3))

    def cross_entropy(flat: np.ndarray) -> float:
        h, o = flat[:48].reshape(3, 16), flat[48:]
        every = np.concatenate([h, o[:, None]], 1)
        logp = every - np.log(np.exp(every).sum(1, keepdims=True))
        y, x = np.divmod(np.arange(16), 4)
        t = np.exp(-0.5 * ((x - 1.2) ** 2 + (y - 2.4) ** 2) / fitting.SPOT**2)
        return float(-(t / t.sum() * logp[0, :16]).sum() - logp[2, 16]) / 2

    by_heat, by_outside = fitting._heat(heat, outside, points)
    numeric = approx_fprime(np.r_[heat.ravel(), outside.ravel()], cross_entropy, 1e-6)
    np.testing.assert_allclose(np.r_[by_heat.ravel(), by_outside.ravel()], numeric, atol=2e-5)

    shots, _ = _shots(4)
    seen = rng.normal(0.0, 0.5, (1, 14, 16, 16))
    truth, place = shots.links[:1], shots.coordinates[:1]

    def surface(flat: np.ndarray) -> float:
        s = flat.reshape(14, 16, 16)
        logp = s[:10] - np.log(np.exp(s[:10]).sum(0))
        far = np.abs(s[10:13] - place[0]).sum(0)
        return float(-(truth[0] * logp).sum(0).mean() + (far * np.exp(-s[13]) + 3 * s[13]).mean())

    gradient = fitting._surface(seen, shots, np.array([0]))
    some = rng.choice(seen.size, 60, replace=False)
    for i in some:
        step = np.zeros(seen.size)
        step[i] = 1e-5
        slope = (surface(seen.ravel() + step) - surface(seen.ravel() - step)) / 2e-5
        assert gradient.ravel()[i] == pytest.approx(slope, abs=2e-6)


def test_four_rows_are_the_four_cells_of_a_place() -> None:
    maps = np.arange(8 * 3 * 2, dtype=np.float32).reshape(8, 3, 2)
    found = shuffled(maps)
    for k, r, c in np.ndindex(2, 6, 4):
        assert found[k, r, c] == maps[4 * k + 2 * (r % 2) + c % 2, r // 2, c // 2]
    flat = np.concatenate([maps.reshape(8, -1), maps.reshape(8, -1) + 100], 1)
    both = fitting._cells(flat, (2, 3, 2))
    np.testing.assert_array_equal(both[0], found)
    np.testing.assert_array_equal(fitting._places(both), flat)


@pytest.fixture
def network(tmp_path: Path) -> Path:
    file = tmp_path / "crops.onnx"
    file.write_bytes(bright_network(bright_card()))
    return file


def _extension(network: Path, kind: float) -> Extension:
    """A robot that is claimed where the picture is bright."""
    rng = np.random.default_rng(2)
    rows = Rows(
        rng.normal(size=(4 * SLOTS, 4)).astype(np.float32),
        rng.normal(size=(56, 4)).astype(np.float32),
        rng.normal(size=(SLOTS, 4)).astype(np.float32),
        np.array([kind, 0.0, 0.0, 0.0], np.float32),
    )
    marks = find_landmarks(load_robot("iiwa"))
    return Extension("iiwa", mark_of(network.read_bytes()), marks, rows, {"samples": 1})


KINDS = {"ur5": (3.0, 0.0, 0.0), "none": (0.0, 3.0, 0.0), "unknown": (0.0, 0.0, 3.0)}
"""What the network without extensions says of every picture."""


@pytest.mark.parametrize("said", KINDS)
@pytest.mark.parametrize("claimed", [False, True])
def test_an_extension_speaks_for_unknown_arms_alone(
    tmp_path: Path, said: str, claimed: bool
) -> None:
    network = tmp_path / "crops.onnx"
    network.write_bytes(bright_network(bright_card(), kind=np.array([KINDS[said]], np.float32)))
    write_extension(tmp_path / "e.safetensors", _extension(network, 0.1))
    extension = read_extension(tmp_path / "e.safetensors")
    plain, more = CropModel(network, 1), CropModel(network, 1, [extension])
    assert more.robots == ("ur5", "iiwa")
    rng = np.random.default_rng(3)
    picture = rng.integers(0, 256 if claimed else 20, (64, 96, 3), dtype=np.uint8)
    old, new = plain.look(picture), more.look(picture)
    for name in ("links", "coordinates", "spread"):
        np.testing.assert_array_equal(
            getattr(old.surface, name), getattr(new.surface_of("ur5"), name)
        )
    for name in ("mean", "covariance", "mass"):
        np.testing.assert_array_equal(
            getattr(old.places["ur5"], name), getattr(new.places["ur5"], name)
        )
    assert new.surface_of("iiwa").links.shape == old.surface.links.shape
    assert sum(new.types.values()) == pytest.approx(1.0)
    if claimed and said == "unknown":
        assert old.stranger
        assert not new.stranger
        assert new.types["iiwa"] > new.types["unknown"]
        assert new.types["ur5"] == old.types["ur5"]
    else:
        assert new.types == old.types | {"iiwa": 0.0}
    assert new.alike == (("iiwa",) if claimed and said == "ur5" else ())


def test_a_new_robot_that_looks_like_an_old_one_is_named_and_changes_nothing(
    network: Path,
) -> None:
    """The pose of the network alone, and a tie; whoever knows better may say so."""
    extension = _extension(network, 0.1)
    plain, more = CropModel(network, 1), CropModel(network, 1, [extension])
    picture = Picture("lamp", lamp())
    [old] = ArmRecogniser(plain).recognise(picture).arms
    found = ArmRecogniser(more).recognise(picture)
    [new] = found.arms
    assert new.robot == old.robot == "ur5"
    for name in ("mask", "T_camera_base", "q", "joints", "covariance"):
        np.testing.assert_array_equal(getattr(new, name), getattr(old, name))
    assert new.alike == ("iiwa",)
    assert any("may as well be of the type iiwa" in note for note in found.notes)
    assert '"may_as_well_be": ["iiwa"]' in found.as_line()
    [told] = ArmRecogniser(more, ["iiwa"]).recognise(picture).arms
    assert told.robot == "iiwa"
    assert told.alike == ()
    with pytest.raises(RecognitionError, match="does not know iiwa, only ur5"):
        ArmRecogniser(plain, ["iiwa"])


RED, MAGENTA, GREY = (230, 40, 40), (200, 0, 200), (150, 150, 150)


def _drawn(image: np.ndarray) -> set[tuple[int, ...]]:
    return {tuple(map(int, color)) for color in np.unique(image.reshape(-1, 3), axis=0)}


@pytest.mark.parametrize("threshold", [0.85, 0.3])
def test_a_tied_type_is_not_believed_unless_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, threshold: float
) -> None:
    """Neither where it is said nor where it is drawn, however well the pose fits."""

    def placed(robot: Robot, *_: object) -> list[Fit]:
        T = from_rpy((1.5, 0.0, 0.0), (0.0, 0.3, 2.0))
        return [Fit(robot, T, robot.home, 0.0, 1e6 * np.eye(6 + robot.n))]

    monkeypatch.setattr(recogniser, "solve", placed)
    monkeypatch.setattr(recogniser, "best_outlined", lambda fits, *_: Outlined(fits[0], 0.9, GAP))
    weights = [20.0, *[0.0] * (len(FEATURES) - 1)]  # sure of everything
    card = bright_card() | {"trust": {"weights": weights, "threshold": threshold, "widen": 1.0}}
    network = tmp_path / "crops.onnx"
    network.write_bytes(bright_network(card))
    more = CropModel(network, 1, [_extension(network, 0.1)])
    picture = Picture("lamp", lamp())
    camera = PinholeCamera(160, 120, 125.0, 125.0, 79.5, 59.5)
    plain = ArmRecogniser(CropModel(network, 1)).recognise(picture, camera)
    assert plain.arms[0].believed
    assert plain.arms[0].trust > 0.99
    assert {RED, MAGENTA} <= _drawn(draw(picture.image, plain))

    tied = ArmRecogniser(more).recognise(picture, camera)
    [said] = json.loads(tied.as_line())["arms"]
    assert (said["robot"], said["may_as_well_be"]) == ("ur5", ["iiwa"])
    assert said["believed"] is False
    assert said["trust"] <= 0.5
    assert "iiwa" in said["problem"]
    colors = _drawn(draw(picture.image, tied))
    assert GREY in colors
    assert not {RED, MAGENTA} & colors

    [both] = ArmRecogniser(more, ["ur5", "iiwa"]).recognise(picture, camera).arms
    assert (both.believed, both.alike) == (False, ("iiwa",))
    [told] = ArmRecogniser(more, ["ur5"]).recognise(picture, camera).arms
    assert (told.robot, told.believed, told.alike) == ("ur5", True, ())


class _Long:
    """Landmarks of a number that no float holds."""

    def to_json(self) -> dict[str, object]:
        entry = find_landmarks(load_robot("iiwa")).to_json()
        return entry | {"point": [[10**400] * 3 for _ in entry["point"]]}


@pytest.mark.parametrize(
    "damage", ["other network", "twice", "cut", "foreign", "shape", "infinite", "long"]
)
def test_an_extension_that_does_not_fit_is_refused(
    network: Path, tmp_path: Path, damage: str
) -> None:
    extension, file = _extension(network, 0.1), tmp_path / "e.safetensors"
    if damage == "other network":
        extension = replace(extension, network="0" * 64)
    elif damage == "twice":
        extension = replace(extension, robot="ur5")
    elif damage == "shape":
        extension = replace(extension, rows=replace(extension.rows, type=np.zeros(9, np.float32)))
    elif damage == "infinite":
        bad = np.full((SLOTS, 4), np.inf, np.float32)
        extension = replace(extension, rows=replace(extension.rows, outside=bad))
    elif damage == "long":
        extension = replace(extension, landmarks=_Long())  # type: ignore[arg-type]
    write_extension(file, extension)
    if damage == "cut":
        file.write_bytes(file.read_bytes()[:-9])
    elif damage == "foreign":
        file.write_bytes(network.read_bytes())
    with pytest.raises(RecognitionError) as caught:
        CropModel(network, 1, [read_extension(file)])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("was", "now", "says"),
    [
        ('name="j1"', 'name="elbow"', "joint 2 is called elbow, not j1"),
        ('<axis xyz="0 0 1"/><limit lower="-2"', '<axis xyz="0 0 1"/><limit lower="-1.5"',
         "j0 turns from -1.5 to 2 rad, not -2 to 2"),
        ('<origin xyz="0 0 0.3"/>', '<origin xyz="0 0 0.31"/>', "j1 has another place"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 -1"/>', "j0 has another place or axis"),
        ('name="j2" type="revolute"', 'name="j2" type="fixed"', "2 joints, not 3"),
        ('effort="9"', 'effort="8"', ""),
    ],
)  # fmt: skip
def test_an_extension_whose_robot_has_changed_since_is_refused(
    network: Path, tmp_path: Path, was: str, now: str, says: str
) -> None:
    """By what its URDF says of its joints: rows of one arm would be solved with another."""
    urdf, file = own_arm(tmp_path), tmp_path / "e.safetensors"
    robot = load_robot(str(urdf))
    learned = replace(
        _extension(network, 0.1), robot=str(urdf), landmarks=find_landmarks(robot),
        joints=joints_of(robot),
    )  # fmt: skip
    write_extension(file, learned)
    assert str(urdf) in CropModel(network, 1, [read_extension(file)]).robots
    text = urdf.read_text()
    assert was in text
    urdf.write_text(text.replace(was, now))
    if not says:
        assert CropModel(network, 1, [read_extension(file)])
        return
    with pytest.raises(RecognitionError, match=re.escape(says)) as caught:
        CropModel(network, 1, [read_extension(file)])
    assert str(urdf) in str(caught.value)
    assert "armsight extend" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_extension_of_before_joints_were_kept_is_read(network: Path, tmp_path: Path) -> None:
    """Only the number of its links can be compared then."""
    urdf, file = own_arm(tmp_path), tmp_path / "e.safetensors"
    marks = find_landmarks(load_robot(str(urdf)))
    old = replace(_extension(network, 0.1), robot=str(urdf), landmarks=marks)
    write_extension(file, old)
    assert read_extension(file).joints is None
    assert CropModel(network, 1, [read_extension(file)])
    urdf.write_text(urdf.read_text().replace('name="j2" type="revolute"', 'name="j2" type="fixed"'))
    with pytest.raises(RecognitionError, match="no more the robot"):
        CropModel(network, 1, [read_extension(file)])
    urdf.unlink()
    with pytest.raises(RobotError, match=r"my arm\.urdf"):
        CropModel(network, 1, [read_extension(file)])


class _Stub:
    """Draws nothing, for so many samples; remembers of which it was asked."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.drawn: list[int] = []

    def draw(self, order: Order, batches: Iterable[Batch]) -> Iterator[list[Drawn]]:
        for batch in batches:
            if len(self.drawn) >= self.most:
                raise KeyboardInterrupt
            self.drawn += batch
            yield [Drawn(_row(order, i), b"jpeg", b"png") for i in batch]

    def close(self) -> None:
        pass


def _row(order: Order, i: int) -> Row:
    some = np.zeros((2, 3))
    names = f"images/{i:06d}.jpg", f"links/{i:06d}.png"
    return Row(
        i, order.manifest.seed, i // 5, order.robot(i), *names, 160, 160, np.eye(3), np.zeros(5),
        np.eye(4), np.zeros(2), some, some, some[:, :2], np.zeros(2, bool),
    )  # fmt: skip


@pytest.mark.parametrize("begun", [None, 1000])
def test_a_stopped_rendering_loses_one_shard_at_most(
    network: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, begun: int | None
) -> None:
    """Also one that was begun when a shard held a thousand crops is gone on with, as it is."""

    def packed(*_: object) -> int:
        raise RecognitionError("rendered")

    monkeypatch.setattr(extending, "pack_shards", packed)
    wish = Wish("iiwa", network, tmp_path / "out", 300)
    if begun is not None:
        counts = {"iiwa": 300, "ur5": 100, "none": 100, "unknown": 100}
        order = make_order("crops", counts, 0, (160, 160), begun)
        with pytest.raises(KeyboardInterrupt):
            generate(order, tmp_path / "out/crops", _Stub(0))
    first, second = _Stub(240), _Stub(1000)
    with pytest.raises(KeyboardInterrupt):
        extend(wish, first, lambda words: None)
    assert len(first.drawn) == 240
    with pytest.raises(RecognitionError, match="rendered"):
        extend(wish, second, lambda words: None)
    assert second.drawn == list(range(200 if begun is None else 0, 600))


def test_figures_of_rooms_that_are_not_there_are_written_as_unknown(
    tmp_path: Path, network: Path
) -> None:
    """With --samples 60 no room of the robot's own is held back: numbers of rooms decide it."""
    n = 20
    rng = np.random.default_rng(0)
    data = Examples(
        ("iiwa", "ur5"), rng.integers(0, 256, (n, 160, 160, 3), dtype=np.uint8),
        np.zeros((n, 160, 160), np.uint8), np.full((n, 80, 80, 3), UNSEEN, np.int8),
        np.full((n, SLOTS, 2), np.nan, np.float32), np.arange(n) % 2, np.arange(n) // 5,
    )  # fmt: skip
    extension, file = _extension(network, 0.1), tmp_path / "e.safetensors"
    for held in (np.array([1, 3]), np.array([0, 2]), np.empty(0, np.int64)):
        card = extending._measured(CropModel(network, 1), data, held, extension)
        assert (card["recognised"] is None) == (not (held % 2 == 0).any())
        assert (card["others_claimed"] is None) == (not (held % 2 == 1).any())
        write_extension(file, replace(extension, card=card))
        assert read_extension(file).card == card


def test_what_cannot_be_added_is_said_before_anything_is_drawn(
    network: Path, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match="--samples 3"):
        extend(Wish("iiwa", network, tmp_path / "out", 3), None, print)
    with pytest.raises(RecognitionError, match="knows ur5 already"):
        extend(Wish("ur5", network, tmp_path / "out"), None, print)
    assert not (tmp_path / "out").exists()
