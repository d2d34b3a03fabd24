"""When a picture is said to show no robot: when less of it looks like one than a share.

The papers' networks know no "none". Their mask is faint where no robot is, as far as the network is
good; so a weak network needs another share than a good one. The card carries it, chosen on pictures
without and with an arm that are neither trained nor tested on (``scripts/choose_no_robot.py``).

What counts is the sum of the mask's probabilities, not of its pixels above one half: on those
pictures it told the two apart better (area under the curve 0.77 against 0.71), as a weak network
is seldom sure of a pixel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.arrays import Floats, Floats32

DEFAULT_SHARE = 0.003
"""Of a network whose card names none; the least robot of the training sets fills 0.4 %."""
LARGEST_SHARE = 0.2
"""An arm that fills more of a picture is never overlooked, whatever the card says."""


def robot_share(mask: Floats32) -> float:
    """The share of a picture that looks like a robot: the mean of (h, w) probabilities."""
    return float(mask.mean(dtype=np.float64))


def share_of(card: dict[str, Any]) -> float:
    """The share that a network's card names, else :data:`DEFAULT_SHARE`.

    Raises:
        ValueError: it names one that is no share of 0 to :data:`LARGEST_SHARE`.
    """
    if "no_robot" not in card:
        return DEFAULT_SHARE
    named = card["no_robot"]
    share = named.get("share") if isinstance(named, dict) else None
    if isinstance(share, bool) or not isinstance(share, int | float):
        raise ValueError
    if not 0.0 <= share <= LARGEST_SHARE:
        raise ValueError
    return float(share)


def choose_share(without: Floats, shown: Floats) -> float:
    """The share that tells pictures without an arm from those with one.

    The mean of two rates is as large as it can be: of pictures without an arm that are below the
    share, and of pictures with one that are not. Between two pictures the middle is taken, and of
    several equally good places the lowest, which overlooks the fewest arms.

    Args:
        without: (n,) share of each picture without an arm that looks like one, 0..1.
        shown: (m,) of each picture with one.

    Raises:
        ValueError: there is none of one kind.
    """
    if not len(without) or not len(shown):
        raise ValueError("needs pictures without and with an arm")
    seen = np.unique(np.concatenate([[0.0], without, shown]))
    cuts = np.append(0.5 * (seen[:-1] + seen[1:]), seen[-1] + 1e-6)
    cuts = np.concatenate([[0.0], np.minimum(cuts, LARGEST_SHARE)])
    empty = np.searchsorted(np.sort(without), cuts, side="left") / len(without)
    kept = 1.0 - np.searchsorted(np.sort(shown), cuts, side="left") / len(shown)
    return float(cuts[int(np.argmax(empty + kept))])
