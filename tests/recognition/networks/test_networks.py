"""Shapes, counts and what each part of a network may and may not see."""

import numpy as np
import pytest

from armsight.recognition.networks.architecture import JOINTS, Architecture, count_layers

from ..torch_or_skip import torch

if torch:
    from armsight.recognition.networks.build import build_network
    from armsight.recognition.networks.layers import SameConv

URS = ("ur3", "ur5", "ur10")
SMALL = [
    Architecture("cascaded", ("ur5",), 64, 53, 0.5, 0.1, 2),
    Architecture("cascaded", ("iiwa",), 64, 53, 0.25, 0.1, 3),
    Architecture("multi-objective", URS, 64, 53, 0.5, 0.1, 2),
    Architecture("multi-objective", tuple(JOINTS), 64, 53, 0.25, 0.1, 3),
]


def images(count: int, a: Architecture, seed: int = 0) -> "torch.Tensor":
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.integers(0, 256, (count, a.height, a.width, 3), dtype=np.uint8))


@pytest.mark.parametrize("a", SMALL)
def test_weights_are_those_that_are_counted(a: Architecture) -> None:
    network = build_network(a)
    assert sum(p.numel() for p in network.parameters()) == sum(x.weights for x in count_layers(a))


@pytest.mark.parametrize("a", SMALL)
def test_output_shapes(a: Architecture) -> None:
    out = build_network(a)(images(3, a))
    assert out.mask.shape == (3, a.height, a.width)
    assert out.joints.shape == (3, a.joints, 3)
    assert out.base.shape == (3, 3)
    if a.kind == "multi-objective":
        assert out.type.shape == (3, len(a.robots))
    else:
        assert out.type is None


@pytest.mark.parametrize("a", SMALL)
def test_groups_hold_every_weight_once(a: Architecture) -> None:
    network = build_network(a)
    found = [id(p) for g in network.groups().values() for m in g for p in m.parameters()]
    assert sorted(found) == sorted(id(p) for p in network.parameters())


@pytest.mark.parametrize("a", SMALL)
def test_asking_for_a_part_gives_the_same_part(a: Architecture) -> None:
    network, x = build_network(a).eval(), images(2, a)
    whole = network(x)
    mask, rest = network(x, want_rest=False), network(x, want_mask=False)
    assert mask.joints is None
    assert rest.mask is None
    assert torch.equal(mask.mask, whole.mask)
    assert torch.equal(rest.joints, whole.joints)


def test_weights_start_from_the_seed() -> None:
    a = SMALL[2]
    first, again, other = (build_network(a, s).state_dict() for s in (1, 1, 2))
    assert all(torch.equal(first[k], again[k]) for k in first)
    assert not all(torch.equal(first[k], other[k]) for k in first)


@pytest.mark.parametrize(("side", "dilation"), [(3, 1), (3, 2), (3, 5), (2, 3)])
def test_dilated_convolution_against_its_definition(side: int, dilation: int) -> None:
    """Every output pixel is the sum over the filter's taps, zeros outside; size is kept."""
    torch.manual_seed(0)
    layer = SameConv(2, 3, side, dilation, linear=True)
    x = torch.randn(1, 2, 11, 13)
    weight, bias = (v.detach().numpy() for v in (layer.conv.weight, layer.conv.bias))
    image, before = x[0].numpy(), dilation * (side - 1) // 2
    expected = np.zeros((3, 11, 13))
    for row in range(11):
        for column in range(13):
            total = bias.astype(float).copy()
            for i in range(side):
                for j in range(side):
                    r, c = row + i * dilation - before, column + j * dilation - before
                    if 0 <= r < 11 and 0 <= c < 13:
                        total += weight[:, :, i, j] @ image[:, r, c]
            expected[:, row, column] = total
    np.testing.assert_allclose(layer(x)[0].detach().numpy(), expected, atol=1e-5)


def test_coordinates_of_t4_do_not_see_what_is_masked() -> None:
    a = SMALL[0]
    network = build_network(a).eval()
    mask = torch.zeros(1, a.height, a.width, dtype=torch.bool)
    mask[:, 20:40, 20:40] = True
    x, y = images(1, a, 0), images(1, a, 1)
    y[:, 20:40, 20:40] = x[:, 20:40, 20:40]
    one, other = network(x, mask), network(y, mask)
    assert torch.equal(one.joints, other.joints)
    assert torch.equal(one.base, other.base)
    assert not torch.equal(one.mask, other.mask)


def test_t4_masks_with_its_own_mask_when_none_is_given() -> None:
    a = SMALL[0]
    network, x = build_network(a).eval(), images(2, a)
    own = network(x)
    assert torch.equal(own.joints, network(x, own.mask >= 0).joints)
