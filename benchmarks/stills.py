"""Stills of a simulated cell for the mapping benchmark: an arm set to a pose, a ball beside it.

Pictures carry the sensor's errors and, for scoring only, the truth of which pixel shows the arm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armsight.devices.data import JointState, RgbdFrame
from armsight.devices.history import JointHistory
from armsight.geometry.pose import inverse, make_pose, transform
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import OCCUPIED
from armsight.mapping.workspace_map import WorkspaceMap
from armsight.robots.kinematics import link_poses
from armsight.runtime.configure import mapping_config
from armsight.simulation.gl import mujoco
from armsight.simulation.sensor_errors import DepthSensor
from armsight.simulation.spec import MovingObjectSpec
from armsight.simulation.world import SimulatedWorld
from armsight.workcell import load_workcell, open_cell
from armsight.workcell.packaged import packaged

BALL = 0.05
"""Radius of the ball [m]."""
GAP = 0.03
"""Its distance from the arm's convex hulls [m]; from the arm itself it is no less."""
CALIBRATION = (0.005, np.deg2rad(0.5))
"""Standard deviations of the cameras' pose errors [m], [rad]."""
AWAY = np.array([50.0, 0.0, 0.0])
"""Where the reference map has no arm [m]."""
FRAME = 1.0 / 15.0
NOWHERE = np.array([0.0, 0.0, -30.0])


@dataclass(frozen=True)
class Still:
    """What one camera gave at one exposure: the frame, and which pixels truly show the arm."""

    frame: RgbdFrame
    arm: np.ndarray


class Stills:
    """A packaged cell without people, whose arm and ball are put where they are wanted."""

    def __init__(self, name: str, seed: int) -> None:
        workcell = load_workcell(packaged()[name])
        with open_cell(workcell) as cell:
            self.robot, self.static = cell.robot, cell.static
            self.T_world_base = cell.T_world_base
            self.config = mapping_config(workcell, cell.T_world_base, cell.robot.reach)
            spec = cell.world.spec
        ball = Solid("ball", "sphere", (BALL, 0.0, 0.0), make_pose(None, NOWHERE))
        cameras = tuple(replace(c, pose_error=CALIBRATION, stamp_jitter=0.0) for c in spec.cameras)
        spec = replace(spec, cameras=cameras, people=(), objects=(MovingObjectSpec(ball),))
        self.world = SimulatedWorld(spec, seed)
        self.cameras = self.world.cameras
        self.infos = [c.info for c in self.cameras]
        model = self.world._cell
        self._arm = np.array([p.kind == "arm" for p in model.parts] + [False])
        self._arm_geoms = [i for i, p in enumerate(model.parts) if p.kind == "arm" and p.link > 0]
        self._ball = next(i for i, p in enumerate(model.parts) if p.kind == "object")
        self._sensors = [
            DepthSensor(c.info, model.materials, (seed, 50 + i), systematic=0.15)
            for i, c in enumerate(self.cameras)
        ]
        self._count = 0

    def poses(self, count: int, rng: np.random.Generator) -> list[np.ndarray]:
        """Random joint positions with the whole arm in the mapped box, clear of the table."""
        found: list[np.ndarray] = []
        limits, robot = self.robot.limits, self.robot
        low, high = np.asarray(self.config.lower), np.asarray(self.config.upper)
        low[2] = 0.06
        moving = robot.spheres.link > 2
        while len(found) < count:
            q = rng.uniform(np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi))
            T = link_poses(robot, q)[robot.spheres.link[moving]]
            p = np.einsum("nij,nj->ni", T[:, :3, :3], robot.spheres.center[moving]) + T[:, :3, 3]
            if (p > low).all() and (p < high).all():
                found.append(q)
        return found

    def put(self, q: np.ndarray, ball: np.ndarray = NOWHERE) -> None:
        """Set the arm, and the ball's centre in world [m]."""
        data = self.world._data
        data.qpos[: len(q)] = q
        data.mocap_pos[self.world._cell.movers.leaders["ball"]] = ball
        self.world._followers.reset(data)
        self.world._settle()

    def ball_beside(self, q: np.ndarray, rng: np.random.Generator) -> np.ndarray | None:
        """A place for the ball 30 to 33 mm from the arm, inside the box; None if the way is bad."""
        spheres = self.robot.spheres
        one = rng.choice(np.flatnonzero(spheres.link > 0))
        start = transform(link_poses(self.robot, q)[spheres.link[one]], spheres.center[one][None])
        way = rng.standard_normal(3)
        way /= np.linalg.norm(way)
        for reach in np.arange(0.05, 0.6, 0.003):
            place = start[0] + reach * way
            world = transform(self.T_world_base, place[None])[0]
            self.put(q, world)
            if GAP <= self.gap() <= GAP + 0.003:
                low, high = np.asarray(self.config.lower), np.asarray(self.config.upper)
                inside = (place - 0.07 > low).all() and (place + 0.07 < high).all()
                return world if inside and place[2] > 0.12 else None
        return None

    def gap(self) -> float:
        """True distance between the arm and the ball [m]."""
        model, data = self.world._cell.model, self.world._data
        far = 0.5
        return min(
            mujoco.mj_geomDistance(model, data, g, self._ball, far, None) for g in self._arm_geoms
        )

    def expose(self, stamp: float) -> list[Still]:
        """A frame of every camera, now."""
        stills = []
        for camera, sensor in zip(self.cameras, self._sensors):
            shot = self.world.renderer.take(
                self.world._data, camera.T_mount_camera, camera.info.depth
            )
            seen = self.world.renderer.depth(shot, camera.info.depth)
            depth = sensor.measure(seen, self._count, stamp).copy()
            arm = self._arm[seen.geom].copy()
            self.world.renderer.give_back(shot)
            stills.append(Still(RgbdFrame(camera.info.name, self._count, stamp, stamp, depth), arm))
        self._count += 1
        return stills


