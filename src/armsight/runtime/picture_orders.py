"""What the cameras are asked for: as much colour as their subscribers want together, no more."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any

from armsight.devices.protocols import RgbdCamera, StereoCamera
from armsight.errors import UsageError
from armsight.motion.perception import CameraUse, Perceiver
from armsight.motion.task import Task


class PictureOrders:
    """Keeps the orders of one session's task and perceivers.

    Args:
        task: may change what it subscribes to; perceivers do not.
        perceivers: of the session.
        cameras: as the session reads them.
        stereo: pairs of the cell.
        lock: held while a pair is asked.
    """

    def __init__(
        self,
        task: Task | None,
        perceivers: Sequence[Perceiver],
        cameras: Sequence[RgbdCamera],
        stereo: Sequence[StereoCamera],
        lock: AbstractContextManager[Any],
    ) -> None:
        self._task = task
        self._always: list[CameraUse] = [u for p in perceivers for u in p.cameras]
        always = [p for p in perceivers if not getattr(p, "on_demand", False)]
        self._looked_at = [name for p in always for name in getattr(p, "stereo", ())]
        self._cameras = cameras
        self._pairs = {pair.info.name: pair for pair in stereo}
        self._lock = lock
        self._colored: set[str] = set()

    def place(self) -> None:
        """Ask each camera for what is wanted of it now, and each pair.

        One that is no evidence for the guard, and that nobody looks at, may stand by.

        Raises:
            UsageError: the task wants a pair that is not in the cell.
        """
        uses = list(self._always)
        wanted = list(self._looked_at)
        if self._task is not None:
            wanted += self._known_pairs(self._task)
            uses += self._task.subscriptions.cameras
        for name, pair in self._pairs.items():
            with self._lock:
                pair.want_pictures(name in wanted)
        for camera in self._cameras:
            mine = [u for u in uses if u.camera in ("", camera.info.name)]
            those = [u for u in mine if u.color_rate > 0]
            if those or camera.info.name in self._colored:
                camera.want_color(
                    max((u.color_rate for u in those), default=0.0),
                    max((u.color_scale for u in those), default=1.0),
                )
                self._colored.add(camera.info.name)
            if hasattr(camera, "want_infrared"):
                camera.want_infrared(any(u.infrared for u in those))
            if hasattr(camera, "stand_by"):
                camera.stand_by(not mine and not camera.info.guard)

    def _known_pairs(self, task: Task) -> tuple[str, ...]:
        for name in task.subscriptions.stereo:
            if name not in self._pairs:
                known = ", ".join(sorted(self._pairs)) or "none"
                raise UsageError(
                    f"task {task.name}: no stereo pair '{name}' in this cell; there are: {known}"
                )
        return task.subscriptions.stereo
