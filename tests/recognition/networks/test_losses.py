"""Losses against the papers' equations written out in numpy."""

import numpy as np

from ..torch_or_skip import torch

if torch:
    from armsight.recognition.networks.layers import Outputs
    from armsight.recognition.networks.losses import (
        LossWeights,
        Targets,
        joints_loss,
        loss_terms,
        mask_loss,
        total_loss,
    )


def tensor(values: object) -> "torch.Tensor":
    return torch.from_numpy(np.asarray(values, np.float32))


def test_mask_loss_is_t7s_equations_1_to_4() -> None:
    rng = np.random.default_rng(0)
    logits, truth, share = rng.normal(0, 2, (4, 5, 6)), rng.random((4, 5, 6)) < 0.2, 0.17
    w_fg, w_bg = 1 / share, 1 / (1 - share)
    estimate = 1 / (1 + w_bg / w_fg * np.exp(-logits))  # the network answers the true odds
    pixels = -w_fg * truth * np.log(estimate) - w_bg * (1 - truth) * np.log(1 - estimate)
    found = mask_loss(tensor(logits), torch.from_numpy(truth), share)
    np.testing.assert_allclose(float(found), pixels.mean(), rtol=1e-5)


def test_mask_loss_is_least_at_the_true_chance() -> None:
    """Of a pixel that is robot in 30 of 100 pictures the right answer is 30 %, for any weights."""
    truth = (torch.arange(100) < 30)[:, None, None]
    odds = [float(np.log(p / (1 - p))) for p in (0.05, 0.2, 0.27, 0.3, 0.33, 0.5, 0.9)]
    for share in (0.04, 0.5):
        losses = [float(mask_loss(torch.full((100, 1, 1), s), truth, share)) for s in odds]
        assert np.argmin(losses) == 3


def test_mask_loss_weighs_both_classes_alike() -> None:
    """Equal weight in sum: an empty mask is no bargain, whatever the robot's share is."""
    truth = torch.zeros(1, 10, 10, dtype=torch.bool)
    truth[0, :1] = True
    even = float(np.log(0.1 / 0.9))  # the weighted answer is one half
    nothing, everything = (
        mask_loss(torch.full((1, 10, 10), even + s), truth, 0.1) for s in (-9.0, 9.0)
    )
    np.testing.assert_allclose(float(nothing), float(everything), rtol=1e-5)


def test_mask_loss_is_finite_and_falls_towards_the_truth() -> None:
    truth = torch.tensor([[[True, False]]])
    losses = [
        float(mask_loss(torch.tensor([[[s, -s]]]), truth, 0.5)) for s in (-200.0, -1, 0, 1, 200)
    ]
    assert np.isfinite(losses).all()
    assert losses == sorted(losses, reverse=True)
    assert losses[-1] == 0.0


def test_joints_loss_means_over_the_joints_that_a_robot_has() -> None:
    rng = np.random.default_rng(1)
    estimate, truth = rng.normal(size=(2, 3, 7, 3))
    has = np.ones((3, 7), bool)
    has[1, 6] = False
    truth[1, 6] = np.nan
    distances = np.linalg.norm(estimate - truth, axis=-1)
    expected = np.mean([distances[0].mean(), distances[1, :6].mean(), distances[2].mean()])
    guess = tensor(estimate).requires_grad_()
    found = joints_loss(guess, tensor(truth), torch.from_numpy(has))
    np.testing.assert_allclose(found.item(), expected, rtol=1e-5)
    found.backward()
    assert torch.isfinite(guess.grad).all()
    assert not guess.grad[1, 6].any()


def test_a_perfect_answer_has_a_finite_gradient() -> None:
    guess = torch.zeros(1, 2, 3, requires_grad=True)
    joints_loss(guess, torch.zeros(1, 2, 3), torch.ones(1, 2, dtype=torch.bool)).backward()
    assert torch.isfinite(guess.grad).all()


def test_the_sum_is_equation_8() -> None:
    rng = np.random.default_rng(2)
    logits = rng.normal(size=(2, 4))
    outputs = Outputs(
        tensor(rng.normal(size=(2, 3, 3))),
        tensor(rng.normal(size=(2, 6, 3))),
        tensor(rng.normal(size=(2, 3))),
        tensor(logits),
    )
    truth = Targets(
        torch.from_numpy(rng.random((2, 3, 3)) < 0.5),
        torch.zeros(2, 6, 3),
        torch.ones(2, 6, dtype=torch.bool),
        torch.zeros(2, 3),
        torch.tensor([3, 1]),
    )
    terms = loss_terms(outputs, truth, 0.3)
    softmax = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(
        float(terms["type"]), -np.log(softmax[[0, 1], [3, 1]]).mean(), rtol=1e-5
    )
    base = np.linalg.norm(outputs.base.numpy(), axis=1).mean()
    np.testing.assert_allclose(float(terms["base"]), base, rtol=1e-5)
    weights = LossWeights(1.2, 1.2, 1.2, 0.6)
    expected = 1.2 * sum(float(terms[k]) for k in ("mask", "joints", "base"))
    expected += 0.6 * float(terms["type"])
    np.testing.assert_allclose(float(total_loss(terms, weights)), expected, rtol=1e-5)
