"""The live page: an observer of a session that shows it in the browser and passes on its wishes."""

from __future__ import annotations

import threading
import time
from typing import Any, Protocol
from urllib.parse import quote

import numpy as np

from armsight.arrays import Vector3
from armsight.errors import ArmsightError
from armsight.robots.kinematics import flange_jacobian
from armsight.runtime.view import SessionView
from armsight.viewer.accuracy import TrueErrors, accuracy
from armsight.viewer.cameras import mosaic
from armsight.viewer.panels import Controls, Panels
from armsight.viewer.scene import CellScene
from armsight.viewer.server import open_server, stop_server
from armsight.workcell import Cell

PERIOD = 0.1
"""Between updates [s]."""
HEALTH_PERIOD = 0.5
"""Between updates of tables and plots, on the computer's clock [s]."""
SILENT = 1.0
"""A loop that gave no sign for so long is said to stand still [s]."""
OLD_WORD = 0.5
"""What guard or joints said longer ago, on the cell's clock, is not shown as of now [s]."""


class ShownSession(Protocol):
    """What the page needs of a session."""

    cell: Cell

    def view(self) -> SessionView:
        """One consistent look; safe from any thread."""
        ...

    def pause(self) -> None:
        """Stand still."""
        ...

    def resume(self) -> None:
        """Go on."""
        ...

    def set_speed(self, speed: float) -> None:
        """Simulated seconds a second."""
        ...

    def declare_empty(self) -> None:
        """Somebody says that nobody is in the cell."""
        ...

    def reset(self) -> None:
        """Back to time 0."""
        ...

    def drag(self, name: str, position_world: Vector3) -> None:
        """Move a thing or a hand of a simulated cell."""
        ...

    def press(self, button: str) -> None:
        """A person pressed a button on the task's face."""
        ...


