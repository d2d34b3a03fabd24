"""A session that shows what a test sets, without simulation, map or guard."""

from __future__ import annotations

from dataclasses import dataclass, field
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
from armsight.motion.face import (
    ArrowMark,
    Button,
    Curve,
    EllipsoidMark,
    Face,
    Figure,
    FrameMark,
    Picture,
    PointsMark,
    RegionMark,
    ShownFace,
    Trace,
)
from armsight.robots import load_robot
from armsight.runtime.view import ComponentHealth, SessionView
from armsight.workcell import Cell, Workcell

GRID = VoxelGrid(np.array([-1.0, -1.0, -0.1]), 0.05, (40, 40, 24))


class World:
    """Enough of a simulated world: it has a spec, so things may be dragged."""

    spec: Any = None

    def camera_error(self, name: str, T_believed_corrected: np.ndarray, gain: float) -> float:
        return {"<left>": 0.0674, "right": 0.0008}.get(name, 0.0)

    def movers(self) -> tuple[MovingSolid, ...]:
        return ()


def make_cell() -> Cell:
    robot = load_robot("ur5")
    model = CAMERA_MODELS["kinect_v2"]
    infos = [
        RgbdCameraInfo(
            name,
            "kinect_v2",
            model.depth,
            None,
            np.eye(4),
            mount,
            look_at([1.3, y, 1.4], [0.2, 0.0, 0.3]) if mount == "base" else np.eye(4),
            15.0,
            0.03,
            model.range,
            model.noise,
        )
        for name, y, mount in (
            ("<left>", 1.2, "base"),
            ("right", -1.2, "base"),
            ("wrist", 0, "flange"),
        )
    ]
    workcell = Workcell.model_validate(
        {
            "cell": {"name": "fake"},
            "robot": {"model": "ur5"},
            "simulation": {
                "person": [{"name": "helper", "motion": "hand", "position": [1, 0, 1]}],
                "object": [
                    {"name": "ball", "kind": "sphere", "radius": 0.1, "position": [1, 1, 1]}
                ],
            },
        }
    )
    table = Solid("table", "box", (1.4, 1.4, 0.05), from_rpy([0, 0, 0], [0.3, 0.0, -0.03]))
    cell = Cell(
        workcell,
        robot,
        make_pose(None, [0.0, 0.0, 0.7]),
        RecordedClock(),
        RecordedArm(robot.joint_names),
        tuple(RecordedCamera(info) for info in infos),
        (table,),
    )
    cell.world = World()  # type: ignore[assignment]
    return cell


def make_snapshot(
    sequence: int, now: float, points: int = 500, voxels: int = 200
) -> WorkspaceSnapshot:
    rng = np.random.default_rng(sequence)
    last = np.full(GRID.shape, -np.inf, np.float32)
    last.reshape(-1)[rng.permutation(last.size)[:voxels]] = now - rng.uniform(0.0, 20.0, voxels)
    hazards = rng.uniform(-0.5, 0.5, (50, 3)).astype(np.float32)
    return WorkspaceSnapshot(
        sequence=sequence,
        stamp=now,
        oldest=now,
        grid=GRID,
        state=np.zeros(GRID.shape, np.uint8),
        distance=np.zeros(GRID.shape, np.float32),
        distance_cap=0.3,
        last_occupied=last,
        hazards=hazards,
        hazard_radius=0.03,
        hazard_unknown=rng.random(50) < 0.5,
        cloud=rng.uniform(-0.8, 0.8, (points, 3)).astype(np.float32),
        cameras=(
            CameraStatus("<left>", now - 0.03, True, sequence, 0),
            CameraStatus("right", -np.inf, False, 0, 3, "no frame for 0.4 s"),
        ),
        timings=(("clean", 0.002), ("field", 0.004)),
    )


def make_guard(now: float, **fields: Any) -> GuardStatus:
    values: dict[str, Any] = {
        "stamp": now,
        "mode": GuardMode.SLOWED,
        "reason": "a hand is <0.4 m from the elbow",
        "goal": "A & B",
        "reached": False,
        "command": np.zeros(6),
        "speed_scale": 0.4,
        "distance": 0.31,
        "protective_distance": 0.5,
        "nearest_hazard": np.array([0.6, 0.1, 0.4]),
        "nearest_body": np.array([0.4, 0.1, 0.3]),
        "path": np.linspace(np.zeros(6), np.full(6, 0.5), 5),
        "executed": np.linspace(np.full(6, -0.5), np.zeros(6), 30),
        "snapshot_sequence": 1,
        "snapshot_age": 0.03,
        "timings": (("guard", 0.001),),
    }
    return GuardStatus(**(values | fields))


