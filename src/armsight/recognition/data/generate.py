"""Renders a set of labelled pictures with MuJoCo."""

from __future__ import annotations

from pathlib import Path

from armsight.recognition.data.crews import Alone, Crew
from armsight.recognition.data.order import Order
from armsight.recognition.data.shards import Progress, fill


def generate(
    order: Order, folder: Path, crew: Crew | None = None, progress: Progress | None = None
) -> int:
    """Make what is missing of a set and return how many samples were drawn.

    Args:
        order: the set.
        folder: where it lies.
        crew: who draws; this process if absent.
        progress: hears how far it is.

    Raises:
        DatasetError: the folder holds another set, is being written by somebody else, or the disk
            is full.
    """
    crew = crew or Alone()
    return fill(order.manifest, folder, lambda batches: crew.draw(order, batches), progress)
