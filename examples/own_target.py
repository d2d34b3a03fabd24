"""Servo to a target of one's own: a detector, a docking, and nothing else.

armsight run ur10_servoing --task own_target:Follow --standoff 0.1
"""

from dataclasses import dataclass

import numpy as np

from armsight.geometry.pose import inverse, transform
from armsight.servoing.docking import Docking
from armsight.servoing.sighting import Sighting
from armsight.tasks.servo import ServoTask, servo_task
from armsight.workcell import Cell

RADIUS = 0.04  # of the thing [m]


class RedThing:
    """Where the cameras see red; about a ball's middle, without its outline."""

    name = "red thing"

    def in_frame(self, view):
        if view.frame.color is None or view.T_base_camera is None:
            return []
        points = view.info.depth.deproject(view.frame.depth).reshape(-1, 3)
        points = points[np.isfinite(points).all(axis=1)]
        in_color = transform(inverse(view.info.T_depth_color), points)
        pixels = np.rint(view.color_lens.project(in_color))
        inside = ((pixels >= 0) & (pixels < view.frame.color.shape[1::-1])).all(axis=1)
        u, v = pixels[inside].astype(int).T
        red, green, blue = view.frame.color[v, u].astype(int).T
        seen = points[inside][(red > 60) & (red > 2 * green) & (red > 2 * blue)]
        if len(seen) < 20:
            return []
        surface = np.median(seen, axis=0)
        middle = surface * (1.0 + 0.67 * RADIUS / np.linalg.norm(surface))  # behind what is seen
        place, near = transform(view.T_base_camera, np.array([middle, surface]))
        frame, spread = view.frame, 0.008**2 * np.eye(3)
        return [Sighting(self.name, frame.camera, frame.stamp, place, spread, near)]

    def in_pair(self, view, surface=False):
        return []  # the fixed cameras must do


RED_THING = Docking("red thing", RedThing, radius=RADIUS, size=(RADIUS, 0.0, 0.0), stiffness=2.5e3)


@dataclass(frozen=True)
class Follow:
    """Follow a red thing, and stay so far before it [m]; 0 touches."""

    standoff: float = 0.1

    def make(self, cell: Cell) -> ServoTask:
        return servo_task(cell, RED_THING, standoff=self.standoff)
