"""Where exposures become pictures, beside the loop: one thread, first come, first served.

An exposure freezes the scene at once and is drawn while the loop goes on; whoever reads the frame
waits for it. What a frame shows depends on the frozen scene alone, so the results do not depend on
how fast the thread is.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from armsight.simulation.rendering import Renderer

Result = TypeVar("Result")

BACKLOG = 16
"""Exposures that may wait; then the loop waits for the oldest."""


class RenderThread:
    """Develops exposures in order.

    Attributes:
        renderer: draws them.
    """

    def __init__(self, renderer: Renderer, threaded: bool = True) -> None:
        self.renderer = renderer
        self._pool = ThreadPoolExecutor(1, "armsight-render") if threaded else None
        self._waiting: list[Future[object]] = []

    def submit(self, develop: Callable[[], Result]) -> Future[Result]:
        """Develop an exposure soon; the future holds its picture or its error."""
        if self._pool is None:
            done: Future[Result] = Future()
            try:
                done.set_result(develop())
            except Exception as problem:
                done.set_exception(problem)
            return done
        self._waiting = [f for f in self._waiting if not f.done()]
        if len(self._waiting) >= BACKLOG:
            self._waiting[0].exception()
        future = self._pool.submit(develop)
        self._waiting.append(future)  # type: ignore[arg-type]
        return future

    def finish(self) -> None:
        """Wait until nothing is left to develop."""
        for future in self._waiting:
            if not future.cancelled():
                future.exception()
        self._waiting.clear()

    def close(self) -> None:
        """Drop what waits and end the thread; may be repeated."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
        self.renderer.close()
