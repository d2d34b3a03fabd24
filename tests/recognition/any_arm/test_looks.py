"""Which looks at a whole picture are taken, and what in them is an arm."""

from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest

from armsight.geometry.camera import PinholeCamera
from armsight.recognition.any_arm import presence
from armsight.recognition.any_arm import recogniser as module
from armsight.recognition.any_arm.frames import Lump
from armsight.recognition.any_arm.model import CropModel, Look
from armsight.recognition.any_arm.recogniser import ArmRecogniser
from armsight.recognition.any_arm.views import Crop
from armsight.recognition.inference.model import network_file
from armsight.recognition.inference.pictures import Picture

BOX = Lump(np.array([30.0, 30.0]), np.array([90.0, 90.0]), 40.0)


@pytest.fixture
def recogniser(monkeypatch: pytest.MonkeyPatch) -> ArmRecogniser:
    """Whatever it looks at more closely is an arm that it is sure of."""
    found = ArmRecogniser(CropModel(network_file("arms"), 1))
    seen = found.looked

    def sure(*args: object) -> tuple[Look, Crop]:
        look, crop = seen(*args)  # type: ignore[arg-type]
        links = np.zeros_like(look.surface.links)
        links[0], links[0, 10:30, 10:30] = 1.0, 0.0
        links[1] = 1.0 - links[0]
        types = dict.fromkeys(look.types, 0.0) | {"unknown": 1.0}
        return replace(look, surface=replace(look.surface, links=links), types=types), crop

    monkeypatch.setattr(found, "looked", sure)
    monkeypatch.setattr(found, "_mean_sureness", lambda *_: 2.0)
    return found


def _asked(
    recogniser: ArmRecogniser,
    monkeypatch: pytest.MonkeyPatch,
    size: tuple[int, int],
    shown_at: int,
    mass: float,
) -> tuple[list[int], bool]:
    """The looks taken at a picture whose lump only one of them shows, and whether it is an arm."""
    looks: list[int] = []

    def lumps(_: CropModel, image: np.ndarray, longest: int) -> tuple[list[Lump], np.ndarray]:
        looks.append(longest)
        return ([BOX] if longest == shown_at else []), np.zeros((4, 4), np.float32)

    monkeypatch.setattr(module, "find_lumps", lumps)
    monkeypatch.setattr(presence, "landmarks_found", lambda _: mass)
    w, h = size
    lens = PinholeCamera(w, h, 500.0, 500.0, w / 2, h / 2)
    found = recogniser.recognise(Picture("p", np.full((h, w, 3), 90, np.uint8)), lens)
    return looks, bool(found.arms)


def test_a_picture_without_an_arm_is_looked_at_once_more_and_finer(
    recogniser: ArmRecogniser, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert _asked(recogniser, monkeypatch, (640, 480), 512, 0.6) == ([256, 384, 512], True)
    assert _asked(recogniser, monkeypatch, (640, 480), 256, 0.6) == ([256], True)
    assert _asked(recogniser, monkeypatch, (320, 240), 512, 0.6) == ([256, 384], False)
    assert _asked(recogniser, monkeypatch, (200, 200), 512, 0.6) == ([256], False)


@pytest.mark.parametrize(("shown_at", "mass", "arm"), [
    (256, 0.30, False), (256, 0.36, True), (512, 0.36, False), (512, 0.5, True),
])  # fmt: skip
def test_a_thing_on_which_no_robots_landmarks_are_seen_is_no_arm(
    recogniser: ArmRecogniser,
    monkeypatch: pytest.MonkeyPatch,
    shown_at: int,
    mass: float,
    arm: bool,
) -> None:
    # A striped disc fills a crop with "arm" (0.9 in the mean), and none of the joints is found.
    assert _asked(recogniser, monkeypatch, (640, 480), shown_at, mass)[1] == arm


def test_what_may_be_an_arm_is_one_only_where_no_look_shows_a_surer_one(
    recogniser: ArmRecogniser, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "may_be_arm", lambda *_: True)
    assert _asked(recogniser, monkeypatch, (640, 480), 256, 0.3) == ([256, 384, 512], True)
    # A lamp beside an arm, or one that a coarser look shows, takes nothing from the arm.
    masses = iter([0.3, 0.6])
    other = Lump(np.array([200.0, 200.0]), np.array([300.0, 300.0]), 30.0)
    monkeypatch.setattr(presence, "landmarks_found", lambda _: next(masses))
    monkeypatch.setattr(module, "find_lumps", lambda *_: ([BOX, other], None))
    lens = PinholeCamera(640, 480, 500.0, 500.0, 320.0, 240.0)
    found = recogniser.recognise(Picture("p", np.full((480, 640, 3), 90, np.uint8)), lens)
    assert len(found.arms) == 1
    assert found.arms[0].mask[220:280, 220:280].max() > 0.5


@pytest.mark.parametrize(("first", "others", "overlap", "asked", "arm"), [
    (1.6, (0.0, 0.0, 0.0), 0.3, 0, True),  # surely one: nobody looks again
    (1.3, (1.2, 1.1, 0.9), 0.3, 3, True),
    (1.3, (1.2, 0.9, -0.7), 0.3, 3, False),  # mirrored, it is none
    (1.3, (1.2, 0.9, -0.7), 0.9, 3, True),  # an arm that is drawn there explains it
])  # fmt: skip
def test_what_is_doubtful_is_looked_at_nearer_wider_and_mirrored(
    monkeypatch: pytest.MonkeyPatch,
    first: float,
    others: tuple[float, ...],
    overlap: float,
    asked: int,
    arm: bool,
) -> None:
    found = ArmRecogniser(CropModel(network_file("arms"), 1))
    image = np.random.default_rng(3).integers(0, 255, (480, 640, 3), np.uint8)
    lens = PinholeCamera(640, 480, 500.0, 500.0, 320.0, 240.0)
    answers = cycle([first, *others])
    images: list[np.ndarray] = []
    look = found.model.look

    def seen(shown: np.ndarray) -> Look:
        images.append(shown)
        return look(shown)

    judged = found._judged
    fitted = lambda *a: (replace(judged(*a)[0], overlap=overlap), None)  # noqa: E731
    monkeypatch.setattr(found, "_judged", fitted)
    monkeypatch.setattr(found.model, "look", seen)
    monkeypatch.setattr(module, "sureness", lambda _: next(answers))
    monkeypatch.setattr(module, "is_arm", lambda *_: True)
    monkeypatch.setattr(module, "is_speck", lambda *_: False)  # noise has hardly a mask
    monkeypatch.setattr(module, "find_lumps", lambda *_: ([BOX], None))
    assert bool(found.recognise(Picture("p", image), lens).arms) == arm
    assert len(images) in (asked, 3 * asked)  # a rejected lump is asked about in each look
    if asked:
        crop = found.looked(image, lens, BOX.low, BOX.high)[1]
        np.testing.assert_array_equal(images[2], crop.image[:, ::-1])
