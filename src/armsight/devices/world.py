"""What may stand behind a cell's devices and move their time along: a simulation or a playback."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from armsight.arrays import Pose, Vector3
from armsight.geometry.shapes import Solid, Surface


@dataclass(frozen=True)
class MovingSolid:
    """A solid of a person or of a moving thing, for drawing only; pose in ``world``."""

    name: str
    solid: Solid
    T_world_solid: Pose


@dataclass(frozen=True)
class MovingSurfaces:
    """A rigid part of a person as it looks; pose in ``world``.

    Attributes:
        name: unique, such as ``visitor/left_forearm``.
        surfaces: in the part's frame; the same objects every time.
        T_world_body: where it is.
    """

    name: str
    surfaces: tuple[Surface, ...]
    T_world_body: Pose


class World(Protocol):
    """Owns the time of a cell that is not real: for driving and drawing, never for a capability."""

    def advance(self, until: float) -> None:
        """Let time pass until ``until`` [s] on the cell's clock; devices deliver what came."""
        ...

    def reset(self) -> None:
        """Back to time 0: the same runs again."""
        ...

    def movers(self) -> tuple[MovingSolid, ...]:
        """People and things that move, roughly."""
        ...

    def bodies(self) -> tuple[MovingSurfaces, ...]:
        """What people look like; they are among the movers as well."""
        ...

    def drag(self, name: str, position_world: Vector3) -> None:
        """Take a thing or a person's hand somewhere [m].

        Raises:
            UsageError: there is no such thing, or nothing here can be moved.
        """
        ...

    def camera_error(self, name: str, T_believed_corrected: Pose, gain: float) -> float | None:
        """How wrong the cell truly is about a camera, to be shown beside what it believes.

        Args:
            name: of the camera.
            T_believed_corrected: what the map corrects of its believed pose.
            gain: factor on measured depth that the map applies.

        Returns:
            Root mean square error of points 1.0-1.5 m from it by pixel and true depth [m]; None
            where nobody knows.
        """
        ...

    def close(self) -> None:
        """Let go of files and graphics."""
        ...
