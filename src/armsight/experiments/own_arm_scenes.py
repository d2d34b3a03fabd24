"""Scenes for the experiment on the own arm: cells with people in which an arm moves at random."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from armsight.arrays import Floats, JointVector, Pose
from armsight.devices.data import RgbdCameraInfo
from armsight.geometry.pose import exp, from_rpy, inverse
from armsight.geometry.shapes import Solid
from armsight.recognition.own_arm.answer import ColorView, DepthView
from armsight.robots.kinematics import sphere_centers
from armsight.robots.robot import Robot
from armsight.simulation.spec import PersonSpec
from armsight.simulation.world import SimulatedWorld
from armsight.workcell.load import load_workcell
from armsight.workcell.packaged import find
from armsight.workcell.simulated import world_spec

CELLS = ("ur5_four_cameras", "panda_table", "iiwa_circle", "ur3_bench", "ur10_inverted")
SCRIPTS = ("stand", "reach_in", "work", "walk_by", "wave")
TICK = 0.02
"""Seconds between commands [s]."""


@dataclass(frozen=True)
class ArmScene:
    """What a camera saw of a moving arm, and where it really stood.

    Attributes:
        cell, camera: names.
        robot: with its tool.
        info: what is known of the camera; its pose is that of the cell's file, which is not used.
        depth, color: views, one a second or so; color only where it was asked for.
        T_base_camera: the truth, for scoring: of the depth lens. T_base_color: of the colour lens.
    """

    cell: str
    camera: str
    robot: Robot
    info: RgbdCameraInfo
    depth: tuple[DepthView, ...]
    color: tuple[ColorView, ...]
    T_base_camera: Pose
    T_base_color: Pose


def arm_scene(
    seed: int, views: int, color: bool = False, people: int = 2, color_width: int = 640
) -> ArmScene:
    """One of the cells, one of its cameras, people in view, the arm on its way through the room.

    Everything that the simulation can get wrong is on: depth errors, calibration, stamps, the arm's
    geometry and repeatability.

    Args:
        seed: everything follows from it.
        views: how many pictures are taken.
        color: whether colour is taken with depth.
        people: who stand, reach and walk about, beside the cell's own.
        color_width: of the colour pictures [px].
    """
    rng = np.random.default_rng([seed, 17])
    cell = CELLS[int(rng.integers(len(CELLS)))]
    spec = world_spec(load_workcell(find(cell)))
    chosen = spec.cameras[int(rng.integers(len(spec.cameras)))]
    info = replace(chosen.info, rate=2.0)
    if color and info.color is not None:
        info = replace(info, color=info.color.scaled(color_width / info.color.width))
    camera = replace(chosen, info=info, declared=info, phase=0.01, stamp_jitter=0.002)
    crowd = tuple(_person(k, spec.arm.T_world_base, rng) for k in range(people))
    arm = replace(spec.arm, kinematic_error=1.0)
    spec = replace(spec, arm=arm, cameras=(camera,), people=(*spec.people, *crowd))
    robot = arm.robot
    T_base_world = inverse(arm.T_world_base)
    static = tuple(replace(s, T_frame_solid=T_base_world @ s.T_frame_solid) for s in spec.static)
    depth: list[DepthView] = []
    pictures: list[ColorView] = []
    with SimulatedWorld(spec, seed) as world:
        device = world.cameras[0]
        device.want_color(color)
        log: list[tuple[float, Floats]] = []
        while len(depth) < views:
            _move(world, robot, _goal(robot, static, rng), log)
            frame = device.read()
            if frame is None or (color and frame.color is None):
                continue
            stamps = np.array([t for t, _ in log])
            q = np.array([p for _, p in log])
            joints = np.array([np.interp(frame.stamp, stamps, q[:, i]) for i in range(robot.n)])
            depth.append(DepthView(joints, frame.depth))
            if frame.color is not None:
                pictures.append(ColorView(joints, frame.color))
        T = np.asarray(T_base_world @ device.T_mount_camera)
    return ArmScene(
        cell,
        info.name,
        robot,
        info,
        tuple(depth),
        tuple(pictures),
        T,
        np.asarray(T @ info.T_depth_color),
    )


def displaced(T: Pose, shift: float, turn: float, rng: np.random.Generator) -> Pose:
    """A pose that far off, in a random direction each [m], [rad]."""
    a, b = rng.standard_normal(3), rng.standard_normal(3)
    twist = np.concatenate([shift * a / np.linalg.norm(a), turn * b / np.linalg.norm(b)])
    return np.asarray(T @ exp(twist))


def placing_error(robot: Robot, T_true: Pose, T_found: Pose) -> float:
    """Root mean square error of where a camera places points of the arm's reach [m].

    Over the points of a ball of half the reach about the robot's shoulder: what the cell makes of
    the camera, and harder than the error on the arm alone.
    """
    points = _ball(robot.name) * 0.5 * robot.reach + np.array([0.0, 0.0, 0.3 * robot.reach])
    T = T_found @ inverse(T_true)
    moved = points @ T[:3, :3].T + T[:3, 3] - points
    return float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))


@cache
def _ball(name: str) -> Floats:
    rng = np.random.default_rng(0)
    p = rng.uniform(-1, 1, (2000, 3))
    return np.asarray(p[np.linalg.norm(p, axis=1) < 1.0])


def _goal(robot: Robot, static: tuple[Solid, ...], rng: np.random.Generator) -> JointVector:
    lower = np.maximum(robot.limits.lower, robot.home - 1.6)
    upper = np.minimum(robot.limits.upper, robot.home + 1.6)
    for _ in range(500):
        q = rng.uniform(lower, upper)
        if stands_free(robot, q, static):
            return np.asarray(q)
    return robot.home


def _move(
    world: SimulatedWorld, robot: Robot, goal: JointVector, log: list[tuple[float, Floats]]
) -> None:
    """A second and a half on the way to a goal, at up to half the arm's speed."""
    speed = 0.5 * robot.limits.velocity
    end = world.clock.now() + 1.5
    while world.clock.now() < end:
        world.advance(world.clock.now() + TICK)
        state = world.arm.read()
        if state is None:
            continue
        log.append((state.stamp, state.position))
        world.arm.command_velocity(np.clip(2.0 * (goal - state.position), -speed, speed))


