"""How well a fitted arm agrees with what the network says of every cell: which link, or none.

An outline says where the arm ends; which link is where tells two poses with one outline apart.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats32, Mask
from armsight.recognition.any_arm.outline import within
from armsight.recognition.any_arm.solver import Fit
from armsight.recognition.any_arm.views import SIDE, Crop
from armsight.recognition.own_arm.surface import Rendered, arm_surface, render

ARM = 0.5
LEAST = 0.01
"""Probability that a cell's truth has at least: the network is wrong now and then."""


def links_surprise(fit: Fit, links: Floats32, crop: Crop) -> float:
    """Mean of the negative log of how likely the network finds what is drawn.

    Over the cells that are arm for either; beyond the picture nobody knows.

    Args:
        fit: an arm, which is drawn.
        links: (1 + l, h, h) probability of background, link 0, link 1 ... by cells.
        crop: that they are of.
    """
    surface, side = arm_surface(fit.robot), links.shape[1]
    f, middle = crop.f * side / SIDE, 0.5 * (side - 1)
    lens = np.array([f, f, middle, middle, 0, 0, 0, 0, 0.0])
    drawn = render(surface, surface.posed(fit.q), fit.T_camera_base, lens, (side, side))
    return surprise_at(drawn, links, within(crop, side))


def surprise_at(drawn: Rendered, links: Floats32, inside: Mask) -> float:
    """The same of an arm that is drawn already.

    Args:
        drawn: at the size of the cells.
        links: (1 + l, h, h) probability of background, link 0, link 1 ... by cells.
        inside: (h, h) cells within the picture.
    """
    link = np.zeros(inside.shape, np.int64)
    link[drawn.at[:, 0], drawn.at[:, 1]] = drawn.owner + 1
    either = ((link > 0) | (links[0] < 1.0 - ARM)) & inside
    if not either.any():
        return float(-np.log(LEAST))
    said = np.take_along_axis(links, link[None], 0)[0][either]
    return float(-np.log(np.clip(said, LEAST, 1.0)).mean())
