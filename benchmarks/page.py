"""Load of the live page on the loop: 10 updates a second, 20,000 points, 5,000 voxels, one browser.

A made-up session moves everything that can move at every update: joints, cloud, voxels, person,
path, pictures of four cameras. The browser is a client in another process that takes what it is
sent, so that only this side is measured: seconds of computing a second, of the thread that calls
the page (the loop) and of this whole process (the page's server thread included).
"""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from armsight.devices.camera_models import CAMERA_MODELS
from armsight.devices.data import JointState, RgbdCameraInfo, RgbdFrame
from armsight.devices.recorded import RecordedArm, RecordedCamera, RecordedClock
from armsight.devices.world import MovingSolid
from armsight.geometry.pose import from_rpy, look_at, make_pose
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import CameraStatus, VoxelGrid, WorkspaceSnapshot
from armsight.motion.data import GuardMode, GuardStatus
from armsight.recording.replay import bare_workcell
from armsight.robots import load_robot
from armsight.runtime.view import ComponentHealth, SessionView
from armsight.viewer import LivePage
from armsight.workcell import Cell
from common import Report

POINTS, VOXELS, CAMERAS, PARTS = 20_000, 5_000, 4, 24
GRID = (140, 140, 100)
TARGET = (0.0, 0.0, 0.3)

CLIENT = """
import asyncio, sys, viser
from websockets.asyncio.client import connect

async def main(port):
    protocol = f"viser-v{viser.__version__}"
    url = f"ws://127.0.0.1:{port}/"
    async with connect(url, subprotocols=[protocol], max_size=None, compression=None) as page:
        await page.send(open(sys.argv[2], "rb").read())
        taken = 0
        async for message in page:
            taken += len(message)

asyncio.run(main(int(sys.argv[1])))
"""


@dataclass
class MadeUp:
    """A session whose every look shows something new."""

    cell: Cell
    seed: int = 0

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        self._rng = rng
        self._grid = VoxelGrid(np.array([-1.4, -1.4, -0.2]), 0.02, GRID)
        self._last = np.full(GRID, -np.inf, np.float32)
        self._where = rng.permutation(int(np.prod(GRID)))[:VOXELS]
        self._points = rng.uniform(-1.2, 1.2, (POINTS, 3)).astype(np.float32)
        self._depth = {
            c.info.name: rng.uniform(0.6, 4.0, (c.info.depth.height, c.info.depth.width)).astype(
                np.float32
            )
            for c in self.cell.cameras
        }
        self.sequence = 0

    def step(self) -> None:
        """Time goes on by a tenth of a second."""
        self.sequence += 1
        now, n = 0.1 * self.sequence, self.cell.robot.n
        rng, q = self._rng, self.cell.robot.home + 0.3 * np.sin(0.1 * self.sequence)
        self._last.reshape(-1)[self._where] = now - rng.uniform(0.0, 20.0, VOXELS)
        cloud = self._points + np.float32(0.01 * np.sin(now))
        names = [camera.info.name for camera in self.cell.cameras]
        none = np.zeros((0, 3), np.float32)
        snapshot = WorkspaceSnapshot(
            sequence=self.sequence,
            stamp=now,
            oldest=now,
            grid=self._grid,
            state=np.zeros(GRID, np.uint8),
            distance=np.zeros((1, 1, 1), np.float32),
            distance_cap=0.3,
            last_occupied=self._last,
            hazards=none,
            hazard_radius=0.02,
            hazard_unknown=np.zeros(0, bool),
            cloud=cloud,
            cameras=tuple(CameraStatus(name, now, True, self.sequence, 0) for name in names),
            timings=tuple((stage, 0.002) for stage in ("clean", "filter", "fuse", "field")),
        )
        path = q + np.linspace(0.0, 1.0, 8)[:, None] * rng.normal(size=n)
        guard = GuardStatus(
            now, GuardMode.SLOWED, "a hand is near the elbow", "A", False, np.zeros(n), 0.5,
            0.4 + 0.1 * np.sin(now), 0.35, rng.normal(size=3), rng.normal(size=3), path, path,
            self.sequence, 0.03, 3, 1, (("risk", 0.0005), ("guard", 0.001)),
        )  # fmt: skip
        movers = tuple(
            MovingSolid(
                f"person_{i}",
                Solid(f"person_{i}", "sphere", (0.08, 0.0, 0.0), np.eye(4)),
                make_pose(None, rng.normal(size=3)),
            )
            for i in range(PARTS)
        )
        frames = tuple(
            RgbdFrame(name, self.sequence, now, now, self._depth[name]) for name in names
        )
        health = tuple(
            ComponentHealth(name, 0.01, self.sequence, 0, now, (0.001, 0.002))
            for name in ("sensing", "mapping", "planning", "guard", "page")
        )
        self._view = SessionView(
            now, True, 1.0, JointState(now, q, q), snapshot, guard, frames, health, movers
        )

    def view(self) -> SessionView:
        return self._view

    def pause(self) -> None: ...
    def resume(self) -> None: ...
    def reset(self) -> None: ...
    def set_speed(self, speed: float) -> None: ...
    def declare_empty(self) -> None: ...
    def drag(self, name: str, position_world: Any) -> None: ...


