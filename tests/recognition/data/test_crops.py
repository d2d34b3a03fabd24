"""Crops of one scene: the same whoever asks for which, turned to the arm, in any paint."""

import numpy as np
import pytest

from armsight.errors import UsageError
from armsight.geometry.pose import inverse
from armsight.recognition.data.crews import draw_batch
from armsight.recognition.data.order import Order, counts_of, make_order
from armsight.recognition.data.paintwork import draw_paintwork
from armsight.recognition.data.recipe import CROPS
from armsight.recognition.data.rows import Drawn


def order() -> Order:
    return make_order("crops", {"ur5": 5, "panda": 5}, 11, (96, 96))


@pytest.fixture(scope="module")
def crops(gl: str) -> list[Drawn]:
    return draw_batch(order(), range(10))


def test_a_crop_depends_on_seed_and_index_alone(crops: list[Drawn]) -> None:
    (again,) = draw_batch(order(), [3])
    assert again.image == crops[3].image
    assert again.links == crops[3].links


def test_crops_of_a_scene_share_the_arm_but_not_the_camera(crops: list[Drawn]) -> None:
    rows = [d.row for d in crops]
    assert [r.robot for r in rows] == ["ur5"] * 5 + ["panda"] * 5
    assert [r.scene for r in rows] == [0] * 5 + [1] * 5
    assert all(np.array_equal(r.q, rows[0].q) for r in rows[:5])
    eyes = np.array([inverse(r.T_camera_base)[:3, 3] for r in rows[:5]])
    gaps = np.linalg.norm(eyes[:, None] - eyes[None], axis=2)
    assert gaps[~np.eye(5, dtype=bool)].min() > 0.05


def test_labels_are_those_of_a_straight_lens(crops: list[Drawn]) -> None:
    for row in (d.row for d in crops):
        assert not row.distortion.any()
        p = row.keypoints_camera @ row.K.T
        assert np.allclose(p[:, :2] / p[:, 2:], row.keypoints_px, atol=1e-6)
        assert row.keypoints_visible.sum() >= 5


def test_two_arms_of_five_are_white() -> None:
    styles = [draw_paintwork(CROPS, np.random.default_rng(k)).style for k in range(3000)]
    assert 0.34 < np.mean([s == "white" for s in styles]) < 0.46
    assert {"maker", "grey", "dark", "texture"} <= set(styles)


def test_counts_are_whole_scenes() -> None:
    with pytest.raises(UsageError, match="no whole number of scenes"):
        make_order("crops", {"ur5": 7}, 0, (96, 96))
    assert all(c % 5 == 0 for c in counts_of([], "40", "crops").values())
