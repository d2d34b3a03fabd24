"""A map that failed is replaced by a new one, which is told what the old one had been told.

Half of a round may have been done when a map raises, runs out of memory or does not return: nobody
knows what it holds. So nothing of it is kept. The new one has seen nothing: until every camera has
sent again the guard lets nothing move, and what stood there as a thing counts as a person.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from armsight.arrays import Points
from armsight.devices.data import DeclaredSolids, RgbdCameraInfo, RgbdFrame
from armsight.devices.history import JointHistory
from armsight.errors import LoopError, UsageError
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.mapping.tracked import TrackedRegion
from armsight.runtime.foreign import ForeignThread

if TYPE_CHECKING:
    from armsight.runtime.components import Maps

log = logging.getLogger(__name__)

PAUSE = 0.5
"""A map that failed is replaced after this time [s]: a new one takes 0.15 s of a core, and may fail
at its first picture as well."""


class RenewedMap:
    """Implements :class:`~armsight.runtime.components.Maps`.

    Attributes:
        make: builds a map that has seen nothing.
        patience: a round that takes longer on the wall clock is given up [s]; None waits for ever.
            It is left to its thread, with its map; Python can end neither.
    """

    def __init__(self, make: Callable[[], Maps], patience: float | None = None) -> None:
        self.make, self.patience = make, patience
        self._map: Maps | None = make()
        self._thread: ForeignThread | None = None
        self._solids: dict[str, DeclaredSolids] = {}
        self._placed: dict[str, RgbdCameraInfo] = {}
        self._excluded: dict[str, str] = {}
        self._first = 0
        self._next = 0
        self._said, self._failed = "", 0.0
        self._words = threading.Lock()

    def update(
        self,
        frames: Sequence[RgbdFrame],
        joints: JointHistory,
        now: float,
        tracked: TrackedRegion | None = None,
    ) -> WorkspaceSnapshot:
        """A round of the map; numbers of snapshots go on where one was replaced.

        Raises:
            LoopError: the map failed, and the next round has another.
        """
        if self._map is None and 0.0 <= now - self._failed < PAUSE:
            raise LoopError(self._words_of_failure)
        snapshot, fault = self._round(lambda: self._living().update(frames, joints, now, tracked))
        if snapshot is None:
            self._give_up(fault, now)
            raise LoopError(self._words_of_failure)
        if self._first:
            snapshot = replace(snapshot, sequence=self._first + snapshot.sequence)
        self._next = snapshot.sequence + 1
        return snapshot

    def _round(self, job: Callable[[], WorkspaceSnapshot]) -> tuple[WorkspaceSnapshot | None, str]:
        """What a round found; or None, and why."""
        if self.patience is not None:
            if self._thread is None:
                self._thread = ForeignThread("armsight-map", self.patience, first=1.0)
            outcome = self._thread.call(job)
            if outcome.hung:
                self._thread = None
            return outcome.value, outcome.fault
        try:
            return job(), ""
        except Exception as error:
            if (words := f"{type(error).__name__}: {error}") != self._said:
                log.exception("the map failed")  # once: it may do so at every picture
            return None, words

    def _living(self) -> Maps:
        """The map; a new one, told what the last one had been told, where that failed."""
        with self._words:
            if self._map is None:
                found = self.make()
                for info in self._placed.values():
                    found.place(info)
                for camera, reason in self._excluded.items():
                    found.exclude(camera, reason)
                for word in self._solids.values():
                    with contextlib.suppress(UsageError):  # said while there was no map
                        found.told(word)
                self._map, self._first = found, self._next
            return self._map

    @property
    def _words_of_failure(self) -> str:
        return f"the map failed ({self._said}); it begins anew"

    def _give_up(self, fault: str, now: float) -> None:
        with self._words:
            failed: Any = self._map
            self._map, self._said, self._failed = None, fault, now
        with contextlib.suppress(Exception):
            failed.close()  # its threads

    def declare_empty(self) -> None:
        """See :class:`~armsight.runtime.components.Maps`; a new map is not told: who knows."""
        with self._words:
            if self._map is not None:
                self._map.declare_empty()

    def exclude(self, camera: str, reason: str) -> None:
        """See :class:`~armsight.runtime.components.Maps`."""
        with self._words:
            self._excluded[camera] = reason
            if self._map is not None:
                self._map.exclude(camera, reason)

    def place(self, info: RgbdCameraInfo) -> None:
        """See :class:`~armsight.runtime.components.Maps`."""
        with self._words:
            if self._map is not None:
                self._map.place(info)
            self._placed[info.name] = info
            self._excluded.pop(info.name, None)

    def animate(self, points: Points) -> None:
        """See :class:`~armsight.runtime.components.Maps`; to a new map all is alive anyway."""
        with self._words:
            if self._map is not None:
                self._map.animate(points)

    def told(self, word: DeclaredSolids) -> None:
        """See :class:`~armsight.runtime.components.Maps`."""
        with self._words:
            if self._map is not None:
                self._map.told(word)
            if word.solids:
                self._solids[word.name] = word
            else:
                self._solids.pop(word.name, None)

    def close(self) -> None:
        """End the map's threads; no round may come after."""
        with self._words:
            living: Any = self._map
            self._map = None
        if living is not None and hasattr(living, "close"):
            living.close()
