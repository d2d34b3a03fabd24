"""The parts of a body that are its cable: where they lie, how thick and how fast they are."""

from itertools import pairwise

import numpy as np

from armsight.mapping.self_filter import ASTRAY, BAND, CELL, SelfFilter
from armsight.robots.cable import PIECES, SwingingCable

from .test_cable import ARM, CABLE, joints_at, root_at


def swung(pictures=12):
    """A filter whose cable swings, its body, and a chain that was led alike."""
    filter_, chain = SelfFilter(ARM), SwingingCable(CABLE)
    for k in range(pictures):
        stamp = 0.066 * (k + 1)
        body = filter_.pose(joints_at(stamp), np.zeros(2), stamp=stamp)
        chain.follow(root_at(stamp), stamp)
    return filter_, body, chain


def away_from(chain, points):
    """(n,) distance of points from the line of a chain [m]."""
    first, along = chain.place[:-1], np.diff(chain.place, axis=0)
    share = np.einsum("nkj,kj->nk", points[:, None] - first, along) / (along**2).sum(axis=1)
    foot = first + np.clip(share, 0.0, 1.0)[:, :, None] * along
    return np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1)


def test_every_box_ends_where_its_field_does():
    filter_, body, _ = swung()
    _, _, shape = filter_._labelled
    assert len(shape) == len(filter_.fields.offset) + PIECES
    ends = np.concatenate([body.corners, np.ones((len(shape), 8, 1))], axis=2)
    in_cells = (ends @ np.swapaxes(body.T_cells_base, 1, 2))[:, :, :3]
    np.testing.assert_allclose(in_cells.min(axis=1), 0.0, atol=1e-6)
    np.testing.assert_allclose(in_cells.max(axis=1), shape - 1, atol=1e-6)


def test_fields_of_a_cable_tell_how_far_it_is_and_what_is_seen_may_be_farther():
    """Against the chain's line, piece by piece; to half a cell's diagonal."""
    filter_, body, chain = swung()
    arm, rng = len(filter_.fields.offset), np.random.default_rng(0)
    points = chain.place[rng.integers(0, PIECES + 1, 800)] + rng.uniform(-0.08, 0.08, (800, 3))
    truth = away_from(chain, points) - CABLE.radius
    known = truth < BAND - CELL
    for fields, wider in ((filter_._labelled, ASTRAY), (filter_._marked, 0.0)):
        values, offset, shape = fields
        found = np.full(len(points), np.inf)
        for m in range(arm, arm + PIECES):
            T = body.T_cells_base[m]
            node = np.round(points @ T[:3, :3].T + T[:3, 3]).astype(int)
            inside = ((node >= 0) & (node < shape[m])).all(axis=1)
            flat = np.ravel_multi_index(tuple(node[inside].T), shape[m])
            found[inside] = np.minimum(found[inside], values[offset[m] + flat])
        off = np.abs(found - (truth - wider))[known]
        assert off.max() < 0.5 * np.sqrt(3.0) * CELL + 0.003, wider
        assert known.sum() > 200


def test_a_piece_is_as_fast_as_its_faster_end():
    filter_, body, chain = swung()
    ends = np.linalg.norm(chain.velocity, axis=1)
    assert ends.max() > 0.1
    own = body.speed[len(filter_.fields.offset) :]
    np.testing.assert_allclose(own, [max(pair) for pair in pairwise(ends)])
