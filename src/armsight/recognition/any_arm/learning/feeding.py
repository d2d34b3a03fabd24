"""Batches for a training, one after the other, made ahead by other processes where there are any.

A GPU learns from thousands of crops a second, and a core changes some hundreds: threads of one
process wait for each other there. Each batch follows from the plan and its number alone, so the
same ones come in the same order however many make them.
"""

from __future__ import annotations

import signal
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from armsight.arrays import Ints
from armsight.errors import RecognitionError
from armsight.recognition.any_arm.learning.changes import Batch, Changes, make_batch
from armsight.recognition.any_arm.learning.examples import Examples
from armsight.recognition.any_arm.learning.losses import Truth
from armsight.recognition.any_arm.learning.plan import Plan
from armsight.recognition.training.batches import Batches

_AHEAD = 3
"""Batches that each process may be ahead."""


class Fed(NamedTuple):
    """A batch as tensors; see :class:`armsight...changes.Batch`. A tuple, so that it is pinned."""

    images: Tensor
    links: Tensor
    coordinates: Tensor
    known: Tensor
    points: Tensor
    type: Tensor

    @classmethod
    def of(cls, batch: Batch) -> Fed:
        """The same arrays, not copied."""
        return cls(*(torch.from_numpy(getattr(batch, name)) for name in cls._fields))

    def on(self, device: torch.device) -> tuple[Tensor, Truth]:
        """Images and targets on a device."""
        images, *truth = (part.to(device, non_blocking=True) for part in self)
        return images, Truth(*truth)


def feed(
    data: Examples, learned: Ints, plan: Plan, update: int, workers: int, pinned: bool
) -> Iterable[Fed]:
    """The batches from an update to the plan's end.

    Args:
        data: crops.
        learned: (n,) which of them are learned from.
        plan: of the training.
        update: of the first batch.
        workers: processes that make batches ahead; 0 makes them in between.
        pinned: where a GPU fetches them from by itself.
    """
    loader: DataLoader[Fed] = DataLoader(
        _Updates(data, learned, plan),
        batch_size=None,
        sampler=range(update, max(plan.updates, update)),
        num_workers=workers,
        prefetch_factor=_AHEAD if workers else None,
        worker_init_fn=_alone,
        pin_memory=pinned,
        # Forked, they share the crops; none of them touches the GPU.
        multiprocessing_context="fork" if workers else None,
    )
    return loader


@contextmanager
def killed_in_words() -> Iterator[None]:
    """While processes make batches: torch says of one that is gone wherever the main thread is.

    Raises:
        RecognitionError: one of them was killed, as happens when memory runs out.
    """
    try:
        yield
    except RuntimeError as error:
        if "DataLoader worker" not in str(error):
            raise
        raise RecognitionError(
            "a process that makes batches was killed (is memory short?); run the same command "
            "again, it goes on from its last checkpoint"
        ) from None


class _Updates(Dataset[Fed]):
    """The batch of each update."""

    def __init__(self, data: Examples, learned: Ints, plan: Plan) -> None:
        self._data, self._learned, self._plan = data, learned, plan
        self._how = Changes(size=plan.size)
        self._batches = Batches(len(learned), plan.batch, plan.seed, 0)

    def __getitem__(self, update: int) -> Fed:
        size, seed = self._plan.batch, self._plan.seed
        numbers = np.arange(update * size, (update + 1) * size)
        chosen = self._learned[self._batches[update]]
        return Fed.of(make_batch(self._data, chosen, numbers, seed, self._how))


def _alone(worker: int) -> None:
    """One of many uses one core, and leaves Ctrl-C to the parent, which sends everybody home."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(0)
