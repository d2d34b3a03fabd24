"""Which pixels of a depth image can be used, by plain numpy."""

from __future__ import annotations

import numpy as np

from armsight.mapping.kernels.pixels import NOTHING, ROBOT, VALID, keep_valid, label_valid


def test_usable_returns_are_kept_and_nothing_else() -> None:
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.0, 5.0, (23, 31)).astype(np.float32)
    for odd in (np.nan, np.inf, -np.inf, 0.0, -1.0):
        depth[rng.random(depth.shape) < 0.05] = odd
    label = np.full(depth.shape, 9, np.uint8)
    count = label_valid(depth, 0.5, 4.0, label)
    usable = (depth >= np.float32(0.5)) & (depth <= np.float32(4.0))
    np.testing.assert_array_equal(label, np.where(usable, VALID, NOTHING))
    assert count == usable.sum() > 100
    label[:9][usable[:9]] = ROBOT
    out = np.ones_like(depth)
    keep_valid(depth, label, out)
    np.testing.assert_array_equal(out, np.where(label == VALID, depth, np.float32(np.nan)))
