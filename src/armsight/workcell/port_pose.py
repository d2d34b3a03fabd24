"""Where a port is that somebody has written down by place, direction and lean."""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import Pose
from armsight.geometry.pose import make_pose


def port_pose(position: tuple[float, float, float], yaw_deg: float, lean_deg: float) -> Pose:
    """A port's frame in world: x right and y up for who looks at it, z towards who looks."""
    yaw, lean = math.radians(yaw_deg), math.radians(lean_deg)
    z = np.array([math.cos(yaw) * math.cos(lean), math.sin(yaw) * math.cos(lean), math.sin(lean)])
    x = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    return make_pose(np.column_stack([x, np.cross(z, x), z]), position)
