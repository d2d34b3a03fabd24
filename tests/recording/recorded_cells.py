"""Small cells for the tests of recording: a real arm and cameras that show made-up depth."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armsight.devices.data import DepthNoise, JointState, RgbdCameraInfo, RgbdFrame
from armsight.devices.recorded import RecordedArm, RecordedCamera, RecordedClock
from armsight.devices.world import MovingSolid
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy, look_at
from armsight.geometry.shapes import Solid
from armsight.motion.data import GuardMode, GuardStatus
from armsight.motion.permits import Permit, PermitState
from armsight.motion.regions import Region
from armsight.recording.replay import bare_workcell
from armsight.robots import load_robot
from armsight.runtime.view import ComponentHealth, SessionView
from armsight.workcell import Cell

CELL_FILE = """\
[cell]
name = "tiny"

[robot]
model = "ur5"
"""


def camera_info(name: str, distortion: float = 0.0, color: bool = False) -> RgbdCameraInfo:
    lens = PinholeCamera(64, 48, 60.0, 61.0, 31.7, 23.2, (distortion, 0.0, 0.001, 0.0, 0.0))
    if not distortion:
        lens = PinholeCamera(64, 48, 60.0, 61.0, 31.7, 23.2)
    return RgbdCameraInfo(
        name,
        "kinect_v2",
        lens,
        PinholeCamera(32, 24, 30.0, 30.0, 15.5, 11.5) if color else None,
        from_rpy([0.01, -0.02, 0.03], [0.05, 0.0, 0.001]),
        "base",
        look_at([1.5, 1.1, 1.2], [0.1, 0.2, 0.3]),
        15.0,
        0.03,
        (0.5, 4.5),
        DepthNoise(0.001, 0.0, 0.002),
    )


def make_cell(cameras: tuple[RgbdCameraInfo, ...] | None = None) -> Cell:
    robot = load_robot("ur5")
    infos = cameras or (camera_info("left", 0.05, color=True), camera_info("right"))
    T = from_rpy([0, 0, 0.3], [0, 0.1, -0.05])
    solid = Solid("table", "box", (1.0, 2.0, 0.1), T, coarse=0.03)
    return Cell(
        bare_workcell("tiny", "ur5"),
        robot,
        from_rpy([0.0, 0.0, 0.7], [0.1, 0.2, 0.9]),
        RecordedClock(),
        RecordedArm(robot.joint_names),
        tuple(RecordedCamera(info) for info in infos),
        (solid,),
    )


def make_frame(
    info: RgbdCameraInfo, sequence: int, stamp: float, rng: np.random.Generator
) -> RgbdFrame:
    depth = rng.uniform(0.5, 4.5, (info.depth.height, info.depth.width)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = np.nan
    color = None
    if info.color is not None:
        color = rng.integers(0, 256, (info.color.height, info.color.width, 3), dtype=np.uint8)
    return RgbdFrame(info.name, sequence, stamp, stamp + info.latency, depth, color)


def make_status(stamp: float, n: int, rng: np.random.Generator) -> GuardStatus:
    return GuardStatus(
        stamp=stamp,
        mode=GuardMode.SLOWED,
        reason="a hand is 0.31 m from the elbow",
        goal="A",
        reached=False,
        command=rng.normal(size=n),
        speed_scale=float(rng.random()),
        distance=float(rng.random()),
        protective_distance=float(rng.random()),
        nearest_hazard=rng.normal(size=3),
        nearest_body=rng.normal(size=3),
        path=rng.normal(size=(5, n)),
        executed=None,
        snapshot_sequence=7,
        snapshot_age=0.05,
        replans=3,
        reflexes=1,
        permit=Permit(
            "ball",
            "thing",
            PermitState.LESS,
            "speed 0.25 instead of 3",
            Region(
                "capsule",
                (0.03, 0.1, 0.0),
                from_rpy(rng.normal(size=3), rng.normal(size=3)),
                float(rng.random()),
                rng.normal(size=3),
                np.diag(rng.random(3)),
            ),
            *map(float, rng.random(5)),
        ),
        wanted=rng.normal(size=n),
        evidence_age=float(rng.random()),
        timings=(("risk", 0.001),),
    )


@dataclass
class FakeSession:
    """Shows a view that the test sets."""

    cell: Cell
    shown: SessionView = field(default_factory=lambda: empty_view(0.0))

    def view(self) -> SessionView:
        return self.shown


def empty_view(now: float, **fields: object) -> SessionView:
    base: dict[str, object] = {
        "now": now,
        "running": True,
        "speed": 1.0,
        "joints": None,
        "snapshot": None,
        "guard": None,
        "health": (ComponentHealth("sensing", 0.004, 10, 0, now, (1e-4, 2e-4)),),
    }
    return SessionView(**(base | fields))  # type: ignore[arg-type]


def make_joints(stamp: float, n: int, rng: np.random.Generator) -> JointState:
    return JointState(stamp, rng.normal(size=n), rng.normal(size=n), rng.normal(size=n))


def make_movers(rng: np.random.Generator) -> tuple[MovingSolid, ...]:
    kinds = (("box", (0.1, 0.2, 0.3)), ("cylinder", (0.05, 0.4, 0.0)), ("sphere", (0.12, 0.0, 0.0)))
    movers = []
    for i, (kind, size) in enumerate(kinds):
        pose = from_rpy(rng.normal(size=3), rng.normal(size=3))
        movers.append(MovingSolid(f"part{i}", Solid(f"part{i}", kind, size, pose), pose))  # type: ignore[arg-type]
    return tuple(movers)
