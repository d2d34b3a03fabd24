"""Records a running session as MCAP with ROS 2 types: an observer that never holds the loop up.

The loop's thread only hands over immutable values; a thread of the recorder's own encodes,
compresses and writes. Every frame and joint reading that sensing takes in is recorded once, with
its exposure as the stamp and its coming into the session as the log time, so that a replay feeds
the map at the same moments.
"""

from __future__ import annotations

import errno
import math
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

from armsight.devices.data import JointState
from armsight.errors import RecordingError
from armsight.recording.byte_queue import ByteQueue
from armsight.recording.changes import Changes
from armsight.recording.mcap_file import McapReader, McapWriter
from armsight.recording.messages import to_seconds
from armsight.recording.session_writer import Scribe
from armsight.recording.small_pictures import Thinning
from armsight.recording.streams import BY_READING
from armsight.runtime.view import SessionView

if TYPE_CHECKING:
    from armsight.workcell import Cell

WAITING_BYTES = 256 * 1024 * 1024
"""Most that may wait for the disk."""
MOVERS_PERIOD = 0.1
"""Between records of where people are [s]."""
HEALTH_PERIOD = 1.0
"""Between records of everybody's health [s]."""
TURNED_BACK = 1.0
"""A clock that is this much earlier than before was turned back [s]."""
FLUSH_SECONDS = 0.5
"""A recording that is killed loses at most this much [s] and what was waiting."""
LATE = 0.5
"""In real time pictures and clouds are dropped while the oldest waits for longer [s]."""

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class RecordedSession(Protocol):
    """What the recorder needs of a session."""

    def view(self) -> SessionView:
        """One consistent look."""
        ...


