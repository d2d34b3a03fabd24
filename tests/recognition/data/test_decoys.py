"""Things that stand where an arm might."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.pose import make_pose
from armsight.recognition.data.decoys import draw_decoy
from armsight.recognition.data.recipe import CROPS
from armsight.recognition.data.recording import Place
from armsight.recognition.data.room import draw_room
from armsight.recognition.data.staging import draw_setting
from armsight.recognition.data.streams import Streams


@pytest.mark.parametrize("seed", range(40))
def test_a_decoy_stands_at_the_base_and_within_an_arms_reach(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T = make_pose(None, (1.0, -0.5, 0.0))
    group = draw_decoy(draw_room(CROPS, np.random.default_rng(seed)), T, rng)
    places = np.array([thing.T_world_thing[:3, 3] for thing in group])
    sizes = np.array([thing.size for thing in group])
    assert len(group) >= 2
    assert np.isfinite(places).all()
    assert (sizes > 0).all()
    assert np.linalg.norm(places[:, :2] - T[:2, 3], axis=1).max() < 2.1
    assert np.linalg.norm(places[:, :2] - T[:2, 3], axis=1).min() < 0.4
    # Nothing of it is labelled as an arm's.
    assert not any(thing.label for thing in group)


def test_the_same_seed_gives_the_same_decoy() -> None:
    room = draw_room(CROPS, np.random.default_rng(3))
    first, second = (draw_decoy(room, make_pose(), np.random.default_rng(5)) for _ in range(2))
    assert [t.size for t in first] == [t.size for t in second]
    assert all(np.array_equal(a.T_world_thing, b.T_world_thing) for a, b in zip(first, second))


@pytest.mark.parametrize("robot", ["none", "ur5"])
def test_a_decoy_changes_nothing_else_of_a_scene(robot: str) -> None:
    streams = Streams(seed=4, robot=0, scene=2, index=10, attempt=0, shared=True)
    without, beside = (
        draw_setting(replace(CROPS, decoy=share), robot, (64, 64), streams, Place(2))
        for share in (0.0, 1.0)
    )
    assert without is not None
    assert beside is not None
    assert np.array_equal(without.q, beside.q)
    assert without.words == beside.words
    assert [t.size for g in without.standing for t in g] == [
        t.size for g in beside.standing for t in g
    ]
    more = len(beside.worn) - len(without.worn)
    assert more > 0 if robot == "none" else more == 0
