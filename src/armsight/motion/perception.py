"""What a perceiver is: frames, with the joints at their exposure, become an observation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

from armsight.arrays import DepthImage, Points, Pose
from armsight.devices.data import (
    JointState,
    RgbdCameraInfo,
    RgbdFrame,
    StereoFrame,
    StereoInfo,
)
from armsight.geometry.camera import PinholeCamera


@dataclass(frozen=True)
class CameraUse:
    """What one subscriber wants of a camera.

    Attributes:
        camera: its name in the cell; empty for every camera.
        color_rate: colour pictures a second [Hz]; 0 for none. Colour costs a driver bandwidth and
            the simulation much time, so it is taken only as often as somebody asks.
        color_scale: edge of the colour picture in shares of the lens's own, above 0 to 1.
        infrared: the depth lens's own picture as well, with every colour picture.
    """

    camera: str = ""
    color_rate: float = 0.0
    color_scale: float = 1.0
    infrared: bool = False


@dataclass(frozen=True)
class PosedFrame:
    """A frame with where its camera was.

    Attributes:
        frame: one exposure.
        info: of the camera.
        joints: of the arm at the exposure, interpolated; None where none are known.
        T_base_camera: the depth lens in ``base`` at the exposure; None for a camera on an arm whose
            joints are not known.
        color_lens: the lens that fits ``frame.color`` at the size it came in; None without colour.
    """

    frame: RgbdFrame
    info: RgbdCameraInfo
    joints: JointState | None
    T_base_camera: Pose | None
    color_lens: PinholeCamera | None = None

    @property
    def depth(self) -> DepthImage:
        """(h, w) the depth picture [m], less the error that calibration has found."""
        depth, model = self.frame.depth, self.info.depth_model
        return depth if model is None else model.corrected(depth, self.info.depth)

    @property
    def T_base_color(self) -> Pose | None:
        """The colour lens in ``base`` at the exposure, or None where it is not known."""
        if self.T_base_camera is None:
            return None
        T: Pose = self.T_base_camera @ self.info.T_depth_color
        return T


@dataclass(frozen=True)
class PosedPair:
    """The pictures of a stereo pair with where it was.

    Attributes:
        frame: one exposure; info: of the pair.
        joints: of the arm at the exposure, interpolated; None where none are known.
        T_base_camera: the left lens in ``base`` at the exposure; None for a pair on an arm whose
            joints are not known.
    """

    frame: StereoFrame
    info: StereoInfo
    joints: JointState | None
    T_base_camera: Pose | None


Posed: TypeAlias = PosedFrame | PosedPair
"""What a perceiver is handed."""


@dataclass(frozen=True, eq=False)
class SeenRobot:
    """An arm in the cell that no driver announces: it may start at any moment.

    Two are the same only if they are one sighting.

    Attributes:
        robot: its type, or ``unknown``.
        points: (k, 3) of its body that are seen, in ``base`` [m].
        joints: (1 + n, 3) its base and joints, likewise; empty where its pose is not known.
        stamp: exposure of the picture [s].
    """

    robot: str
    points: Points
    joints: Points
    stamp: float

    def words(self) -> str:
        """In short."""
        what = "an arm of an unknown kind" if self.robot == "unknown" else f"a {self.robot}"
        x, y, z = self.points.mean(axis=0)
        return f"{what} near ({x:.2f}, {y:.2f}, {z:.2f}) m"


class Evidence(Protocol):
    """What a perceiver publishes: an immutable record that says when it was so."""

    @property
    def stamp(self) -> float:
        """Exposure of the oldest frame that it rests on [s]."""
        ...


class Perceiver(Protocol):
    """Turns frames into observations. A component of its own; knows no thread and no clock.

    It may have

    * ``latency``: what a round takes on the simulated clock [s], 0.02 if it does not say;
    * ``stereo``: names of pairs, whose pictures then come as :class:`PosedPair`; with
      ``on_demand = True`` only while the task subscribes to the pair;
    * ``reset()``, called when a simulated cell begins anew;
    * ``warm_up()``, called once before the arm may move, so that no round compiles; what it raises
      ends the run before it begins.

    One that raises in a round loses that round and says so; one that hangs publishes nothing any
    more.

    What it publishes may have ``excluded``, pairs of a camera's name and a reason: from then on
    nothing counts that this camera says, in the map and for the guard; and ``placed``, cameras
    (:class:`RgbdCameraInfo`) that were calibrated again: from then on they count, from there. It
    may have a ``warning`` that people should read, and ``robots`` (:class:`SeenRobot`): what stands
    there counts as somebody who moves, however still it is. Who has ``doubted(camera, excluded)``
    is told, in another thread than its own, when a camera does not count any more: it is excluded,
    or else its pictures have been refused for a while.

    Attributes:
        name: unique in the session; a task finds the observation by it.
        period: least time between two rounds [s]; a round begins when a frame has come.
        cameras: which frames it wants.
    """

    name: str
    period: float
    cameras: Sequence[CameraUse]

    def update(self, frames: Sequence[Any]) -> Evidence | None:
        """The newest frame of each camera that sent one since the last round, by exposure.

        They are :class:`PosedFrame`, and :class:`PosedPair` for whoever named a pair.

        Returns None when there is nothing to say of them: the observation before stays the newest.
        """
        ...