def make_view(now: float = 1.0, sequence: int = 1, **fields: Any) -> SessionView:
    rng = np.random.default_rng(sequence)
    q = load_robot("ur5").home + 0.2 * np.sin(now)
    model = CAMERA_MODELS["kinect_v2"]
    depth = rng.uniform(0.6, 3.0, (model.depth.height, model.depth.width)).astype(np.float32)
    kinds = (("sphere", (0.1, 0.0, 0.0)), ("cylinder", (0.06, 0.5, 0.0)), ("box", (0.2, 0.1, 0.3)))
    movers = tuple(
        MovingSolid(
            f"person/{kind}",
            Solid(kind, kind, size, np.eye(4), (0.9, 0.5, 0.2)),
            make_pose(None, p),
        )  # type: ignore[arg-type]
        for (kind, size), p in zip(kinds, rng.uniform(0.5, 1.2, (3, 3)))
    )
    values: dict[str, Any] = {
        "now": now,
        "running": True,
        "speed": 1.0,
        "joints": JointState(now, q, np.full(6, 0.1)),
        "snapshot": make_snapshot(sequence, now),
        "guard": make_guard(now),
        "frames": (RgbdFrame("<left>", sequence, now, now, depth),),
        "health": (ComponentHealth("mapping", 0.02, 10, 2, now, (0.004, 0.009), "too <slow>"),),
        "movers": movers,
    }
    return SessionView(**(values | fields))


@dataclass
class FakeSession:
    """Remembers what the page asks of it."""

    cell: Cell = field(default_factory=make_cell)
    shown: SessionView = field(default_factory=make_view)
    asked: list[Any] = field(default_factory=list)

    def view(self) -> SessionView:
        return self.shown

    def step(self, now: float, **fields: Any) -> None:
        self.shown = make_view(now, round(now * 10), **fields)

    def pause(self) -> None:
        self.asked.append("pause")

    def resume(self) -> None:
        self.asked.append("resume")

    def reset(self) -> None:
        self.asked.append("reset")

    def declare_empty(self) -> None:
        self.asked.append(("empty",))

    def set_speed(self, speed: float) -> None:
        self.asked.append(("speed", speed))

    def drag(self, name: str, position_world: np.ndarray) -> None:
        self.asked.append(("drag", name, tuple(np.round(position_world, 3))))

    def press(self, button: str) -> None:
        self.asked.append(("press", button))


def make_face(now: float = 1.0, **fields: Any) -> ShownFace:
    """A face with every kind of mark, curves of two units, pictures and buttons."""
    rng = np.random.default_rng(5)
    swing = 0.1 * np.sin(now)
    picture = np.full((120, 160, 3), 30, np.uint8)
    picture[30:90, 40 + int(200 * abs(swing)) : 90] = (250, 200, 40)
    values: dict[str, Any] = {
        "state": "approach <slow>",
        "reason": "target & arm are 12.3 mm apart",
        "figures": (Figure("distance", 12.34, "mm"), Figure("tilt", np.nan, "deg")),
        "curves": (
            Curve("distance", 12.34, "mm"),
            Curve("bound", 5.0, "mm"),
            Curve("tilt", 0.3, "deg"),
        ),
        "pictures": (Picture("what it sees", picture),),
        "marks": (
            PointsMark("corners", rng.uniform(0.2, 0.5, (8, 3)), 0.012),
            ArrowMark("motion", np.array([0.4, 0.2, 0.3]), np.array([0.6, 0.2 + swing, 0.5])),
            FrameMark("target", make_pose(None, [0.6, -0.2, 0.3]), 0.15),
            EllipsoidMark.of("doubt", np.array([0.6, -0.2, 0.3]), np.diag([4e-3, 1e-3, 2e-4])),
            RegionMark(
                "keep out",
                make_pose(None, [0.1, 0.5, 0.3]),
                np.array([0.3, 0.2, 0.4]),
                (40, 160, 240),
            ),
        ),
        "buttons": (Button("go", "Go on"), Button("skip", "Skip this one", enabled=False)),
    }
    face = Face(**(values | fields))
    times = np.linspace(max(0.0, now - 30.0), now, 200)
    traces = tuple(
        Trace(c.name, c.unit, times, c.value + np.sin(times + i)) for i, c in enumerate(face.curves)
    )
    return ShownFace("keep_above", now, face, traces)