def _person(number: int, T_world_base: Pose, rng: np.random.Generator) -> PersonSpec:
    bearing, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.8, 1.4)
    base = T_world_base[:3, 3]
    place = (base[0] + away * np.cos(bearing), base[1] + away * np.sin(bearing), 0.0)
    return PersonSpec(
        name=f"person{number}",
        motion="script",
        script=str(rng.choice(SCRIPTS)),
        T_world_person=from_rpy((0.0, 0.0, bearing + np.pi + rng.uniform(-0.6, 0.6)), place),
        start=0.0,
    )


def stands_free(
    robot: Robot, q: JointVector, static: tuple[Solid, ...], clearance: float = 0.03
) -> bool:
    """Whether no moving part is near a declared solid, the floor below the base or another part."""
    centers = sphere_centers(robot, q)
    link, radius = robot.spheres.link, robot.spheres.radius
    # The shoulder stands on the table; the elbow, where the forearm begins, guards the upper arm.
    moving = link >= 3
    for solid in static:
        if np.any(solid.distance(centers[moving]) < radius[moving] + clearance):
            return False
    for a, b in robot.self_pairs:
        i, j = np.flatnonzero(link == a), np.flatnonzero(link == b)
        if len(i) and len(j):
            gap = np.linalg.norm(centers[i][:, None] - centers[j][None], axis=-1)
            if np.any(gap < radius[i][:, None] + radius[j][None]):
                return False
    return True
