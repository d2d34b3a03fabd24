"""The network that comes with armsight, on pictures that no training has seen."""

from pathlib import Path

import numpy as np
import pytest

from armsight.geometry.camera import PinholeCamera
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.any_arm.recogniser import ArmRecogniser
from armsight.recognition.data import LabelledSet
from armsight.recognition.data.generate import generate
from armsight.recognition.data.order import make_order
from armsight.recognition.inference.model import network_file
from armsight.recognition.inference.pictures import Picture


@pytest.fixture(scope="module")
def pictures(gl: str, tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    folder = tmp_path_factory.mktemp("unseen") / "set"
    counts = {"ur5": 2, "iiwa": 2, "panda": 2}
    generate(make_order("paper-rooms", counts, 977, (320, 265), 1000), folder)
    return LabelledSet.open(folder)


def test_masks_and_answers_in_rooms_that_it_has_not_seen(pictures: LabelledSet) -> None:
    recogniser = ArmRecogniser(CropModel(network_file("arms"), 1))
    overlaps = []
    for sample in pictures:
        h, w = sample.mask.shape
        K = sample.K
        lens = PinholeCamera(w, h, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        found = recogniser.recognise(Picture("unseen", sample.image), lens)
        seen = np.zeros_like(sample.mask)
        for arm in found.arms:
            seen |= arm.mask >= 0.5
            assert arm.mask.shape == sample.mask.shape
            assert arm.believed == (arm.trust >= recogniser.trust.threshold)
            if arm.believed:
                assert len(arm.joints) == len(arm.q)
        overlaps.append(float((seen & sample.mask).sum() / (seen | sample.mask).sum()))
    # What the old network reached in such rooms was 0.25; an empty mask has 0.
    assert np.mean(overlaps) > 0.35


def test_the_card_lies_beside_it_and_it_is_small() -> None:
    file = network_file("arms")
    assert file.stat().st_size < 20_000_000
    card = Path(file.with_suffix(".md")).read_text(encoding="utf-8")
    for word in ("Apache-2.0", "ImageNet", "no photograph", "no safety function"):
        assert word in card
