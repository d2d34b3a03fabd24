"""The workspace map: from depth frames and joint readings to an immutable snapshot."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Bytes, Floats32, Ints, Ints32, Mask, Pose
from armsight.devices.data import DeclaredSolids as Word
from armsight.devices.data import RgbdCameraInfo, RgbdFrame
from armsight.devices.history import JointHistory
from armsight.errors import UsageError
from armsight.geometry.shapes import Solid
from armsight.mapping.camera_stage import CameraStage, Evidence
from armsight.mapping.config import MappingConfig
from armsight.mapping.declared import Change, DeclaredSolids
from armsight.mapping.distance_field import DistanceField
from armsight.mapping.hazards import Tracked, UnseenPeople
from armsight.mapping.health import CameraHealth
from armsight.mapping.kernels.flood import face_points
from armsight.mapping.layers import far_grid, fine_grid
from armsight.mapping.occupancy import Occupancy
from armsight.mapping.self_filter import BodyPose, SelfFilter
from armsight.mapping.snapshot import (
    FREE,
    UNKNOWN,
    CameraCorrection,
    CameraStatus,
    Emptiness,
    WorkspaceSnapshot,
)
from armsight.mapping.static_geometry import StaticGeometry
from armsight.mapping.things import PATIENCE, TOUCHES, Things
from armsight.mapping.tracked import TrackedRegion, TrackedThing
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


class _Layer:
    """One grid with its evidence and the people who may hide in it."""

    def __init__(
        self, static: StaticGeometry, cameras: int, config: MappingConfig, around: _Layer | None
    ) -> None:
        self.grid = static.grid
        self.occupancy = Occupancy(
            static.grid, cameras, static.filled, config.hold, config.weak_window
        )
        self.things = Things(static.grid, TOUCHES if around is not None else 1)
        self.unseen: UnseenPeople = UnseenPeople(
            static.grid,
            static.filled,
            config.person_speed,
            config.hand,
            None if around is None else around.unseen,
        )


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
        self.config = config = config or MappingConfig()
        self.robot = robot
        names = [c.name for c in cameras]
        if len(set(names)) != len(names):
            raise UsageError(f"cameras need names of their own, found {sorted(names)}")
        if len(names) > MAX_CAMERAS:
            raise UsageError(f"{len(names)} depth cameras; the map can tell {MAX_CAMERAS} apart")
        self.grid = fine_grid(config)
        self._declared = DeclaredSolids(static, (self.grid, far_grid(config, self.grid)))
        solids, far_solids = self._declared.layers
        self._far = _Layer(far_solids, len(names), config, None)
        around = self._far if config.has_far_layer else None
        self._fine = _Layer(solids, len(names), config, around)
        self._filter = SelfFilter(robot)
        self._index = {name: i for i, name in enumerate(names)}
        self._infos = tuple(cameras)
        self._stages = [CameraStage(c, (solids, far_solids), self._filter, config) for c in cameras]
        self._health = [CameraHealth(c, config) for c in cameras]
        self._field = DistanceField(
            self.grid.shape, self.grid.voxel, config.distance_cap, config.unknown_is_solid
        )
        self._body_near = np.zeros(self.grid.shape, np.uint8)
        self._body_deep = np.zeros(self.grid.shape, np.uint8)
        self._no_body = np.zeros(int(np.prod(self._far.grid.shape)), np.uint8)
        self._points: Floats32 = np.zeros((int(np.prod(self._far.grid.shape)), 3), np.float32)
        self._body_voxels = np.zeros(self._body_near.size, np.int32)
        self._body_count = 0
        self._now = -np.inf
        self._alive = np.zeros(len(names), np.uint8)
        self._snapshot: WorkspaceSnapshot | None = None
        self._sequence = -1
        self._emptiness = Emptiness()
        self._waiting_until = np.inf
        self._solid_things: Floats32 = np.empty((0, 3), np.float32)
        self._tracked = TrackedThing(self.grid)
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
        """
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
        jobs = self._admit(frames, joints, now)
        alive = self._living(now)
        if not jobs and not self._declared.watched and self._nothing_new(alive, now):
            return self._again(now)
        evidence = self._judge(jobs)
        lap("images")
        for job, seen in sorted(zip(jobs, evidence), key=lambda pair: pair[0].frame.stamp):
            self._take(job, seen)
        alive = self._living(now)
        if self._declared.watched:
            looked = [(j, e) for j, e in zip(jobs, evidence) if e.hits]
            seen_by = [(j.camera, j.frame.camera, e.through) for j, e in looked]
            self._redeclare(self._declared.judge(now, seen_by, np.flatnonzero(alive).tolist()))
        self._alive = alive
        state = self._state(self._fine, alive)
        lap("occupancy")
        hazards, unknown = self._hazards(state, alive, now, tracked)
        # Before the field: space that hides nobody, such as the arm's own, is not solid.
        self._fine.unseen.mark_enclosed(state)
        self._fine.things.keep(state)
        lap("hazards")
        distance, last, cloud = self._field_and_cloud(state)
        lap("field and cloud")
        things = self._solid_things
        for array in (state, hazards, unknown, last, cloud, things):
            array.flags.writeable = False
        self._now = now
        self._sequence += 1
        stamps = [h.stamp for h in self._health]
        self._snapshot = WorkspaceSnapshot(
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
            cameras=self._statuses(now),
            timings=tuple(timings),
            distance_counts_unknown=self.config.unknown_is_solid,
            things=things,
            emptiness=self._emptiness,
            declared=self._declared.told,
            corrections=tuple(
                CameraCorrection(info.name, stage.mounting.T_old_new, stage.mounting.gain)
                for info, stage in zip(self._infos, self._stages)
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
        rows = zip((self._fine, self._far), change.layers, change.filled, change.left)
        for layer, static, filled, left in rows:
            layer.occupancy.redeclare(static.filled, filled)
            layer.unseen.redeclare(static.filled, left)
        for stage in self._stages:
            stage.redeclare(change.layers)

    def declare_empty(self) -> None:
        """Somebody says that nobody is in the cell: what stands there now is no person.

        Taken by an update in which all cameras are alive and nothing has moved for a second;
        ``snapshot.emptiness`` says what became of it. Safe from any thread.
        """
        self._emptiness = Emptiness(waiting=True, reason="looking whether the cell is at rest")
        self._waiting_until = np.inf

    def _take_word(self, alive: Bytes, now: float) -> None:
        """Whether the word that the cell is empty can be believed."""
        if np.isinf(self._waiting_until):
            self._waiting_until = now + PATIENCE
        why = "" if alive.all() else "not all cameras give pictures"
        for layer in (self._fine, self._far):
            seen = layer.occupancy
            at = -1 if why else layer.things.moving(seen.clusters(2), seen.occupied, now)
            if at >= 0:
                place = layer.grid.center(np.array([np.unravel_index(at, layer.grid.shape)]))[0]
                x, y, z = place
                why = f"something moves near ({x:.2f}, {y:.2f}, {z:.2f}) m"
        if why:
            over = now > self._waiting_until
            words = f"the cell is not taken for empty: {why}" if over else why
            self._emptiness = Emptiness(waiting=not over, reason=words)
            return
        for layer in (self._fine, self._far):
            layer.things.begin(layer.occupancy.dynamic, layer.occupancy.occupied, now)
            layer.unseen.nobody()
        self._emptiness = Emptiness(said=True)

    def _state(self, layer: _Layer, alive: Bytes) -> Bytes:
        """What is free, occupied and unknown by the word of the living cameras."""
        state = layer.occupancy.state(alive)
        if self.config.unseen_is_empty:
            state[state == UNKNOWN] = FREE
        return state

    def _turn_back(self, seconds: float) -> None:
        """The clock was turned back: begin anew, but keep what was seen occupied until seen gone.

        Every frame so far is of a time that is still to come, so none says what is free now.
        """
        for health in self._health:
            health.restart(f"the clock was turned back by {seconds:.2f} s")
        for stage in self._stages:
            stage.mounting.restart()
        for layer in (self._fine, self._far):
            layer.occupancy.turn_back(seconds)
            layer.things.end()
        if self._emptiness.said:
            self._emptiness = Emptiness(reason="the clock was turned back; say it again")

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
            pose = self._camera_pose(camera, frame, state.position)
            jobs[camera] = _Job(camera, frame, pose, body)
        return list(jobs.values())

    def _camera_pose(self, camera: int, frame: RgbdFrame, position: np.ndarray) -> Pose:
        info = self._infos[camera]
        if frame.T_base_camera is not None:
            return frame.T_base_camera
        if info.mounted_on == "flange":
            return np.asarray(flange_pose(self.robot, position) @ info.T_mount_camera)
        return info.T_mount_camera

    def _judge(self, jobs: list[_Job]) -> list[Evidence]:
        """What the frames say, and the arm's newest place."""
        watched = self._declared.watched

        def work(job: _Job, beside: Executor | None = None) -> Evidence:
            free = (
                self._fine.occupancy.free[job.camera],
                self._far.occupancy.free[job.camera],
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
            (self._fine, self._far), seen.hits, (self._body_deep.reshape(-1), self._no_body)
        ):
            layer.occupancy.take(
                job.camera, job.frame.stamp, hits.index, hits.strong, body, seen.sight
            )

    def _move_body(self, jobs: list[_Job]) -> None:
        """Mark the arm's newest place: near it nobody hides unseen; deep in it nothing else is."""
        if not jobs:
            return
        newest = max(jobs, key=lambda job: job.frame.stamp).body
        near = self.grid.voxel + self.config.self_margin
        deep = -0.5 * np.sqrt(3.0) * self.grid.voxel - self.config.self_margin
        for mask in (self._body_near, self._body_deep):
            mask.reshape(-1)[self._body_voxels[: self._body_count]] = 0
        self._body_count = self._filter.mark(
            self.grid, newest, (near, deep), self._body_near, self._body_deep, self._body_voxels
        )

    def _field_and_cloud(self, state: Bytes) -> tuple[Floats32, Floats32, Floats32]:
        """The distance field, the ages, and the cloud: three that do not need each other."""
        field = None if self._pool is None else self._pool.submit(self._field.update, state)
        last = self._fine.occupancy.last_occupied()
        cloud = self._centers(self._fine.occupancy.dynamic)
        cloud = cloud[np.linalg.norm(cloud, axis=1) <= self.config.crop]
        distance = self._field.update(state) if field is None else field.result()
        return distance, last, cloud

    def _hazards(
        self, state: Bytes, alive: Bytes, now: float, region: TrackedRegion | None
    ) -> tuple[Floats32, Mask]:
        """Where people are or could be: centres of fine voxels, and which are unseen."""
        elapsed = now - self._now if np.isfinite(self._now) else 0.0
        fine, far = self._fine, self._far
        if self._emptiness.waiting:
            self._take_word(alive, now)
        parts: list[tuple[Floats32, bool]] = []
        if self.config.has_far_layer:
            parts = self._far_hazards(self._state(far, alive), elapsed, now)
        seen = self._people(fine, state, fine.occupancy.clusters(self.config.cluster), now)
        self._solid_things = self._centers(fine.things.solid(fine.occupancy.dynamic))
        stamp = max((h.stamp for h in self._health), default=-np.inf)
        tracked = None
        if self._tracked.follow(region, stamp, now):
            tracked = Tracked(self._tracked, fine.occupancy.occupied)
        unseen, _ = fine.unseen.update(state, seen, self._body_near, elapsed, tracked)
        unseen = unseen[fine.occupancy.occupied[unseen] == 0]
        parts.append((self._centers(seen), False))
        parts.append((self._centers(unseen), True))
        points = np.concatenate([p for p, _ in parts])
        unknown = np.concatenate([np.full(len(p), u) for p, u in parts])
        return points, unknown

    def _people(self, layer: _Layer, state: Bytes, clusters: Ints32, now: float) -> Ints32:
        """Those clusters that are not known to be things."""
        seen = layer.occupancy
        may = layer.things.update(
            state, seen.dynamic, clusters, seen.occupied, layer.unseen.sets, now
        )
        return clusters[may]

    def _far_hazards(self, state: Bytes, elapsed: float, now: float) -> list[tuple[Floats32, bool]]:
        """The same of the coarse layer, outside the fine one, as faces of fine voxels."""
        far = self._far
        shape = np.asarray(far.grid.shape)
        parts = self.config.far_parts
        dynamic = self._people(far, state, far.occupancy.clusters(self.config.far_cluster), now)
        index, faces = far.unseen.update(state, dynamic, None, elapsed)
        far.unseen.mark_enclosed(state)
        far.things.keep(state)
        seen = far.occupancy.occupied[index] != 0
        whole = np.full(len(dynamic), 63, np.uint8)
        lower = np.asarray(self.grid.origin, float)
        upper = lower + np.asarray(self.grid.shape) * self.grid.voxel
        out = []
        for cells, open_faces, unseen in (
            (dynamic, whole, False),
            (index[~seen], faces[~seen], True),
        ):
            count = face_points(
                cells,
                open_faces,
                len(cells),
                np.asarray(far.grid.origin, float),
                far.grid.voxel,
                shape,
                parts,
                lower,
                upper,
                self._points,
            )
            out.append((self._points[:count].copy(), unseen))
        return out

    def _centers(self, flat: Ints32) -> Floats32:
        return self.grid.center(self._triples(flat)).astype(np.float32)

    def _triples(self, flat: Ints32) -> Ints:
        return np.stack(np.unravel_index(flat, self.grid.shape), axis=1)

    def close(self) -> None:
        """End the worker threads."""
        if self._pool is not None:
            self._pool.shutdown()
