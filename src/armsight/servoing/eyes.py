"""The perceivers of visual servoing: one for each camera, and one for the pair on the wrist."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import cv2
import numpy as np

from armsight.arrays import ColorImage, Points, Vector3
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, transform
from armsight.motion.perception import CameraUse, PosedFrame, PosedPair
from armsight.robots.kinematics import tcp_pose
from armsight.robots.robot import Robot
from armsight.servoing.planes import depth_picture
from armsight.servoing.sighting import Look, Looks, Sighting, believable

SHOWN = 320
"""Pictures are shown at least so wide, at a whole fraction of their size [px]."""
REDRAWN = 0.5
"""Depth is drawn anew after so long [s]."""
MARK_RADIUS = 0.03
"""A mark seen farther from where the joints say than this is something else [m]."""


class Target(Protocol):
    """Something that can be found in pictures. One class a target; a trained one would do as well.

    One object serves all eyes, each of which calls it in a thread of its own. It may have a
    ``warm_up()``, called before the arm may move: what compiles or loads a network does so there;
    and a ``reset()``, where it remembers anything, called when a simulated cell begins anew. What
    cannot be a sighting (NaN, a covariance that is none) is left out and said.

    Attributes:
        name: such as ``ball``.
    """

    name: str

    def in_frame(self, view: PosedFrame) -> list[Sighting]:
        """Where it is in the colour and depth of one camera, the most believable first."""
        ...

    def in_pair(self, view: PosedPair, surface: bool = False) -> list[Sighting]:
        """Where it is in both pictures of a pair; ``surface``: measured by V's planes, too."""
        ...


class Eye:
    """Looks for a target in the pictures of one fixed camera.

    Args:
        camera: its name; target: what to look for.
        rate: pictures a second [Hz] (V: 5); scale: their size, see :class:`CameraUse`.
    """

    latency = 0.012
    """What a look takes at most in 99 of 100 [s]: 5 to 8 ms of a core were measured, rounded up."""

    def __init__(self, camera: str, target: Target, rate: float = 5.0, scale: float = 0.5) -> None:
        self.name = f"eye/{camera}"
        self.period = 0.01
        self.cameras: tuple[CameraUse, ...] = (CameraUse(camera, rate, scale),)
        self._target = target

    def warm_up(self) -> None:
        """Let the target compile what it needs: a first look would take seconds."""
        _call("warm_up", self._target)

    def reset(self) -> None:
        """A simulated cell begins anew: the target forgets what it has seen."""
        _call("reset", self._target)

    def update(self, frames: Sequence[PosedFrame]) -> Looks | None:
        """See :class:`~armsight.motion.perception.Perceiver`."""
        view = frames[-1]
        if view.frame.color is None or view.T_base_color is None or view.T_base_camera is None:
            return None
        sightings, wrong = believable(self._target.in_frame(view))
        assert view.color_lens is not None
        in_color = inverse(view.T_base_color)
        picture = drawn(
            view.frame.color,
            view.color_lens,
            [transform(in_color, s.position[None]) for s in sightings[:1]],
        )
        look = Look(
            view.frame.camera, view.frame.stamp, False, view.T_base_camera, sightings,
            picture=picture,
        )  # fmt: skip
        return Looks(look.stamp, (look,), wrong)


