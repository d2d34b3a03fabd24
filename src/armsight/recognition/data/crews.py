"""Who draws the samples: this process, several processes, or the machines of a Ray cluster.

All do the same thing, :func:`draw_batch`, and hand back what is to be written; only the process
that asked writes. So no machine needs the folder of the set, and any crew makes the same set.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from multiprocessing import get_context
from typing import Any, Protocol

from armsight.errors import DatasetError
from armsight.machine import begin_worker
from armsight.recognition.data.crops import draw_crops
from armsight.recognition.data.order import Order
from armsight.recognition.data.painter import Painter
from armsight.recognition.data.rows import Drawn
from armsight.recognition.data.sample import KNOWN_ROBOTS
from armsight.recognition.data.sampling import draw_sample

Batch = Sequence[int]

_painters: list[Painter] = []


class Crew(Protocol):
    """Draws batches of samples."""

    def draw(self, order: Order, batches: Iterable[Batch]) -> Iterator[list[Drawn]]:
        """What the batches hold, each batch whole, in any order."""

    def close(self) -> None:
        """Send everybody home; may be repeated."""


def draw_batch(order: Order, batch: Batch) -> list[Drawn]:
    """Draw samples; the process keeps its OpenGL context for the next batch."""
    manifest = order.manifest
    painter = _painter(tuple(manifest.meshes))
    size = (manifest.width, manifest.height)
    if order.recipe.views > 1:
        return _draw_scenes(order, batch, painter, size)
    return [
        draw_sample(
            painter,
            order.recipe,
            order.robot(i),
            size,
            manifest.seed,
            i,
            order.place(i),
            order.emphasis,
        )
        for i in batch
    ]


def _painter(robots: tuple[str, ...]) -> Painter:
    """The process's painter, with the meshes of the known robots and of others that are wanted."""
    wanted = tuple(dict.fromkeys((*KNOWN_ROBOTS, *robots)))
    if _painters and not set(wanted) <= set(_painters[0].robots):
        _painters.pop().close()
    if not _painters:
        _painters.append(Painter(wanted))
    return _painters[0]


def _draw_scenes(
    order: Order, batch: Batch, painter: Painter, size: tuple[int, int]
) -> list[Drawn]:
    """Samples of sets with several pictures a scene; only the first and last may be unfinished."""
    views, wanted = order.recipe.views, set(batch)
    drawn: list[Drawn] = []
    for scene in sorted({i // views for i in batch}):
        robot = order.robot(scene * views)
        drawn += draw_crops(painter, order.recipe, robot, size, order.manifest.seed, scene)
    return [d for d in drawn if d.row.index in wanted]


class Alone:
    """This process."""

    def draw(self, order: Order, batches: Iterable[Batch]) -> Iterator[list[Drawn]]:
        """One batch after the other."""
        return (draw_batch(order, batch) for batch in batches)

    def close(self) -> None:
        """Give OpenGL's memory back."""
        while _painters:
            _painters.pop().close()


class Processes:
    """Processes of this machine."""

    def __init__(self, workers: int) -> None:
        self._workers = workers
        # A forked child would share OpenGL's state with its parent.
        self._pool = ProcessPoolExecutor(
            workers, mp_context=get_context("spawn"), initializer=begin_worker
        )

    def draw(self, order: Order, batches: Iterable[Batch]) -> Iterator[list[Drawn]]:
        """A few batches ahead of what has been written, so that memory stays small.

        Raises:
            DatasetError: a process was killed, as happens when memory runs out.
        """
        pending: set[Future[list[Drawn]]] = set()
        try:
            for batch in batches:
                pending.add(self._pool.submit(draw_batch, order, batch))
                if len(pending) > 2 * self._workers:
                    done, pending = wait(pending, return_when=FIRST_COMPLETED)
                    yield from (future.result() for future in done)
            while pending:
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
        except BrokenProcessPool:
            raise DatasetError(
                "a drawing process was killed (is memory short?); finished shards are kept: run "
                "the same command again, with fewer --workers"
            ) from None

    def close(self) -> None:
        """Stop after the batches that are being drawn."""
        self._pool.shutdown(wait=True, cancel_futures=True)


class RayCluster:
    """The machines of a Ray cluster, each with armsight installed.

    Raises:
        DatasetError: Ray is not installed, or nobody answers at the address.
    """

    def __init__(self, address: str) -> None:
        try:
            ray = import_module("ray")
        except ImportError:
            raise DatasetError(
                "--ray needs Ray, which armsight does not bring: pip install 'armsight[ray]'"
            ) from None
        self._ray: Any = ray
        try:
            ray.init(address=address, log_to_driver=False, logging_level="error")
        except Exception as error:  # Ray raises anything from ValueError to grpc's errors
            first = (str(error).strip().splitlines() or [type(error).__name__])[0]
            raise DatasetError(
                f"--ray {address}: no cluster answers ({first}); start one with 'ray start --head'"
            ) from None
        self._task = ray.remote(draw_batch).options(num_cpus=1, max_retries=3)

    def draw(self, order: Order, batches: Iterable[Batch]) -> Iterator[list[Drawn]]:
        """As many batches at once as the cluster has cores, and a few more.

        Raises:
            DatasetError: a machine could not draw, or the cluster is gone.
        """
        there = self._ray.put(order)
        pending: deque[Any] = deque()
        try:
            ahead = 2 * max(int(self._ray.cluster_resources().get("CPU", 1)), 1)
            for batch in batches:
                pending.append(self._task.remote(there, batch))
                if len(pending) > ahead:
                    yield self._ray.get(self._first(pending))
            while pending:
                yield self._ray.get(self._first(pending))
        except self._ray.exceptions.RayError as error:
            first = (str(error).strip().splitlines() or [type(error).__name__])[-1]
            raise DatasetError(
                f"Ray: {first}; finished shards are kept: run the same command again"
            ) from None

    def close(self) -> None:
        """Leave the cluster."""
        if self._ray.is_initialized():
            self._ray.shutdown()

    def _first(self, pending: deque[Any]) -> Any:
        ready, _ = self._ray.wait(list(pending), num_returns=1)
        pending.remove(ready[0])
        return ready[0]
