"""What one calibration consists of: lenses, cameras, boards, arm poses, and who saw what.

Frames: a *rig* is a camera body with one or more lenses (a Kinect has an infrared and a colour
lens); it is mounted on ``base`` or on ``flange``. A board is mounted on ``flange`` or on ``base``,
or held freely in space for one view (a lens frame). Poses of the arm are ``T_base_flange``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from armsight.arrays import Floats, Ints, JointVector, Points, Pose
from armsight.calibration.robot_errors import RobotErrors
from armsight.geometry.camera import PinholeCamera

Mount = Literal["base", "flange"]

LENS_PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
"""Order of the nine numbers of a lens."""


def lens_vector(camera: PinholeCamera) -> Floats:
    """(9,) the numbers of a lens in the order of :data:`LENS_PARAMETERS`."""
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


def lens_from_vector(values: Floats, width: int, height: int) -> PinholeCamera:
    """The lens with these (9,) numbers."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = (float(v) for v in values)
    return PinholeCamera(width, height, fx, fy, cx, cy, (k1, k2, p1, p2, k3))


@dataclass(frozen=True)
class Rig:
    """A camera body.

    Attributes:
        name: of the camera.
        mount: what carries it.
        T_mount_rig: start value of its pose (the rig's frame is that of its first lens).
    """

    name: str
    mount: Mount = "base"
    T_mount_rig: Pose = field(default_factory=lambda: np.eye(4))


@dataclass(frozen=True)
class Lens:
    """One lens of a rig.

    Attributes:
        name: such as ``left color``.
        rig: index of its rig.
        camera: start values, or the truth where they are kept.
        T_rig_lens: start value of its pose in the rig.
        offset_free: whether that pose is to be solved (all lenses of a rig but the first).
        prior: (9, 9) information about ``camera``'s numbers, or None for none.
        keep: the numbers are kept whatever the freedom says (a factory calibration).
    """

    name: str
    rig: int
    camera: PinholeCamera
    T_rig_lens: Pose = field(default_factory=lambda: np.eye(4))
    offset_free: bool = False
    prior: Floats | None = None
    keep: bool = False


@dataclass(frozen=True)
class BoardPlacement:
    """A board and what carries it.

    Attributes:
        name: for messages.
        points: (k, 3) corners in the board's frame, z = 0 [m].
        mount: what carries it.
        T_mount_board: start value of its pose.
    """

    name: str
    points: Points
    mount: Mount = "flange"
    T_mount_board: Pose = field(default_factory=lambda: np.eye(4))


@dataclass(frozen=True)
class ArmView:
    """The arm at rest (or nearly) at one moment of looking.

    Attributes:
        T_base_flange: what the controller says.
        joints: (n,) [rad], or None where only the pose is known (then no robot model).
        twist: (6,) body velocity of the flange [m/s, rad/s], for the time offset.
        free: the board hangs freely: ``T_base_flange`` is only a start value of the board's pose
            in the rig's mount frame, and the arm plays no part.
        stamp: time of exposure [s].
    """

    T_base_flange: Pose
    joints: JointVector | None = None
    twist: Floats = field(default_factory=lambda: np.zeros(6))
    free: bool = False
    stamp: float = 0.0


@dataclass(frozen=True)
class Sighting:
    """One lens saw one board in one view.

    Attributes:
        view, lens, board: indices.
        corner: (m,) indices of the corners seen.
        pixel: (m, 2) where [px].
        sigma: standard deviation of a coordinate [px].
    """

    view: int
    lens: int
    board: int
    corner: Ints
    pixel: Floats
    sigma: float = 0.15


@dataclass(frozen=True)
class Problem:
    """Everything that one solve looks at."""

    rigs: tuple[Rig, ...]
    lenses: tuple[Lens, ...]
    boards: tuple[BoardPlacement, ...]
    views: tuple[ArmView, ...]
    sightings: tuple[Sighting, ...]
    robot: RobotErrors | None = None

    def only_views(self, views: Sequence[int] | Ints) -> Problem:
        """The same problem seen from some views only (indices are kept)."""
        wanted = {int(v) for v in views}
        return replace(self, sightings=tuple(s for s in self.sightings if s.view in wanted))

    def only_lenses(self, lenses: Sequence[int]) -> Problem:
        """The same problem through some lenses only (indices are kept)."""
        wanted = set(lenses)
        return replace(self, sightings=tuple(s for s in self.sightings if s.lens in wanted))

    @property
    def used_views(self) -> list[int]:
        """Views in which some lens saw a board, in order."""
        return sorted({s.view for s in self.sightings})


@dataclass(frozen=True)
class Priors:
    """What is believed before any data, as standard deviations (docs/calibration.md).

    Attributes:
        board_scale: print scale [1].
        board_warp: bending at the board's edge [m].
        time: camera clock against arm clock [s].
    """

    board_scale: float = 0.002
    board_warp: float = 0.0003
    time: float = 0.02


@dataclass(frozen=True)
class Freedom:
    """What a solve may move beside camera and board poses.

    Attributes:
        lens: the numbers of every lens that is not kept.
        shape: print scale and warp of the boards.
        robot: the arm's kinematic errors (needs joint angles).
        white: (sigma [m], sigma [rad]) of an independent error at every arm pose, or None for an
            arm that is exact.
        time: a time offset of each rig (only seen where the arm moves).
    """

    lens: bool = False
    shape: bool = True
    robot: bool = False
    white: tuple[float, float] | None = (0.0001, np.deg2rad(0.01))
    time: bool = False


def labels_of(problem: Problem) -> tuple[str, ...]:
    """Names of all global unknowns in their order (see ``Model``), for reports."""
    pose = ("x [m]", "y [m]", "z [m]", "turn x [rad]", "turn y [rad]", "turn z [rad]")
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    return (
        *(f"{lens.name} {n}" for lens in problem.lenses for n in names),
        *(f"{lens.name} in its camera, {n}" for lens in problem.lenses for n in pose),
        *(f"camera {rig.name}, {n}" for rig in problem.rigs for n in pose),
        *(f"clock of {rig.name} [s]" for rig in problem.rigs),
        *(f"board {b.name}, {n}" for b in problem.boards for n in pose),
        *(
            f"board {b.name}, {n}"
            for b in problem.boards
            for n in ("print scale", "bending x [m]", "bending y [m]")
        ),
        *(problem.robot.names if problem.robot is not None else ()),
    )