class WristEye:
    """Looks for a target, and for the mark on the tool, in the pictures of the pair on the arm.

    Args:
        pair: its name; target: what to look for; robot: the arm.
        mark: finds the tool's mark; T_tcp_mark: (3,) where that is in the TCP's frame [m]; or None.
        surface: measure V's thirty planes as well.
    """

    latency = 0.02
    """As an :class:`Eye`'s [s]: 12 to 15 ms were measured."""
    cameras: tuple[CameraUse, ...] = ()

    def __init__(
        self,
        pair: str,
        target: Target,
        robot: Robot,
        mark: Target | None = None,
        T_tcp_mark: Vector3 | None = None,
        surface: bool = False,
    ) -> None:
        self.name = f"eye/{pair}"
        self.period = 0.01
        self.stereo = (pair,)
        self._target, self._robot, self._mark = target, robot, mark
        self._at = np.zeros(3) if T_tcp_mark is None else np.asarray(T_tcp_mark, float)
        self._surface = surface
        self._depth: tuple[float, ColorImage] | None = None

    def warm_up(self) -> None:
        """Let the target compile what it needs: a first look would take seconds."""
        _call("warm_up", self._target, self._mark)

    def reset(self) -> None:
        """A simulated cell begins anew: the target forgets what it has seen."""
        self._depth = None
        _call("reset", self._target, self._mark)

    def update(self, frames: Sequence[PosedPair]) -> Looks | None:
        """See :class:`~armsight.motion.perception.Perceiver`."""
        view = frames[-1]
        if view.T_base_camera is None or view.joints is None:
            return None
        sightings, wrong = believable(self._target.in_pair(view, self._surface))
        tool = tcp_pose(self._robot, view.joints.position)
        expected = tool[:3, :3] @ self._at + tool[:3, 3]
        marks, _ = believable([] if self._mark is None else self._mark.in_pair(view))
        near = [m for m in marks if np.linalg.norm(m.position - expected) < MARK_RADIUS]
        best = min(near, key=lambda m: float(np.linalg.norm(m.position - expected)), default=None)
        in_left = inverse(view.T_base_camera)
        in_right = inverse(view.info.T_left_right) @ in_left
        shown = [s.position[None] for s in (*sightings[:1], *near[:1])]
        both = [
            drawn(image, lens, [transform(T, points) for points in shown])
            for image, lens, T in (
                (view.frame.left, view.info.left, in_left),
                (view.frame.right, view.info.right, in_right),
            )
        ]
        look = Look(
            view.frame.camera,
            view.frame.stamp,
            True,
            view.T_base_camera,
            sightings,
            None if best is None else best.position - expected,
            np.eye(3) if best is None else best.covariance,
            beside([*both, self._depths(view)]),
        )
        return Looks(look.stamp, (look,), wrong)

    def _depths(self, view: PosedPair) -> ColorImage:
        """What the pair sees in depth, drawn a few times a second: nothing is told by it."""
        stamp = view.frame.stamp
        if self._depth is None or not 0.0 <= stamp - self._depth[0] < REDRAWN:
            self._depth = stamp, depth_picture(view)
        return self._depth[1]


def beside(pictures: Sequence[ColorImage]) -> ColorImage:
    """Pictures in a row, all as high as the first; those of unlike lenses are not of one size."""
    height = pictures[0].shape[0]
    fitted = [
        p
        if p.shape[0] == height
        else cv2.resize(p, (round(p.shape[1] * height / p.shape[0]), height))
        for p in pictures
    ]
    return np.asarray(np.hstack(fitted), np.uint8)


def _call(name: str, *targets: Target | None) -> None:
    """Call what a target may have."""
    for target in targets:
        getattr(target, name, lambda: None)()


def drawn(image: ColorImage, lens: PinholeCamera, points: Sequence[Points]) -> ColorImage:
    """A small copy of a picture with a cross at each (1, 3) point of the lens's frame."""
    step = max(image.shape[1] // SHOWN, 1)  # a whole number: several times as fast
    size = (image.shape[1] // step, image.shape[0] // step)
    whole = image[: step * size[1], : step * size[0]]
    small = np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.uint8)
    for point in points:
        u, v = lens.project(point)[0] / step
        # One that its own lens does not show is not drawn: OpenCV takes no such large numbers.
        if 0.0 <= u < small.shape[1] and 0.0 <= v < small.shape[0]:
            at = (round(float(u)), round(float(v)))
            cv2.drawMarker(small, at, (20, 230, 60), cv2.MARKER_CROSS, 17, 2)
    return small