def history(q: np.ndarray, velocity: np.ndarray, stamp: float) -> JointHistory:
    """Joints that pass ``q`` at a time with a constant velocity."""
    made = JointHistory()
    for step in np.arange(-0.2, 1.0, 0.02):
        made.add(JointState(stamp + step, q + step * velocity, velocity))
    return made


def seen_in(still: Still, info, mounting, grid, state) -> np.ndarray:
    """Of the pixels that truly show the arm and have a return: which lie in a voxel of a state."""
    near, far = info.range
    depth = still.frame.depth
    with np.errstate(invalid="ignore"):
        good = still.arm & (depth >= near) & (depth <= far)
    points = info.depth.deproject(depth * np.float32(mounting.gain))[good]
    index = grid.index(transform(info.T_mount_camera @ mounting.T_old_new, points))
    inside = ((index >= 0) & (index < grid.shape)).all(axis=1)
    return state[tuple(index[inside].T)]


def robot_left(stills: Stills, poses, rng, speed: float, jitter: float) -> tuple[int, int, float]:
    """Pixels of the arm that the map took for an obstacle, pixels of the arm, voxels a pose.

    The arm is alone. At each pose every camera gives two frames; the map is asked after the second.
    Its first frames, ten of each camera, align the cameras at the first pose.

    Joints move at ``speed``, a share of their limits, while exposed; a stamp errs by up to
    ``jitter`` [s].
    """
    world = WorkspaceMap(stills.robot, stills.infos, stills.static, stills.config)
    still_joints = np.zeros(stills.robot.n)
    solid = world.update([], JointHistory(), 0.0).state == OCCUPIED
    left = count = voxels = 0
    now = 0.0
    for number, q in enumerate([poses[0], *poses]):
        velocity = still_joints
        if number > 0 and speed > 0:
            velocity = (
                speed * rng.choice([-1.0, 1.0], stills.robot.n) * stills.robot.limits.velocity
            )
        rounds = 10 if number == 0 else 2
        now += 1.0
        for k in range(rounds):
            at = now + k * FRAME
            joints = history(q, velocity, now)
            stills.put(joints.at(at).position)
            shots = stills.expose(at)
            error = rng.uniform(-jitter, jitter) if number > 0 else 0.0
            frames = [replace(s.frame, stamp=at + error) for s in shots]
            snapshot = world.update(frames, joints, at + error + 0.001)
        if number == 0:
            continue
        found = (snapshot.state == OCCUPIED) & ~solid
        voxels += int(found.sum())
        for shot, info, stage in zip(shots, stills.infos, world._stages):
            hit = seen_in(shot, info, stage.mounting, snapshot.grid, found)
            left, count = left + int(hit.sum()), count + len(hit)
    world.close()
    return left, count, voxels / len(poses)


def obstacle_lost(stills: Stills, poses, rng) -> tuple[int, int, int]:
    """Voxels of a ball 3 cm from the arm that the self-filter took away, all its voxels, balls.

    All means: in a map that is given the same pictures without the arm's pixels, with the same
    cameras where the map under test found them, and whose own arm stands 50 m away.
    """
    world = WorkspaceMap(stills.robot, stills.infos, stills.static, stills.config)
    now, lost, count, balls = 0.0, 0, 0, 0
    rest = np.zeros(stills.robot.n)
    for number, q in enumerate([poses[0], *poses]):
        ball = stills.ball_beside(q, rng)
        if number > 0 and ball is None:
            continue
        stills.put(q, NOWHERE if number == 0 else ball)
        now += 1.0
        shots = []
        for k in range(10 if number == 0 else 2):
            at = now + k * FRAME
            shots.append(stills.expose(at))
            snapshot = world.update([s.frame for s in shots[-1]], history(q, rest, at), at + 0.001)
        if number == 0:
            continue
        other = reference(stills, world, shots, q)
        center = transform(inverse(stills.T_world_base), ball[None])[0]
        cells = np.argwhere(other.state == OCCUPIED)
        shell = np.linalg.norm(other.grid.center(cells) - AWAY - center, axis=1) - BALL
        cells = cells[np.abs(shell) < 0.03]
        lost += int((snapshot.state[tuple(cells.T)] != OCCUPIED).sum())
        count, balls = count + len(cells), balls + 1
    world.close()
    return lost, count, balls


def reference(stills: Stills, world: WorkspaceMap, shots: list[list[Still]], q: np.ndarray):
    """The snapshot of a map without an arm; see :func:`obstacle_lost`."""
    config = stills.config
    moved = replace(
        config,
        lower=tuple(np.asarray(config.lower) + AWAY),
        upper=tuple(np.asarray(config.upper) + AWAY),
        align=False,
        calibration_m=config.aligned_m,
        calibration_rad=config.aligned_rad,
    )
    away = make_pose(None, AWAY)
    static = [replace(s, T_frame_solid=away @ s.T_frame_solid) for s in stills.static]
    other = WorkspaceMap(stills.robot, stills.infos, static, moved)
    for shot in shots:
        frames = []
        for still, info, stage in zip(shot, stills.infos, world._stages):
            depth = still.frame.depth * np.float32(stage.mounting.gain)
            depth[still.arm] = np.nan
            T = away @ info.T_mount_camera @ stage.mounting.T_old_new
            frames.append(replace(still.frame, depth=depth, T_base_camera=T))
        stamp = shot[0].frame.stamp
        snapshot = other.update(frames, history(q, np.zeros_like(q), stamp), stamp + 0.001)
    other.close()
    return snapshot
