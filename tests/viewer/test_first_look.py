"""Where a newcomer to the page stands: nothing hides the arm."""

import numpy as np

from armsight.geometry.pose import make_pose
from armsight.geometry.shapes import Solid
from armsight.viewer.first_look import AROUND, clearest_view, edge_on, hidden

TARGET = np.array([0.5, 0.0, 0.6])
EYES = TARGET + np.column_stack([4.0 * AROUND, np.full(len(AROUND), 1.8)])


def test_a_car_before_the_arm_is_not_looked_through():
    free = hidden(TARGET, EYES, ())
    assert not free.any()
    before = AROUND[clearest_view(np.zeros((0, 3)), free)]
    assert before[0] > 0.0  # the liked one, at the front right
    car = Solid("car", "box", (0.6, 3.2, 1.5), make_pose(None, (1.3, 0.0, 0.7)))
    blocked = hidden(TARGET, EYES, (car,))
    assert blocked[np.argmax(AROUND @ [1.0, 0.0])]
    assert not blocked[np.argmax(AROUND @ [-1.0, 0.0])]
    chosen = clearest_view(np.zeros((0, 3)), blocked)
    assert not blocked[chosen]
    assert AROUND[chosen, 1] < 0.0  # still on the liked side
    everywhere = clearest_view(np.zeros((0, 3)), np.ones(len(AROUND), bool))
    np.testing.assert_array_equal(AROUND[everywhere], before)


def test_a_port_is_not_looked_at_from_behind_or_along_its_face():
    T = make_pose([[0, 0, -1], [-1, 0, 0], [0, 1, 0]], (0.9, 0.0, 0.8))  # looks along -x
    eyes = np.array([[-2.0, 0.5, 1.5], [0.8, -4.0, 1.5], [4.0, 0.0, 1.5]])
    np.testing.assert_array_equal(edge_on(T, eyes), [False, True, True])