class LivePage:
    """Shows a session; also while it is paused, and when it has ended.

    The loop calls :meth:`update`. When it does not (paused, ended, stuck), a thread of the page
    looks now and then by itself. Nothing is sent while nobody watches.

    Args:
        session: to show.
        host: loopback only, unless told otherwise, and then a token is needed.
        port: 0 takes a free one.
        token: see :mod:`armsight.viewer.access`.
    """

    name = "page"
    period = PERIOD

    def __init__(
        self,
        session: ShownSession,
        host: str = "127.0.0.1",
        port: int = 8080,
        token: str | None = None,
    ) -> None:
        """Open the page.

        Raises:
            UsageError: beyond loopback without a token.
            ViewerError: the port is in use, or the host is none of this machine's.
        """
        self.problem = ""
        self._session = session
        self._token = token
        self._host = host
        cell = session.cell
        self._cell = cell
        self._server = open_server(host, port, token, f"armsight · {cell.workcell.name}")
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._updated = self._health_shown = -np.inf
        self._now = -np.inf
        self._camera_turn = 0
        self._true_errors = TrueErrors(cell.world, [camera.info for camera in cell.cameras])
        self._draggable = draggable(cell)
        with self._server.atomic():
            self._scene = CellScene(self._server, cell)
            self._panels = Panels(
                self._server,
                cell.workcell.name,
                Controls(
                    session.pause,
                    session.resume,
                    self._reset if cell.simulated else None,
                    session.set_speed if cell.simulated else None,
                    session.declare_empty,
                ),
                self._scene.layers(),
                not cell.robot.n,
                self._draggable,
                self._choose_dragged,
                session.press,
            )
        self._gizmo: Any = None
        self._choosing = threading.Lock()
        self._server.on_client_connect(lambda _: self._look())
        self._thread = threading.Thread(target=self._watch, name="armsight-page", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port it listens on."""
        return self._server.get_port()

    @property
    def url(self) -> str:
        """What to open in a browser, with the token if there is one."""
        host = {"0.0.0.0": "localhost", "::": "localhost"}.get(self._host, self._host)  # noqa: S104
        host = f"[{host}]" if ":" in host else host
        query = f"?token={quote(self._token)}" if self._token else ""
        return f"http://{host}:{self.port}/{query}"

    def update(self, now: float) -> None:
        """Show what the session looks like, if somebody watches."""
        view = self._session.view()
        with self._lock:
            self._updated = time.monotonic()
            speed = self._tip_speed(view)
            if view.now < self._now - 1e-6:
                self._scene.forget()
                self._panels.clear()
            self._now = view.now
            self._panels.sample(view, speed)
            if self._server.get_clients():
                self._show(view, speed, *_old_guard(view))

    def close(self) -> None:
        """End the page; may be repeated."""
        if self._closed.is_set():
            return
        with self._lock:
            self._closed.set()
        self._thread.join(timeout=2.0)
        stop_server(self._server)

    # -- showing --------------------------------------------------------------------------------

    def _show(self, view: SessionView, tip_speed: float, note: str, old: bool) -> None:
        with self._server.atomic():
            self._scene.update(view)
            self._panels.update(view, tip_speed, note, old=old)
            fresh = self._show_next_picture(view)
            now = time.monotonic()
            self._panels.beat(int(now))
            if now >= self._health_shown + HEALTH_PERIOD:
                self._health_shown = now
                self._panels.update_health(view, self._accuracy(view))
                if fresh:
                    pictures = [camera.picture for camera in self._scene.cameras.values()]
                    self._panels.show_pictures(mosaic(pictures))

    def _accuracy(self, view: SessionView) -> str:
        """What is believed of the cameras' calibration now, and the truth where it is simulated."""
        infos = [camera.info for camera in self._cell.cameras]
        return accuracy(infos, self._true_errors.now(view.snapshot))

    def _show_next_picture(self, view: SessionView) -> bool:
        """One camera's picture a round: encoding them all at once would be a hiccup."""
        if not view.frames:
            return False
        self._camera_turn += 1
        frame = view.frames[self._camera_turn % len(view.frames)]
        camera = self._scene.cameras.get(frame.camera)
        return camera is not None and (camera.show_picture(frame) or camera.picture is not None)

    def _look(self) -> None:
        """Look without the loop: for a newcomer, and when the loop is silent."""
        view = self._session.view()
        with self._lock:
            if self._closed.is_set():
                return
            silent = time.monotonic() - self._updated > SILENT
            note, old = ("paused", False) if silent and not view.running else _old_guard(view)
            if view.running and silent and np.isfinite(self._updated):
                note, old = "the loop stands still: it has ended, or is busy", True
            self._health_shown = -np.inf
            self._show(view, np.nan if old else self._tip_speed(view), note, old)

    def _watch(self) -> None:
        while not self._closed.wait(HEALTH_PERIOD):
            if time.monotonic() - self._updated > SILENT and self._server.get_clients():
                try:
                    self._look()
                except Exception as error:  # a page must never take the session down
                    self.problem = f"page: {type(error).__name__}: {error}"

    def _tip_speed(self, view: SessionView) -> float:
        """Speed of the flange at the last joint reading [m/s]; NaN without one of now."""
        joints, robot = view.joints, self._cell.robot
        if joints is None or not robot.n or view.now - joints.stamp > OLD_WORD:
            return float("nan")
        jacobian = flange_jacobian(robot, joints.position)
        return float(np.linalg.norm((jacobian @ joints.velocity)[:3]))

    # -- wishes ---------------------------------------------------------------------------------

    def _reset(self) -> None:
        self._session.reset()
        self._session.resume()

    def _choose_dragged(self, name: str) -> None:
        """Put arrows on a thing that the person may drag, or take them away."""
        with self._choosing:  # several pages choose at once, each in a thread of its own
            if self._gizmo is not None:
                self._gizmo.remove()
                self._gizmo = None
            if name not in self._draggable:
                return
            self._gizmo = self._server.scene.add_transform_controls(
                "/drag",
                scale=0.25,
                disable_rotations=True,
                position=self._dragged_from(name),
                depth_test=False,
            )
            self._gizmo.on_update(lambda _: self._move_dragged(name))

    def _dragged_from(self, name: str) -> Vector3:
        """Where a thing is that the person may drag: what follows the arrows, in world [m]."""
        car = getattr(self._cell.world, "car", None)
        if car is not None and car.name == name:  # its port follows them, not its body's middle
            return np.asarray(car.T_world_socket[:3, 3])
        parts = [m for m in self._session.view().movers if _belongs(m.name, name)]
        if not parts:
            at = [c.T_mount_camera for c in _fixed_cameras(self._cell) if c.info.name == name]
            return np.asarray(at[0][:3, 3]) if at else np.zeros(3)
        return np.asarray(np.mean([m.T_world_solid[:3, 3] for m in parts], axis=0))

    def _move_dragged(self, name: str) -> None:
        gizmo = self._gizmo
        target = None if gizmo is None else np.array(gizmo.position, float)
        if target is None or not np.isfinite(target).all():  # a browser's word, as all here
            return
        try:
            self._session.drag(name, target)
        except ArmsightError as error:
            self.problem = str(error)


def draggable(cell: Cell) -> tuple[str, ...]:
    """Names of what may be dragged: free objects, hands, a parked car, stands of cameras."""
    if cell.world is None or not hasattr(cell.world, "spec"):
        return ()
    settings = cell.workcell.simulation
    hands = [p.name for p in settings.person if p.motion == "hand"]
    free = [thing.name for thing in settings.object if thing.path == "free"]
    led = [target.name for target in settings.target if target.path in ("free", "wander")]
    car = () if settings.car is None else ("car",)
    named = (*hands, *free, *led, *car)
    return (*named, *(c.info.name for c in _fixed_cameras(cell) if c.info.name not in named))


def _fixed_cameras(cell: Cell) -> list[Any]:
    """Simulated ones that stand in the cell; where they truly are is the simulation's to tell."""
    cameras = getattr(cell.world, "cameras", ())
    return [camera for camera in cameras if camera.info.mounted_on == "base"]


def _old_guard(view: SessionView) -> tuple[str, bool]:
    """What to say where the guard itself has said nothing for a while, and whether it has."""
    if view.guard is None or view.now - view.guard.stamp <= OLD_WORD:
        return "", False
    return f"the guard has said nothing for {view.now - view.guard.stamp:.1f} s", True


def _belongs(mover: str, name: str) -> bool:
    return mover == name or mover.startswith((f"{name}/", f"{name}_", f"{name}."))
