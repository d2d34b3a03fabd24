"""The workspace map: from depth frames and joint readings to an immutable snapshot."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats32, Ints, Ints32, Pose
from armsight.devices.data import RgbdCameraInfo, RgbdFrame
from armsight.devices.history import JointHistory
from armsight.errors import UsageError
from armsight.geometry.shapes import Solid
from armsight.mapping.camera_stage import CameraStage, Evidence
from armsight.mapping.config import MappingConfig
from armsight.mapping.distance_field import DistanceField
from armsight.mapping.hazards import UnseenPeople
from armsight.mapping.health import CameraHealth
from armsight.mapping.occupancy import Occupancy
from armsight.mapping.self_filter import BodyPose, SelfFilter
from armsight.mapping.snapshot import VoxelGrid, WorkspaceSnapshot
from armsight.mapping.static_geometry import rasterise
from armsight.robots.kinematics import flange_pose
from armsight.robots.robot import Robot


@dataclass(frozen=True)
class _Job:
    """One admitted frame with all that is needed to judge it."""

    camera: int
    frame: RgbdFrame
    T_base_camera: Pose
    body: BodyPose


class WorkspaceMap:
    """Keeps the map of one cell. Everything is in ``base``; time comes in as an argument.

    Args:
        robot: the arm, with its tool.
        cameras: the cell's depth cameras, at most 8.
        static: declared solids in ``base``.
        config: settings.

    Raises:
        UsageError: two cameras share a name, or there are too many.
        ArmsightError: the arm has no shapes.
    """

    def __init__(
        self,
        robot: Robot,
        cameras: Sequence[RgbdCameraInfo],
        static: Sequence[Solid],
        config: MappingConfig | None = None,
    ) -> None:
        self.config = config or MappingConfig()
        self.robot = robot
        names = [c.name for c in cameras]
        if len(set(names)) != len(names):
            raise UsageError(f"cameras need names of their own, found {sorted(names)}")
        if len(names) > 8:
            raise UsageError(f"{len(names)} depth cameras; the map can tell 8 apart")
        lower, upper = np.asarray(self.config.lower), np.asarray(self.config.upper)
        voxel = self.config.voxel
        counts = np.ceil((upper - lower) / voxel - 1e-6).astype(int)
        self.grid = VoxelGrid(lower, voxel, (int(counts[0]), int(counts[1]), int(counts[2])))
        self._static = rasterise(static, self.grid, near=0.15)
        self._filter = SelfFilter(robot)
        self._index = {name: i for i, name in enumerate(names)}
        self._infos = tuple(cameras)
        self._stages = [
            CameraStage(c, self.grid, self._static, self._filter, self.config) for c in cameras
        ]
        self._health = [CameraHealth(c, self.config) for c in cameras]
        self._occupancy = Occupancy(
            self.grid, len(names), self._static.filled, self.config.hold, self.config.weak_window
        )
        self._field = DistanceField(
            self.grid.shape, voxel, self.config.distance_cap, self.config.unknown_is_solid
        )
        self._unseen = UnseenPeople(
            self.grid, self._static.filled, self.config.person_speed, self.config.hand
        )
        self._body_near = np.zeros(self.grid.shape, np.uint8)
        self._body_deep = np.zeros(self.grid.shape, np.uint8)
        self._body: BodyPose | None = None
        self._now = -np.inf
        self._sequence = -1
        threads = min(self.config.threads, len(names))
        self._pool = ThreadPoolExecutor(threads, "mapping") if threads > 1 else None

    def update(
        self, frames: Sequence[RgbdFrame], joints: JointHistory, now: float
    ) -> WorkspaceSnapshot:
        """Take in new frames and publish what is known at ``now`` [s].

        Call it with no frames too, often enough that a dead camera's space becomes unknown.
        Frames that cannot be used are counted and named in ``snapshot.cameras``, never raised.
        """
        timings: list[tuple[str, float]] = []
        clock = time.perf_counter()

        def lap(stage: str) -> None:
            nonlocal clock
            moment = time.perf_counter()
            timings.append((stage, moment - clock))
            clock = moment

        jobs = self._admit(frames, joints, now)
        evidence = self._judge(jobs)
        lap("images")
        self._move_body(jobs)
        for job, seen in sorted(zip(jobs, evidence), key=lambda pair: pair[0].frame.stamp):
            self._take(job, seen)
        alive = np.array([h.alive(now) for h in self._health], np.uint8)
        state = self._occupancy.state(alive)
        state.flags.writeable = False
        lap("occupancy")
        distance = self._field.update(state)
        lap("field")
        hazards, unknown = self._hazards(state, now)
        lap("hazards")
        last = self._occupancy.last_occupied()
        cloud = self.grid.center(self._triples(self._occupancy.dynamic)).astype(np.float32)
        for array in (hazards, unknown, last, cloud):
            array.flags.writeable = False
        lap("publish")
        self._now = now
        self._sequence += 1
        stamps = [h.stamp for h in self._health]
        return WorkspaceSnapshot(
            sequence=self._sequence,
            stamp=max(stamps, default=-np.inf),
            oldest=min(stamps, default=-np.inf),
            grid=self.grid,
            state=state,
            distance=distance,
            distance_cap=self._field.cap,
            last_occupied=last,
            hazards=hazards,
            hazard_radius=0.5 * np.sqrt(3.0) * self.grid.voxel,
            hazard_unknown=unknown,
            cloud=cloud,
            cameras=tuple(h.status(now) for h in self._health),
            timings=tuple(timings),
            distance_counts_unknown=self.config.unknown_is_solid,
        )

    def _admit(self, frames: Sequence[RgbdFrame], joints: JointHistory, now: float) -> list[_Job]:
        """The newest usable frame of each camera, with arm and camera at its exposure."""
        jobs: dict[int, _Job] = {}
        for frame in sorted(frames, key=lambda f: f.stamp if np.isfinite(f.stamp) else np.inf):
            camera = self._index.get(frame.camera)
            if camera is None:
                continue  # not a camera of this cell
            health = self._health[camera]
            if not health.admit(frame, now):
                continue
            state = joints.at(frame.stamp)
            if state is None or not np.isfinite(state.position).all():
                health.refuse("no joint reading at its exposure")
                continue
            if camera in jobs:
                health.refuse("a newer frame came with it")
            body = self._filter.pose(state.position, state.velocity)
            jobs[camera] = _Job(
                camera, frame, self._camera_pose(camera, frame, state.position), body
            )
        return list(jobs.values())

    def _camera_pose(self, camera: int, frame: RgbdFrame, position: np.ndarray) -> Pose:
        info = self._infos[camera]
        if frame.T_base_camera is not None:
            return frame.T_base_camera
        if info.mounted_on == "flange":
            return np.asarray(flange_pose(self.robot, position) @ info.T_mount_camera)
        return info.T_mount_camera

    def _judge(self, jobs: list[_Job]) -> list[Evidence]:
        def work(job: _Job) -> Evidence:
            free = self._occupancy.free[job.camera]
            return self._stages[job.camera].process(
                job.frame.depth, job.T_base_camera, job.body, free
            )

        if self._pool is None or len(jobs) < 2:
            return [work(job) for job in jobs]
        return list(self._pool.map(work, jobs))

    def _take(self, job: _Job, seen: Evidence) -> None:
        health = self._health[job.camera]
        if seen.returns < self.config.min_returns:
            health.refuse(f"only {seen.returns:.2%} of its pixels have a return")
            return
        health.accept(job.frame)
        self._occupancy.take(
            job.camera,
            job.frame.stamp,
            seen.hits,
            seen.strong,
            seen.count,
            self._body_deep.reshape(-1),
        )

    def _move_body(self, jobs: list[_Job]) -> None:
        """Mark the arm's newest place: near it nobody hides unseen; deep in it nothing else is."""
        if not jobs:
            return
        newest = max(jobs, key=lambda job: job.frame.stamp).body
        near = self.grid.voxel + self.config.self_margin
        deep = -0.5 * np.sqrt(3.0) * self.grid.voxel - self.config.self_margin
        for value, body in ((0, self._body), (1, newest)):
            if body is not None:
                self._filter.mark(self._body_near, self.grid, body, near, value)
                self._filter.mark(self._body_deep, self.grid, body, deep, value)
        self._body = newest

    def _hazards(self, state: np.ndarray, now: float) -> tuple[Floats32, np.ndarray]:
        dynamic = self._occupancy.dynamic
        elapsed = now - self._now if np.isfinite(self._now) else 0.0
        unseen = self._unseen.update(state, dynamic, self._body_near, elapsed)
        unseen = unseen[self._occupancy.occupied[unseen] == 0]
        indices = np.concatenate([dynamic, unseen])
        points = self.grid.center(self._triples(indices)).astype(np.float32)
        unknown = np.zeros(len(indices), bool)
        unknown[len(dynamic) :] = True
        return points, unknown

    def _triples(self, flat: Ints32) -> Ints:
        return np.stack(np.unravel_index(flat, self.grid.shape), axis=1)

    def close(self) -> None:
        """End the worker threads."""
        if self._pool is not None:
            self._pool.shutdown()
