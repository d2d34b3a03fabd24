"""Keep the TCP above an orange ball: a perceiver and a task, all that armsight needs to know.

armsight run keep_above.toml --task keep_above:KeepAbove --height 0.6
"""

from dataclasses import dataclass

import numpy as np

from armsight.geometry.pose import inverse, transform
from armsight.motion.intents import Rest, VelocityIntent
from armsight.motion.perception import CameraUse
from armsight.motion.task import Subscriptions
from armsight.robots.kinematics import tcp_pose


@dataclass(frozen=True)
class Ball:
    stamp: float  # exposure of the picture [s]
    center: np.ndarray  # (3,) in base [m]


class BallFinder:
    name, period, latency = "ball", 0.1, 0.03
    cameras = (CameraUse("front_left", color_rate=10, color_scale=0.25),)

    def update(self, frames):
        seen = frames[-1]
        if seen.frame.color is None:
            return None
        points = seen.info.depth.deproject(seen.frame.depth).reshape(-1, 3)
        points = points[np.isfinite(points).all(axis=1)]
        in_color = transform(inverse(seen.info.T_depth_color), points)
        pixels = np.rint(seen.color_lens.project(in_color))
        inside = ((pixels >= 0) & (pixels < seen.frame.color.shape[1::-1])).all(axis=1)
        u, v = pixels[inside].astype(int).T
        red, green, blue = seen.frame.color[v, u].astype(int).T
        orange = points[inside][(red > 90) & (red > 1.5 * green) & (red > 3 * blue)]
        if len(orange) < 10:
            return None
        return Ball(seen.frame.stamp, transform(seen.T_base_camera, orange).mean(axis=0))


@dataclass
class KeepAbove:
    """Keep the TCP above an orange ball, by so much [m], with so much of the error a second."""

    height: float = 0.6
    gain: float = 0.8
    name, period = "keep_above", 0.02
    subscriptions, perceivers = Subscriptions(perceivers=("ball",)), (BallFinder(),)

    def update(self, observation):
        ball = observation.newest(Ball)
        if ball is None:
            return Rest("no ball seen yet")
        wanted = ball.center + np.array([0.0, 0.0, self.height])
        error = wanted - tcp_pose(observation.robot, observation.joints.position)[:3, 3]
        twist = np.concatenate([self.gain * error, np.zeros(3)])
        return VelocityIntent("above the ball", twist, "base", ball.stamp, ball.stamp + 0.6)