class Recorder:
    """Writes ``NAME.mcap``; until :meth:`close` it is ``NAME.mcap.partial``.

    A full disk ends the recording, not the session: :attr:`problem` says so, and the file is closed
    with everything written until then. So does a reset: a recording's time never runs backwards.

    Args:
        path: ends in ``.mcap``; never overwritten.
        cell: what is recorded.
        pictures: ``whole``, bit for bit; or ``small``: fewer, and compressed.
        cloud_period: between point clouds and voxels [s].
        waiting_bytes: what may wait for the disk; see ``wait``.
        wait: when that is reached, hold the session up (right under the simulated clock, which has
            time) or drop frames and count them (right in real time).
    """

    name = "recorder"

    def __init__(
        self,
        path: str | Path,
        cell: Cell,
        *,
        pictures: Literal["small", "whole"] = "whole",
        period: float = 1.0 / 30.0,
        cloud_period: float = 0.2,
        waiting_bytes: int = WAITING_BYTES,
        wait: bool = True,
    ) -> None:
        """Create the file and write what is known before the start.

        Raises:
            RecordingError: the file exists already or cannot be written.
        """
        self.period = period
        self.problem = ""
        self.dropped = 0
        self._wait = wait
        self._cloud_period = cloud_period
        self._view: Callable[[], SessionView] | None = None
        self._start: float | None = None
        self._newest = -math.inf
        self._joints = -math.inf
        self._failure = ""
        self._kept: Path | None = None
        self._changes = Changes()
        self._writer = McapWriter(Path(path))
        self._scribe = Scribe(cell, self._writer, pictures == "small")
        self._thinning = Thinning() if pictures == "small" else None
        self._queue = ByteQueue(waiting_bytes, LATE)
        try:
            self._scribe.describe()
        except OSError as error:
            self._fail(error)
        self._thread = threading.Thread(target=self._work, name="armsight-recording", daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        """The file's name once it is closed."""
        return self._kept or self._writer.path

    @property
    def empty(self) -> bool:
        """Nothing has been recorded but what is known before the start."""
        return self._start is None

    def attach(self, session: RecordedSession) -> None:
        """Watch a session; its sensing calls :meth:`on_reading`. Again, it was reset."""
        if self._start is not None:
            self._end_at_reset()
        self._view = session.view

    # -- called by sensing ----------------------------------------------------------------------

    def on_reading(self, reading: Any, now: float) -> None:
        """Record what a device said and that came in at ``now`` [s]; joints seen before are not."""
        if isinstance(reading, JointState):
            if reading.stamp <= self._joints:
                return
            self._joints = reading.stamp
        stream = BY_READING.get(type(reading))
        if stream is None or (self._thinning is not None and not self._thinning.keeps(reading)):
            return
        if not self._put(stream.size(reading), lambda: self._scribe.reading(reading, now), now):
            self.dropped += 1
            self.problem = f"{self.dropped} readings not recorded: disk or processor too slow"

    # -- called by the loop ---------------------------------------------------------------------

    def update(self, now: float) -> None:
        """Record what can be seen from outside: status, links, map, people, health."""
        if self._view is None or self._queue.closed:
            return
        view, scribe, changes = self._view(), self._scribe, self._changes
        guard, joints, snapshot = view.guard, view.joints, view.snapshot
        if guard is not None and changes.changed("guard", guard):
            self._put(1024, lambda: scribe.guard(guard, now), now)
        face = view.face
        if face is not None and changes.changed("face", face):
            size = 4096 + sum(picture.image.nbytes for picture in face.face.pictures)
            self._put(size, lambda: scribe.face(face, now), now)
        if joints is not None and changes.changed("links", joints):
            self._put(1024, lambda: scribe.links(joints, now), now)
        if (view.movers or view.bodies) and changes.due("movers", now, MOVERS_PERIOD):
            self._put(4096, lambda: scribe.movers(view, now), now)
        if snapshot is not None and changes.due("cloud", now, self._cloud_period):
            self._put(snapshot.cloud.nbytes, lambda: scribe.cloud(snapshot, now), now)
        if changes.due("health", now, HEALTH_PERIOD):
            self._put(1024, lambda: scribe.health(view, now), now)

    def close(self) -> Path:
        """Write what is waiting, the index, and give the file its name; may be repeated.

        Raises:
            RecordingError: writing ended early; the message says how much there is.
        """
        self._queue.close()
        self._thread.join()
        if self._failure:
            raise RecordingError(self._failure)
        return self.path

    # -- the writing thread ---------------------------------------------------------------------

    def _work(self) -> None:
        try:
            flushed = time.monotonic()
            while (job := self._queue.get()) is not None:
                job()
                if time.monotonic() - flushed > FLUSH_SECONDS:
                    self._writer.flush()
                    flushed = time.monotonic()
            if not self._failure:
                self._kept = self._writer.close()
        except Exception as error:  # a bug must not leave a torn file behind
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        """End the recording: close what there is, and say what happened."""
        self._queue.close(drop=True)
        full = getattr(error, "errno", 0) in _FULL
        what = "the disk is full" if full else f"{type(error).__name__}: {error}"
        try:
            self._kept = self._writer.abandon()
            self._failure = (
                f"recording stopped: {what}; {self._kept} is complete up to {self._seconds():.1f} s"
                + ". Free some space, or record to another disk" * full
            )
        except (OSError, RecordingError) as second:
            self._kept = self._writer.partial
            self._failure = (
                f"recording stopped: {what}, and {self._kept} could not be closed "
                f"({getattr(second, 'strerror', None) or second}); it is readable up to its cut, "
                f"{self._seconds():.1f} s"
            )
        self.problem = self._failure

    def _seconds(self) -> float:
        """How far the file goes, by the file: what was on its way to the disk is not in it."""
        try:
            with McapReader(self.path) as reader:
                end = to_seconds(reader.span[1])
        except RecordingError:
            return 0.0
        return 0.0 if self._start is None else max(0.0, end - self._start)

    def _put(self, size: int, job: Callable[[], None], now: float) -> bool:
        if self._start is None:
            self._start = now
        if now < self._newest - TURNED_BACK:
            self._end_at_reset()
            return True
        self._newest = max(self._newest, now)
        return self._queue.put(size, job, wait=self._wait)

    def _end_at_reset(self) -> None:
        self._queue.close()
        self.problem = f"recording ended at {self._newest:.1f} s: the session was reset"
