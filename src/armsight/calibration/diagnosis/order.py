"""Other pairings of images and poses."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from armsight.calibration.diagnosis.reading import Item
from armsight.calibration.findings import Finding


def other_orders(items: list[Item]) -> list[tuple[Finding, list[Item]]]:
    """Other pairings of images and poses."""
    out = []
    views = sorted(v for v, _, _ in items)
    last = max(views)

    def pair(code: str, words: str, cure: str, to: Callable[[int], int]) -> None:
        moved = [(to(v), p, s) for v, p, s in items]
        moved = [(v, p, s) for v, p, s in moved if 0 <= v <= last]
        if len(moved) >= 4:
            out.append((Finding(code, "error", words, cure), moved))

    cure = "pair each image with the pose at its exposure; number both with leading zeros"
    for shift in (1, -1, 2, -2):
        direction = "later" if shift > 0 else "earlier"
        pair(
            "shifted",
            f"images and poses are shifted: each image fits the pose {abs(shift)} {direction}",
            cure,
            partial(int.__add__, shift),
        )
    pair("order", "the poses are in the opposite order of the images", cure, lambda v: last - v)
    by_name = sorted(range(last + 1), key=str)  # 0, 1, 10, 11, 2 ...
    back = list(np.argsort(by_name))
    pair(
        "order",
        "images are sorted as text (1, 10, 11, 2), poses as numbers",
        cure,
        lambda v: by_name[v],
    )
    pair(
        "order",
        "poses are sorted as text (1, 10, 11, 2), images as numbers",
        cure,
        lambda v: int(back[v]),
    )
    one = sorted(range(1, last + 2), key=str)
    pair(
        "order",
        "images are sorted as text (1, 10, 11, 2), poses as numbers",
        cure,
        lambda v: one[v] - 1,
    )
    back_one = list(np.argsort(one))
    pair(
        "order",
        "poses are sorted as text (1, 10, 11, 2), images as numbers",
        cure,
        lambda v: int(back_one[v]),
    )
    return out
