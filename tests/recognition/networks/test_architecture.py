"""Sizes against what the papers' figures and texts say."""

import json

import pytest

from armsight.errors import RecognitionError
from armsight.recognition.networks.architecture import JOINTS, Architecture, count_layers
from armsight.robots import load_robot

URS = ("ur3", "ur5", "ur10")


def totals(architecture: Architecture) -> tuple[float, float]:
    layers = count_layers(architecture)
    return sum(x.weights for x in layers) / 1e6, sum(x.macs for x in layers) / 1e9


def test_joint_counts_are_those_of_the_robots() -> None:
    assert {name: len(load_robot(name).joint_names) for name in JOINTS} == JOINTS


def test_cascaded_at_the_papers_size() -> None:
    architecture = Architecture("cascaded", ("ur5",))
    layers = {x.name: x for x in count_layers(architecture)}
    # 128 maps of 53 x 64 into 500 units, and 21 outputs: base and six joints.
    assert layers["coordinates dense"].weights == 128 * 53 * 64 * 500 + 500
    assert layers["coordinates output"].weights == 500 * 21 + 21
    assert layers["mask output"].weights == 32 * 9 + 1
    weights, macs = totals(architecture)
    assert weights == pytest.approx(217.2, abs=0.1)
    assert macs == pytest.approx(2.19, abs=0.01)


@pytest.mark.parametrize(("pools", "weights", "macs"), [(2, 557.4, 2.42), (3, 138.0, 2.00)])
def test_multi_objective_at_the_papers_size(pools: int, weights: float, macs: float) -> None:
    assert totals(Architecture("multi-objective", URS, pools=pools)) == pytest.approx(
        (weights, macs), rel=2e-3
    )


def test_five_robots_have_seven_joints_to_answer_for() -> None:
    architecture = Architecture("multi-objective", tuple(JOINTS))
    assert architecture.joints == 7
    assert {x.name: x for x in count_layers(architecture)}["output joints"].weights == 512 * 21 + 21


def test_json_round_trip() -> None:
    a = Architecture("multi-objective", URS, 128, 106, 0.5, 0.25, 3)
    assert Architecture.from_json(json.loads(json.dumps(a.to_json()))) == a


@pytest.mark.parametrize(
    "wrong",
    [
        {"kind": "deep"},
        {"robots": []},
        {"robots": ["ur7"]},
        {"robots": ["ur5", "ur5"]},
        {"robots": "ur5"},
        {"width": 3},
        {"height": 10**9},
        {"width": 64.5},
        {"pools": 7},
        {"pools": True},
        {"filters": 0.0},
        {"dense": float("nan")},
        {"extra": 1},
    ],
)
def test_absurd_descriptions_are_refused(wrong: dict[str, object]) -> None:
    good = Architecture("multi-objective", URS).to_json()
    with pytest.raises(RecognitionError):
        Architecture.from_json({**good, **wrong})


def test_a_cascaded_network_knows_one_robot() -> None:
    with pytest.raises(RecognitionError, match="one robot"):
        Architecture("cascaded", URS)
