"""Paths that keep away from people, so that separation does not stop the arm halfway.

The planner proves that a path touches nothing; separation then decides how fast it may be driven.
Close to somebody that is not at all. So several paths are planned: through the surroundings as they
are, and through surroundings in which everything that may be a person is larger, now and where
somebody was not long ago: whoever left may come back, and a path that passes there would be stopped
halfway (T2: the risk of an area is taken into account before the arm moves). The one that the law
would let the arm drive in the least time is chosen: the mean of the times with everybody where they
are now, and with the remembered places taken as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from armsight.arrays import JointVector
from armsight.devices.data import RgbdCameraInfo
from armsight.mapping.snapshot import FREE, OCCUPIED, WorkspaceSnapshot
from armsight.motion.data import PlanRequest
from armsight.motion.guard_config import GuardConfig
from armsight.motion.lid import Lid
from armsight.motion.nearest import Hazards
from armsight.motion.plan import Plan, Planner
from armsight.motion.separation_monitor import SeparationMonitor, declared_reaction
from armsight.motion.trajectory import Trajectory
from armsight.robots.robot import Robot

COARSE = 3
"""Fine voxels along the edge of a coarse one."""
SAMPLE = 0.1
"""Phase time between two looks at a motion when its time is predicted [s]."""
SLOWEST = 0.02
"""Speed scale that stands for "blocked" when a time is predicted."""


@dataclass(frozen=True)
class KeepOutConfig:
    """How far paths should keep from hazards.

    Attributes:
        distances: tried in this order, besides 0 [m].
        slack: start and goal may be this much closer to the enlarged hazards than to any [m].
        least: enlarging by less than this is not worth a plan [m].
        good: a path predicted to take no more than this multiple of its undisturbed time is taken
            without looking for a better one.
        memory: places that were occupied within this time are remembered [s]; 20 s is danger 0.8.
        returns: weight of the time with the remembered places taken, 0..1.
        lid: how far below the top of the mapped box paths keep, if start and goal do [m].
        stay: whoever is or comes in the way is not expected to hold the arm up for longer than
            this [s], or than it has been held up already: a short wait beats a long way round;
            but for who is touched by a permit, who does not go away.
        further: time limit of every plan but the first [s]; most: how many of those there are.
            Together they must fit into the latency that the session declares for planning.
    """

    distances: tuple[float, ...] = (0.5, 0.35)
    slack: float = 0.06
    least: float = 0.1
    good: float = 1.2
    memory: float = 20.0
    returns: float = 0.5
    lid: float = 0.2
    stay: float = 3.0
    further: float = 0.004
    most: int = 3


class SeparationPlanner:
    """Wraps a planner: asks it more than once and takes the path that can be driven soonest.

    Attributes:
        lid: the top of the mapped box, under which paths keep.
    """

    def __init__(
        self,
        planner: Planner,
        robot: Robot,
        cameras: Sequence[RgbdCameraInfo],
        guard: GuardConfig,
        config: KeepOutConfig | None = None,
    ) -> None:
        self._planner = planner
        self._config = config or KeepOutConfig()
        brake = robot.limits.acceleration * max(guard.brake, guard.acceleration)
        self._gate = SeparationMonitor(robot, guard, brake)
        self._reaction = declared_reaction(cameras, guard)
        self.lid = Lid(self._gate.body, guard.up, self._config.lid)

    def plan(
        self,
        request: PlanRequest,
        snapshot: WorkspaceSnapshot,
        time_limit: float,
        rng: np.random.Generator,
    ) -> Plan:
        """See :class:`~armsight.motion.plan.Planner`."""
        hazards = Hazards.of(snapshot)
        self._gate.set_reaction(self._reaction, hazards.radius)
        config = self._config
        snapshot = self.lid.over(snapshot, (request.start, request.target))
        best = self._planner.plan(request, snapshot, time_limit, rng)
        before = with_remembered(snapshot, config.memory)
        if best.trajectory is None or len(before.hazards) == 0:
            return best
        worse = hazards if before is snapshot else Hazards.of(before)

        best_time = self._expected(best.trajectory, request, hazards, worse)
        spent = best.optimisation_s
        further = min(time_limit, config.further)
        fields: dict[bool, NDArray[np.float64] | None] = {}
        tried: set[tuple[bool, float]] = set()
        for crowd, those, wanted in self._candidates(before, worse, snapshot, hazards):
            enough = best_time <= config.good * best.trajectory.duration
            if enough or len(tried) >= config.most:
                break
            ends = min(self._distance(q, those) for q in (request.start, request.target))
            distance = round(min(wanted, ends - config.slack), 3)
            key = (crowd is snapshot, distance)
            if distance < config.least or key in tried:
                continue
            tried.add(key)
            if key[0] not in fields:
                fields[key[0]] = to_hazards(crowd)
            larger = enlarged(crowd, distance, fields[key[0]])
            other = self._planner.plan(request, larger, further, rng)
            spent += other.planning_s + other.optimisation_s
            if other.trajectory is None:
                continue
            other_time = self._expected(other.trajectory, request, hazards, worse)
            if other_time < best_time:
                best, best_time = other, other_time
        return replace(best, optimisation_s=spent)

    def expected_time(
        self, trajectory: Trajectory, request: PlanRequest, snapshot: WorkspaceSnapshot
    ) -> float:
        """Seconds that a motion would take: the mean of now and with remembered places taken."""
        now = Hazards.of(snapshot)
        before = with_remembered(snapshot, self._config.memory)
        worse = now if before is snapshot else Hazards.of(before)
        return self._expected(trajectory, request, now, worse)

    def _expected(
        self, trajectory: Trajectory, request: PlanRequest, hazards: Hazards, worse: Hazards
    ) -> float:
        config = self._config
        # Who holds something out to be touched stays with it.
        waits = request.grant is not None and request.grant.person
        stay = np.inf if waits else max(config.stay, request.held)
        now = min(self.predicted_time(trajectory, hazards), trajectory.duration + stay)
        if worse is hazards:
            return now
        again = min(self.predicted_time(trajectory, worse), now + config.stay)
        return (1.0 - config.returns) * now + config.returns * again

    def _candidates(
        self,
        before: WorkspaceSnapshot,
        worse: Hazards,
        snapshot: WorkspaceSnapshot,
        hazards: Hazards,
    ) -> list[tuple[WorkspaceSnapshot, Hazards, float]]:
        """What to keep away from and how far: remembered places first."""
        distances = self._config.distances
        found = [(before, worse, d) for d in distances]
        if before is not snapshot:
            found += [(snapshot, hazards, d) for d in distances]
        return found

    def predicted_time(self, trajectory: Trajectory, hazards: Hazards) -> float:
        """Seconds that a motion takes under the law, if everybody stays where they are."""
        count = max(int(np.ceil(trajectory.duration / SAMPLE)), 1)
        step = trajectory.duration / count
        total = 0.0
        for k in range(count):
            t = (k + 0.5) * step
            view = self._gate.judge(trajectory.position(t), trajectory.velocity(t), hazards)
            total += step / min(max(view.allowed, SLOWEST), 1.0)
        return total

    def _distance(self, q: JointVector, hazards: Hazards) -> float:
        still = np.zeros(len(q))
        return self._gate.body.view(np.asarray(q, float), still, hazards, self._gate.law).least


def with_remembered(snapshot: WorkspaceSnapshot, memory: float) -> WorkspaceSnapshot:
    """The same surroundings, where places that were occupied within a time [s] are hazards too.

    The snapshot itself if there is none.
    """
    recent = snapshot.last_occupied > snapshot.stamp - memory
    recent &= snapshot.state == FREE
    index = np.argwhere(recent)
    if len(index) == 0:
        return snapshot
    places = np.asarray(snapshot.grid.center(index), np.float32)
    return replace(
        snapshot,
        hazards=np.concatenate([snapshot.hazards, places]),
        hazard_unknown=np.concatenate([snapshot.hazard_unknown, np.zeros(len(places), bool)]),
    )


def to_hazards(snapshot: WorkspaceSnapshot) -> NDArray[np.float64] | None:
    """Distance [m] of coarse voxels to the nearest one that holds a hazard, middle to middle.

    On a grid three times as coarse as the snapshot's; None when no voxel holds one.
    """
    grid = snapshot.grid
    edge = COARSE * grid.voxel
    shape = tuple(-(-n // COARSE) for n in grid.shape)
    seeds = np.zeros(shape, bool)
    index = np.floor((snapshot.hazards - grid.origin) / edge).astype(int)
    inside = np.all((index >= 0) & (index < shape), axis=1)
    seeds[tuple(index[inside].T)] = True
    return np.asarray(distance_transform_edt(~seeds, sampling=edge)) if seeds.any() else None


def enlarged(
    snapshot: WorkspaceSnapshot, distance: float, away: NDArray[np.float64] | None = None
) -> WorkspaceSnapshot:
    """The same surroundings with every hazard larger by a distance [m].

    Worked out on the coarse grid of :func:`to_hazards`, whose result may be given. The distance
    field stays a proven bound for the occupied voxels of the result; how far those reach is a
    preference and right within a coarse voxel.
    """
    away = to_hazards(snapshot) if away is None else away
    if away is None:
        return snapshot
    grid = snapshot.grid
    # What is within the distance of a hazard is no nearer than what the distance leaves of the
    # way to the hazard; any points of two voxels are nearer than their middles by one diagonal.
    bound = away - distance - np.sqrt(3.0) * COARSE * grid.voxel
    state = np.where(_fine(away <= distance, grid.shape), np.uint8(OCCUPIED), snapshot.state)
    field = _fine(np.maximum(bound, 0.0).astype(np.float32), grid.shape)
    return replace(snapshot, state=state, distance=np.minimum(snapshot.distance, field))


def _fine(coarse: NDArray[Any], shape: tuple[int, int, int]) -> NDArray[Any]:
    fine = coarse
    for axis in range(3):
        fine = np.repeat(fine, COARSE, axis=axis)
    return fine[: shape[0], : shape[1], : shape[2]]
