"""The workspace map: from depth frames and joint readings to an immutable snapshot."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from queue import SimpleQueue

import numpy as np

from armsight.arrays import Bytes, Floats32, Points, Pose
from armsight.devices.data import DeclaredSolids as Word
from armsight.devices.data import JointState, RgbdCameraInfo, RgbdFrame
from armsight.devices.history import JointHistory
from armsight.errors import UsageError
from armsight.geometry.pose import inverse, is_rotation
from armsight.geometry.shapes import Solid
from armsight.mapping.camera_stage import CameraStage, Evidence
from armsight.mapping.config import MappingConfig
from armsight.mapping.declared import Change, DeclaredSolids
from armsight.mapping.distance_field import DistanceField
from armsight.mapping.health import CameraHealth, check_camera
from armsight.mapping.intrusion import Intrusions
from armsight.mapping.layers import far_grid, fine_grid
from armsight.mapping.people import People
from armsight.mapping.self_filter import BodyPose, SelfFilter
from armsight.mapping.snapshot import (
    CameraCorrection,
    CameraStatus,
    WorkspaceSnapshot,
)
from armsight.mapping.tracked import TrackedRegion
from armsight.robots.kinematics import flange_pose
from armsight.robots.robot import Robot

MAX_CAMERAS = 8
QUIET = 0.05
"""Without frames the map is worked out anew this often only [s]."""


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
        UsageError: two cameras share a name, or there are too many, or one cannot be.
        ArmsightError: the arm has no shapes.
    """

    def __init__(
        self,
        robot: Robot,
        cameras: Sequence[RgbdCameraInfo],
        static: Sequence[Solid],
        config: MappingConfig | None = None,
    ) -> None:
        self.config = config = config or MappingConfig()
        self.robot = robot
        names = [c.name for c in cameras]
        if len(set(names)) != len(names):
            raise UsageError(f"cameras need names of their own, found {sorted(names)}")
        if len(names) > MAX_CAMERAS:
            raise UsageError(f"{len(names)} depth cameras; the map can tell {MAX_CAMERAS} apart")
        for info in cameras:
            check_camera(info)
        self.grid = fine_grid(config)
        self._declared = DeclaredSolids(static, (self.grid, far_grid(config, self.grid)))
        self._people = People(self._declared.layers, len(names), config)
        self._intrusions = Intrusions()
        self._filter = SelfFilter(robot)
        self._index = {name: i for i, name in enumerate(names)}
        self._infos = tuple(cameras)
        self._stages = [
            CameraStage(c, self._declared.layers, self._filter, config) for c in cameras
        ]
        self._health = [CameraHealth(c, config) for c in cameras]
        self._first = tuple(cameras)
        self._placed: SimpleQueue[RgbdCameraInfo] = SimpleQueue()
        self._lively: SimpleQueue[Points] = SimpleQueue()
        self._field = DistanceField(
            self.grid.shape, self.grid.voxel, config.distance_cap, config.unknown_is_solid
        )
        self._body_near = np.zeros(self.grid.shape, np.uint8)
        self._body_fills = np.zeros(self.grid.shape, np.uint8)
        self._no_body = np.zeros(int(np.prod(self._people.far.grid.shape)), np.uint8)
        self._body_voxels = np.zeros(self._body_near.size, np.int32)
        self._body_count = 0
        self._now = -np.inf
        self._alive = np.zeros(len(names), np.uint8)
        self._snapshot: WorkspaceSnapshot | None = None
        self._sequence = -1
        threads = max(config.threads, 1)
        self._pool = ThreadPoolExecutor(threads, "mapping") if threads > 1 else None

    def update(
        self,
        frames: Sequence[RgbdFrame],
        joints: JointHistory,
        now: float,
        tracked: TrackedRegion | None = None,
    ) -> WorkspaceSnapshot:
        """Take in new frames and publish what is known at ``now`` [s].

        ``tracked`` is where a task has the thing that it asks to touch (:mod:`.tracked`).

        Call it with no frames too, often enough that a dead camera's space becomes unknown.
        Frames that cannot be used are counted and named in ``snapshot.cameras``, never raised.
        A ``now`` that is no number changes nothing: by it no camera is alive.

        Raises:
            UsageError: the first ``now`` is no number.
        """
        if not np.isfinite(now):
            return self._timeless(frames, now)
        timings: list[tuple[str, float]] = []
        clock = time.perf_counter()

        def lap(stage: str) -> None:
            nonlocal clock
            moment = time.perf_counter()
            timings.append((stage, moment - clock))
            clock = moment

        if now < self._now - self.config.future:
            self._turn_back(self._now - now)
        self._redeclare(self._declared.begin(now, self._body_near))
        while not self._placed.empty():
            self._place(self._placed.get())
        while not self._lively.empty():
            self._people.animate(self._lively.get(), now)
        jobs = self._admit(frames, joints, now)
        alive = self._living(now)
        if not jobs and self._nothing_new(alive, now):
            return self._again(now)
        evidence = self._judge(jobs)
        lap("images")
        for job, seen in sorted(zip(jobs, evidence), key=lambda pair: pair[0].frame.stamp):
            self._take(job, seen)
        alive = self._living(now)
        if self._declared.watched:
            looked = [(j, e) for j, e in zip(jobs, evidence) if e.hits]
            seen_by = [(j.camera, j.frame.camera, e.through) for j, e in looked]
            # Where none lives nobody has looked: all have to.
            living = np.flatnonzero(alive).tolist() or list(range(len(alive)))
            self._redeclare(self._declared.judge(now, seen_by, living))
        self._alive = alive
        people = self._people
        state = people.state(people.fine, alive)
        lap("occupancy")
        stamps = [h.stamp for h in self._health] or [-np.inf]
        elapsed = now - self._now if np.isfinite(self._now) else 0.0
        times = (now, elapsed, max(stamps))
        hazards, unknown = people.update(state, self._body_near, alive, times, tracked)
        lap("hazards")
        distance, last, cloud = self._field_and_cloud(state)
        lap("field and cloud")
        things = people.things
        for array in (state, hazards, unknown, last, cloud, things):
            array.flags.writeable = False
        self._now = now
        self._sequence += 1
        self._snapshot = WorkspaceSnapshot(
            sequence=self._sequence,
            stamp=max(stamps),
            oldest=min(stamps),
            grid=self.grid,
            state=state,
            distance=distance,
            distance_cap=self._field.cap,
            last_occupied=last,
            hazards=hazards,
            hazard_radius=0.5 * np.sqrt(3.0) * self.grid.voxel,
            hazard_unknown=unknown,
            cloud=cloud,
            cameras=self._statuses(now),
            timings=tuple(timings),
            distance_counts_unknown=self.config.unknown_is_solid,
            things=things,
            emptiness=people.emptiness,
            declared=self._declared.told,
            inside=self._intrusions.update(now, (people.fine.occupancy, people.far.occupancy)),
            corrections=tuple(
                CameraCorrection(
                    info.name,
                    inverse(first.T_mount_camera) @ info.T_mount_camera @ stage.mounting.T_old_new,
                    stage.mounting.gain,
                )
                for first, info, stage in zip(self._first, self._infos, self._stages)
            ),
        )
        return self._snapshot

    def _living(self, now: float) -> Bytes:
        """(cameras,) uint8 whose word counts: those whose pictures come, and that stand still."""
        return np.array(
            [
                health.alive(now) and not stage.mounting.excluded
                for health, stage in zip(self._health, self._stages)
            ],
            np.uint8,
        )

    def declare(self, name: str, solids: Sequence[Solid]) -> None:
        """Somebody says that solids (in ``base``) stand in the cell from now on.

        ``snapshot.declared`` says what became of it. Safe from any thread.

        Raises:
            UsageError: the name is taken, a solid cannot be, or none of them is in the map.
        """
        self._declared.declare(name, solids)

    def withdraw(self, name: str) -> None:
        """Somebody says that they do not stand there any more. Safe from any thread.

        Raises:
            UsageError: nothing was declared by this name.
        """
        self._declared.withdraw(name)

    def told(self, word: Word) -> None:
        """Somebody's word of solids, as :meth:`declare` and :meth:`withdraw`.

        Raises:
            UsageError: see there.
        """
        if word.solids:
            self.declare(word.name, word.solids)
        else:
            self.withdraw(word.name)

    def _redeclare(self, change: Change | None) -> None:
        """Take over other solids."""
        if change is None:
            return
        self._people.redeclare(change)
        for stage in self._stages:
            stage.redeclare(change.layers)

    def declare_empty(self) -> None:
        """Somebody says that nobody is in the cell: what stands there now is no person.

        Taken by an update in which all cameras are alive and nothing has moved for a second;
        ``snapshot.emptiness`` says what became of it. Safe from any thread.
        """
        self._people.declare_empty()

    def _turn_back(self, seconds: float) -> None:
        """The clock was turned back: begin anew, but keep what was seen occupied until seen gone.

        Every frame so far is of a time that is still to come, so none says what is free now.
        """
        for health in self._health:
            health.restart(f"the clock was turned back by {seconds:.2f} s")
        for stage in self._stages:
            stage.mounting.restart()
        self._declared.turn_back(seconds)
        self._people.turn_back(seconds)
        self._intrusions.turn_back(seconds)

    def _nothing_new(self, alive: Bytes, now: float) -> bool:
        """Whether a round without frames would find what the last one found.

        People who may hide in unseen space go on moving, so not for long.
        """
        if not self._health and self._snapshot is not None and self.config.unseen_is_empty:
            return True
        return (
            self._snapshot is not None
            and bool((alive == self._alive).all())
            and 0.0 <= now - self._now < QUIET
        )

    def _again(self, now: float) -> WorkspaceSnapshot:
        """The last snapshot with the cameras' health as it is now."""
        assert self._snapshot is not None
        if not self._health:
            return self._snapshot
        return replace(self._snapshot, cameras=self._statuses(now))

    def _timeless(self, frames: Sequence[RgbdFrame], now: float) -> WorkspaceSnapshot:
        """The last snapshot, of which no camera is alive: the clock says no number."""
        if self._snapshot is None:
            raise UsageError(f"the map's clock says {now}; expected seconds")
        for frame in frames:
            if frame.camera in self._index:
                self._health[self._index[frame.camera]].refuse(f"the clock says {now}")
        return replace(self._snapshot, cameras=self._statuses(now))

    def _statuses(self, now: float) -> tuple[CameraStatus, ...]:
        return tuple(
            health.status(now, stage.mounting.excluded)
            for health, stage in zip(self._health, self._stages)
        )

    def exclude(self, camera: str, reason: str) -> None:
        """From now on nothing counts that a camera says: somebody knows that it was moved.

        Args:
            camera: its name; one that is not in the map changes nothing.
            reason: for the page and the guard, such as "was moved by about 8 mm".
        """
        if camera in self._index:
            self._stages[self._index[camera]].mounting.excluded = reason

    def animate(self, points: Points) -> None:
        """Somebody knows that what is at (k, 3) points in ``base`` [m] may move by itself.

        It counts as a person for a while, however still it is, and longer where that is said again.
        Safe from any thread; an update takes it.
        """
        self._lively.put(np.array(points, float))

    def place(self, info: RgbdCameraInfo) -> None:
        """A camera was calibrated again while the cell runs: it counts from now on, from there.

        Safe from any thread; an update takes it.

        Args:
            info: the camera with its new pose; one that is not in the map changes nothing.

        Raises:
            UsageError: its lens, range or noise cannot be.
        """
        if info.name in self._index:
            check_camera(info)
            self._placed.put(info)

    def _place(self, info: RgbdCameraInfo) -> None:
        k = self._index[info.name]
        self._infos = (*self._infos[:k], info, *self._infos[k + 1 :])
        self._stages[k] = CameraStage(info, self._declared.layers, self._filter, self.config)
        # What it saw free from its old place says nothing until its next picture.
        self._health[k].place(info)

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
            if state is None or not self._can_be(state):
                health.refuse("no joint reading at its exposure")
                continue
            pose = self._camera_pose(camera, frame, state.position)
            if pose is None:
                health.refuse("its camera's pose is no rotation and translation")
                continue
            if camera in jobs:
                health.refuse("a newer frame came with it")
            felt = joints.felt(frame.stamp)
            body = self._filter.pose(state.position, state.velocity, felt, frame.stamp)
            jobs[camera] = _Job(camera, frame, pose, body)
        return list(jobs.values())

    def _can_be(self, state: JointState) -> bool:
        """Whether a reading is finite numbers, one a joint."""
        said, n = (state.position, state.velocity), (self.robot.n,)
        return all(np.shape(v) == n and np.isfinite(v).all() for v in said)

    def _camera_pose(self, camera: int, frame: RgbdFrame, position: np.ndarray) -> Pose | None:
        """Where the camera was; None where that is no pose: it would free what nobody saw."""
        info = self._infos[camera]
        T = info.T_mount_camera if frame.T_base_camera is None else frame.T_base_camera
        if frame.T_base_camera is None and info.mounted_on == "flange":
            T = flange_pose(self.robot, position) @ info.T_mount_camera
        return _rigid(T)

    def _judge(self, jobs: list[_Job]) -> list[Evidence]:
        """What the frames say, and the arm's newest place."""
        watched = self._declared.watched

        def work(job: _Job, beside: Executor | None = None) -> Evidence:
            free = (
                self._people.fine.occupancy.free[job.camera],
                self._people.far.occupancy.free[job.camera],
            )
            return self._stages[job.camera].process(
                job.frame.depth,
                job.T_base_camera,
                job.body,
                free,
                job.frame.stamp,
                beside,
                watched,
            )

        if self._pool is None or len(jobs) < 2:
            self._move_body(jobs)
            return [work(job, self._pool) for job in jobs]
        seen = [self._pool.submit(work, job) for job in jobs]
        self._move_body(jobs)
        return [future.result() for future in seen]

    def _take(self, job: _Job, seen: Evidence) -> None:
        health = self._health[job.camera]
        if not seen.hits:
            mounting = self._stages[job.camera].mounting
            problem = mounting.excluded or mounting.problem or seen.problem
            health.refuse(problem or f"only {seen.returns:.2%} of its pixels have a return")
            return
        health.accept(job.frame, seen.warning)
        for layer, hits, body in zip(
            (self._people.fine, self._people.far),
            seen.hits,
            (self._body_fills.reshape(-1), self._no_body),
        ):
            layer.occupancy.take(
                job.camera, job.frame.stamp, hits.index, hits.strong, body, seen.sight
            )

    def _move_body(self, jobs: list[_Job]) -> None:
        """Mark the arm's newest place: near it nobody hides unseen, what it fills is the arm."""
        if not jobs:
            return
        newest = max(jobs, key=lambda job: job.frame.stamp).body
        skin, half = self.config.self_margin, float(0.5 * np.sqrt(3.0) * self.grid.voxel)
        limits = (self.grid.voxel + skin, skin, -half - skin)
        for mask in (self._body_near, self._body_fills):
            mask.reshape(-1)[self._body_voxels[: self._body_count]] = 0
        self._body_count = self._filter.mark(
            self.grid, newest, limits, self._body_near, self._body_fills, self._body_voxels
        )

    def _field_and_cloud(self, state: Bytes) -> tuple[Floats32, Floats32, Floats32]:
        """The distance field, the ages, and the cloud: three that do not need each other."""
        field = None if self._pool is None else self._pool.submit(self._field.update, state)
        last = self._people.fine.occupancy.last_occupied()
        cloud = self._people.centers(self._people.fine.occupancy.dynamic)
        x, y, z = cloud.T  # a norm of rows of three takes three times as long
        cloud = cloud[np.sqrt(x * x + y * y + z * z) <= self.config.crop]
        distance = self._field.update(state) if field is None else field.result()
        return distance, last, cloud

    def close(self) -> None:
        """End the worker threads."""
        if self._pool is not None:
            self._pool.shutdown()


def _rigid(T: Pose) -> Pose | None:
    """A pose as float64, or None where it is no rotation (to 1e-3) and translation."""
    found = np.asarray(T)
    if found.shape != (4, 4) or found.dtype.kind not in "fiu" or not np.isfinite(found).all():
        return None
    found = found.astype(float, copy=False)
    turns = is_rotation(found[:3, :3], 1e-3)
    return found if turns and np.array_equal(found[3], [0.0, 0.0, 0.0, 1.0]) else None