def make_cell() -> Cell:
    robot = load_robot("ur5")
    model = CAMERA_MODELS["kinect_v2"]
    cameras = tuple(
        RecordedCamera(
            RgbdCameraInfo(
                f"camera_{i}", "kinect_v2", model.depth, None, np.eye(4), "base",
                look_at([1.5 * np.cos(i * 1.57 + 0.8), 1.5 * np.sin(i * 1.57 + 0.8), 1.2], TARGET),
                15.0, 0.03, model.range, model.noise,
            )
        )
        for i in range(CAMERAS)
    )  # fmt: skip
    table = Solid("table", "box", (1.4, 1.4, 0.05), from_rpy([0, 0, 0], [0.3, 0, -0.03]))
    return Cell(
        bare_workcell("page_benchmark", "ur5"),
        robot,
        np.eye(4),
        RecordedClock(),
        RecordedArm(robot.joint_names),
        cameras,
        (table,),
    )


def hello() -> bytes:
    """What a browser says first: where its camera is. Only then does viser count it as a client."""
    import msgspec
    from viser import _messages

    names = _messages.ViewerCameraMessage.__dataclass_fields__
    values = {
        "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (3.0, 0.0, 1.0), "image_height": 900,
        "image_width": 1600, "fov": 0.8, "near": 0.01, "far": 1000.0,
        "look_at": (0.0, 0.0, 0.0), "up_direction": (0.0, 0.0, 1.0),
    }  # fmt: skip
    message = {"type": "ViewerCameraMessage"} | {k: v for k, v in values.items() if k in names}
    return bytes(msgspec.msgpack.encode(message))


def load(page: LivePage, session: MadeUp, seconds: float) -> tuple[float, float, list[float]]:
    """(loop thread, whole process) in cores, less what making up the session takes.

    Per update, times ten a second: a busy machine that manages fewer must not look better.
    """
    loop = made = 0.0
    rounds: list[float] = []
    process, start = time.process_time(), time.perf_counter()
    due = start
    while (now := time.perf_counter()) < start + seconds:
        if now < due:
            time.sleep(due - now)
        due += 0.1
        before = time.thread_time()
        session.step()
        stepped = time.thread_time()
        page.update(0.0)
        rounds.append(time.thread_time() - stepped)
        loop += rounds[-1]
        made += stepped - before
    wanted = 0.1 * len(rounds)
    return loop / wanted, (time.process_time() - process - made) / wanted, rounds


def main() -> None:
    report = Report("page", __doc__)
    seconds = 4.0 if report.quick else 20.0
    session = MadeUp(make_cell())
    session.step()
    page = LivePage(session, port=0)
    loop, process, _ = load(page, session, seconds)
    report.add("loop_unwatched", 100 * loop, "% of a core", note="nobody looks")
    import tempfile

    with tempfile.NamedTemporaryFile() as greeting:
        greeting.write(hello())
        greeting.flush()
        client = subprocess.Popen([sys.executable, "-c", CLIENT, str(page.port), greeting.name])
        try:
            deadline = time.monotonic() + 30.0
            while not page._server.get_clients():
                if time.monotonic() > deadline:
                    raise SystemExit("the client did not come")
                time.sleep(0.1)
            load(page, session, 2.0)
            loop, process, rounds = load(page, session, seconds)
        finally:
            client.kill()
            client.wait()
    low, high = np.percentile(rounds, [10, 90])
    report.add(
        "loop", 100 * loop, "% of a core", must="<= 15", aim="<= 5", note="the thread that calls"
    )
    report.add(
        "update", 1e3 * float(np.median(rounds)), "ms", spread=(1e3 * low, 1e3 * high),
        note="CPU time of one update",
    )  # fmt: skip
    report.add(
        "process", 100 * process, "% of a core", must="<= 15", aim="<= 5",
        note="with the server's thread",
    )  # fmt: skip
    page.close()
    report.finish()


if __name__ == "__main__":
    main()
