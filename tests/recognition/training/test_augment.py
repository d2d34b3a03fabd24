"""Changed pictures show what their changed labels say."""

import numpy as np
import pytest

from ..torch_or_skip import torch

if torch:
    from armsight.recognition.networks.losses import Targets
    from armsight.recognition.training.augment import Augmentation, Augmenter, move

K = np.array([[69.0, 0, 47.5], [0, 69.0, 39.5], [0, 0, 1]])
WIDTH, HEIGHT = 96, 80


def spots(points: np.ndarray) -> "torch.Tensor":
    """(n, h, w, 3) pictures of one soft spot each where (n, 3) points are seen."""
    px = points @ K.T
    px = px[:, :2] / px[:, 2:]
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    d2 = (u - px[:, 0, None, None]) ** 2 + (v - px[:, 1, None, None]) ** 2
    return torch.from_numpy(np.repeat((250 * np.exp(-d2 / 8)).astype(np.uint8)[..., None], 3, -1))


def truth_of(base: np.ndarray, joint: np.ndarray, images: "torch.Tensor") -> "Targets":
    n = len(base)
    return Targets(
        images[..., 0] > 40,
        torch.from_numpy(joint[:, None].astype(np.float32)),
        torch.ones(n, 1, dtype=torch.bool),
        torch.from_numpy(base.astype(np.float32)),
        torch.zeros(n, dtype=torch.int64),
    )


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"turn_deg": 8.0},
        {"roll_deg": 25.0},
        {"zoom": 0.15},
        {"mirror": True},
        {"turn_deg": 8.0, "roll_deg": 15.0, "zoom": 0.15, "mirror": True, "colour": 0.3},
    ],
)
def test_a_spot_goes_where_its_label_goes(how: dict[str, float]) -> None:
    rng = np.random.default_rng(0)
    base = np.column_stack([rng.uniform(-0.25, 0.25, (40, 2)), rng.uniform(1.2, 2.5, 40)])
    joint = base + rng.uniform(-0.15, 0.15, base.shape)
    images = spots(joint)
    before = truth_of(base, joint, images)
    change = Augmenter(Augmentation(**how), torch.from_numpy(K), seed=3, stage=0)
    changed, truth = change(images, before, update=11)
    assert changed.shape == images.shape
    assert changed.dtype == torch.uint8
    points = truth.joints[:, 0].numpy().astype(float)
    expected = points @ K.T
    expected = expected[:, :2] / expected[:, 2:]
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    inside = ((expected > 8) & (expected < [WIDTH - 9, HEIGHT - 9])).all(axis=1)
    assert inside.sum() > 20
    for image, mask, place in zip(
        changed[inside].numpy(), truth.mask[inside].numpy(), expected[inside], strict=True
    ):
        weight = np.where(image[..., 0] > 10, image[..., 0], 0).astype(float)
        found = [(weight * u).sum() / weight.sum(), (weight * v).sum() / weight.sum()]
        np.testing.assert_allclose(found, place, atol=0.8 if how.get("zoom") else 0.35)
        np.testing.assert_allclose([u[mask].mean(), v[mask].mean()], place, atol=1.0)


def test_distances_between_points_are_kept() -> None:
    rng = np.random.default_rng(1)
    base, joint = rng.normal(size=(2, 10, 3)) + np.array([0, 0, 3.0])
    before = truth_of(base, joint, torch.zeros(10, 4, 4, 3))
    change = Augmenter(Augmentation(20, 90, 0.3, True), torch.from_numpy(K), seed=0, stage=0)
    turn, zoom, mirror = change._motion(10, torch.Generator().manual_seed(0))
    after = move(before, turn, zoom, mirror)
    first = (before.joints[:, 0] - before.base).norm(dim=1)
    second = (after.joints[:, 0] - after.base).norm(dim=1)
    torch.testing.assert_close(first, second, rtol=1e-4, atol=1e-5)


def test_the_same_update_is_changed_the_same_way() -> None:
    images = torch.randint(0, 256, (4, HEIGHT, WIDTH, 3), dtype=torch.uint8)
    truth = truth_of(np.ones((4, 3)), np.ones((4, 3)), images)
    how = Augmentation(8, 10, 0.1, True, 0.2, 0.02)
    change = [Augmenter(how, torch.from_numpy(K), s, 0) for s in (0, 0, 1)]
    change[0](images, truth, 4)
    first, again, other = (c(images, truth, 5)[0] for c in change)
    assert torch.equal(first, again)
    assert not torch.equal(first, other)
    assert not torch.equal(first, change[0](images, truth, 6)[0])


def test_no_change_is_no_change() -> None:
    images = torch.randint(0, 256, (4, HEIGHT, WIDTH, 3), dtype=torch.uint8)
    truth = truth_of(np.ones((4, 3)), np.ones((4, 3)), images)
    changed, after = Augmenter(Augmentation(), torch.from_numpy(K), 0, 0)(images, truth, 0)
    assert (changed.int() - images.int()).abs().max() <= 1
    assert torch.equal(after.base, truth.base)


def test_rooms_change_hands_and_robots_stay() -> None:
    rng = np.random.default_rng(0)
    rooms = torch.from_numpy(rng.integers(100, 250, (12, 1, 1, 3), dtype=np.uint8))
    images = rooms.expand(12, HEIGHT, WIDTH, 3).clone()
    mask = torch.zeros(12, HEIGHT, WIDTH, dtype=torch.bool)
    for k in range(12):
        mask[k, 20:30, 5 + 5 * k : 15 + 5 * k] = True
    images[mask] = torch.tensor([10, 20, 30], dtype=torch.uint8)
    truth = truth_of(np.ones((12, 3)), np.ones((12, 3)), images)
    truth = Targets(mask, truth.joints, truth.has_joint, truth.base, truth.type)
    how = Augmentation(background=1.0)
    changed, after = Augmenter(how, torch.from_numpy(K), 1, 0)(images, truth, 0)
    assert torch.equal(after.mask, mask)
    robot = (changed.int() - torch.tensor([10, 20, 30])).abs().max(dim=-1).values <= 1
    # Each robot is where it was, and no second one came with the new room.
    assert torch.equal(robot, mask)
    moved = (changed[:, 0, 0].int() - images[:, 0, 0].int()).abs().max(dim=-1).values > 1
    assert moved.sum() >= 9
