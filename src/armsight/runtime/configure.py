"""Turns a workcell's settings into the configuration of a session's parts."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from armsight.arrays import Pose, Vector3
from armsight.geometry.pose import inverse, transform
from armsight.mapping.config import MappingConfig
from armsight.motion.guard_config import GuardConfig
from armsight.motion.separation import Separation
from armsight.runtime.config import SessionConfig

if TYPE_CHECKING:
    from armsight.workcell import Workcell

REACH_MARGIN = 0.35
"""Without a box of its own, a cell is mapped this far beyond the robot's reach [m]."""
SIDEWAYS = (1.2, 1.2)
"""How far beyond the mapped box people are looked for, along x and y of the world [m]."""
LOWEST = 0.13
"""Nobody lies lower than this above the floor [m]; cameras cannot tell what is thinner from it."""

TALLEST = 2.7
"""Nobody who stands on the floor reaches higher [m], nor is longer to the finger (ISO 13857)."""
ARM = 0.85
"""Nobody's arm is longer [m] (ISO 13855)."""


def guard_config(workcell: Workcell, timing: SessionConfig | None = None) -> GuardConfig:
    """The guard's configuration: the arm's declared behaviour, and the file's ``[guard]``.

    Args:
        workcell: the cell.
        timing: of the session; its latencies count as reaction time.
    """
    robot, section = workcell.robot, workcell.guard
    timing = timing or SessionConfig()
    return GuardConfig(
        period=timing.guard_period,
        start_delay=robot.start_delay_ms / 1e3 + timing.guard_latency,
        compute_latency=timing.mapping_latency + timing.guard_latency,
        speed=robot.speed,
        acceleration=robot.acceleration,
        task_speed=section.speed,
        brake=section.brake,
        separation=Separation(
            person_speed=section.reaching_speed,
            intrusion=section.intrusion_mm / 1e3,
        ),
        reflex_distance=section.reflex_distance_mm / 1e3,
        stale_after=workcell.mapping.stale_after_ms / 1e3,
        up=_triple(robot.T_world_base[2, :3]),
        base_height=float(robot.T_world_base[2, 3]),
        head_height=section.head_height,
        thing_force=section.thing_force_n,
        hand_force=section.hand_force_n,
        soft=1e3 * section.soft_tip_n_per_mm,
    )


def mapped_box(workcell: Workcell, T_world_base: Pose, reach: float) -> tuple[Vector3, Vector3]:
    """Two corners of the mapped box in ``world`` [m]: the file's, or the robot's reach [m]."""
    lower, upper = workcell.mapping.lower, workcell.mapping.upper
    if lower is not None and upper is not None:
        return np.array(lower), np.array(upper)
    around = reach + REACH_MARGIN
    base = T_world_base[:3, 3]
    low, high = base - around, base + around
    if workcell.simulation.floor:
        low[2] = max(low[2], min(0.0, base[2] - 0.05))
    return low, high


def mapping_config(workcell: Workcell, T_world_base: Pose, reach: float) -> MappingConfig:
    """The map's configuration: the file's box in world becomes the box around it in base."""
    section = workcell.mapping
    low, high = mapped_box(workcell, T_world_base, reach)
    # Around the box, and under it down to the floor: who kneels beside a table can rise there.
    below = max(float(low[2]) - LOWEST, 0.0)
    far_low = low - np.array([*SIDEWAYS, below])
    far_high = high + np.array([*SIDEWAYS, 0.0])
    top = float(high[2])
    low, high = _in_base(low, high, T_world_base)
    far_low, far_high = _in_base(far_low, far_high, T_world_base)
    return MappingConfig(
        lower=_triple(low),
        upper=_triple(high),
        far_lower=_triple(low - far_low),
        far_upper=_triple(far_high - high),
        voxel=section.voxel,
        distance_cap=min(MappingConfig.distance_cap, 15 * section.voxel),
        stale_after=section.stale_after_ms / 1e3,
        calibration_m=section.calibration_mm / 1e3,
        calibration_rad=float(np.deg2rad(section.calibration_deg)),
        align=section.align,
        crop=section.crop,
        person_speed=workcell.guard.reaching_speed,
        reach=max(TALLEST - top, ARM) if top < TALLEST else 0.0,
        up=_triple(T_world_base[2, :3]),
        # The planner keeps out of unseen space; a field that counts it spares it a second one.
        unknown_is_solid=True,
    )


def _in_base(low: Vector3, high: Vector3, T_world_base: Pose) -> tuple[Vector3, Vector3]:
    """Corners in ``base`` of the box around a box of the world [m]."""
    corners = transform(inverse(T_world_base), np.array(list(itertools.product(*zip(low, high)))))
    return corners.min(axis=0), corners.max(axis=0)


def _triple(values: Vector3) -> tuple[float, float, float]:
    """Three numbers, rid of what rounding left of 0."""
    x, y, z = (round(float(v), 9) + 0.0 for v in values)
    return x, y, z
