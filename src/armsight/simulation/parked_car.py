"""A car that is parked: its body and its port are one thing, led where somebody wants it."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, Pose, Vector3
from armsight.geometry.pose import exp, from_rpy, inverse, log, make_pose, to_wxyz
from armsight.geometry.shapes import Surface
from armsight.simulation.spec import SocketSpec

NAME = "car"
SPEED, TURNING = 0.4, 0.2
"""With which it is parked anew [m/s], [rad/s]."""


def port_surfaces(spec: SocketSpec) -> tuple[Surface, ...]:
    """What a socket and the paint about it look like, in its frame, for drawing."""
    return tuple(
        Surface(str(i), look.vertices.astype(np.float32), look.faces, look.color)
        for i, look in enumerate(spec.looks)
        if len(look.faces)
    )


class ParkedCar:
    """Stands where its port was put, or is on its way to where it is wanted.

    Attributes:
        name: by which it is dragged.
        T_world_socket: where its port is now.
    """

    name = NAME

    def __init__(self, spec: SocketSpec, seed: int = 0) -> None:
        self._start = spec.T_world_socket
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Back to where it was parked first."""
        self.T_world_socket: Pose = self._start.copy()
        self._turned = self.T_world_socket, to_wxyz(self.T_world_socket)
        self._goal: Pose | None = None
        self._rng = np.random.default_rng((self._seed, 81))
        self._last = 0.0

    @property
    def parked(self) -> bool:
        """Whether it stands."""
        return self._goal is None

    def drag(self, target: Vector3 | None) -> None:
        """Its port goes to a point of the world [m], at the height that it has; None: it stops."""
        if target is None:
            self._goal = None
            return
        x, y = np.asarray(target, float)[:2]
        R, z = self.T_world_socket[:3, :3], float(self.T_world_socket[2, 3])
        self.park(make_pose(R, (float(x), float(y), z)))

    def park(self, T_world_socket: Pose) -> None:
        """Drive until the port is at a pose."""
        self._goal = np.asarray(T_world_socket, float).copy()

    def anew(self) -> None:
        """Park elsewhere: within 20 x 20 cm and 10 deg of the first place, at its height."""
        x, y = self._rng.uniform(-0.1, 0.1, 2)
        turn = self._rng.uniform(*np.deg2rad([-10.0, 10.0]))
        T = make_pose(from_rpy((0.0, 0.0, turn))[:3, :3] @ self._start[:3, :3], self._start[:3, 3])
        T[:2, 3] += x, y
        self.park(T)

    def update(self, now: float, position: Floats, quaternion: Floats) -> None:
        """See :class:`~armsight.simulation.movers.Mover`."""
        seconds, self._last = max(0.0, now - self._last), now
        if self._goal is not None:
            away = log(inverse(self.T_world_socket) @ self._goal)
            far = max(
                float(np.linalg.norm(away[:3])) / SPEED, float(np.linalg.norm(away[3:])) / TURNING
            )
            if far <= seconds:
                self.T_world_socket, self._goal = self._goal, None
            else:
                self.T_world_socket = self.T_world_socket @ exp(away * (seconds / far))
        if self._turned[0] is not self.T_world_socket:  # it mostly stands, and is asked for often
            self._turned = self.T_world_socket, to_wxyz(self.T_world_socket)
        position[0] = self.T_world_socket[:3, 3]
        quaternion[0] = self._turned[1]
