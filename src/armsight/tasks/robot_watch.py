"""A perceiver that looks for arms which no driver announces, in the cell's colour pictures.

To the map another arm is what a box is: it was there, it rests, and so it may be taken for a thing
and worked beside by millimetres. But it may start at any moment. What the recogniser takes for an
arm, and is not this cell's own, is told to the map, which counts it as somebody who moves for as
long as it has been seen lately (:class:`~armsight.motion.perception.SeenRobot`). It adds doubt and
takes none away: what is overlooked is what it would be without the watch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy import ndimage

from armsight.arrays import Floats32, JointVector, Mask, Points
from armsight.devices.data import RgbdCameraInfo
from armsight.geometry.pose import inverse, transform
from armsight.geometry.shapes import Solid
from armsight.motion.perception import CameraUse, PosedFrame, SeenRobot
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.any_arm.recogniser import ArmRecogniser
from armsight.recognition.any_arm.sighting import Arm
from armsight.recognition.inference.model import network_file
from armsight.recognition.inference.pictures import Picture
from armsight.robots.kinematics import sphere_centers
from armsight.robots.robot import Robot
from armsight.robots.solids import thin
from armsight.workcell import Cell

NETWORK = "arms"
RATE, SCALE = 0.25, 0.7
"""Colour that it asks of each camera [Hz], and at which share of the lens's own size."""
SURE = 0.5
"""Probability from which a pixel is of an arm."""
OWN = 0.10
"""What is so near to the cell's own arm is its own [m]: a hose, a mask that runs over."""
DECLARED = 0.05
"""What is so near to a declared solid is that [m]: as far as cameras see it aside."""
LEAST = 40
"""Points of another arm, a cell of :data:`GRAIN` each, from which it is one."""
GRAIN = 0.02
"""Points nearer than this to each other are one [m]."""
GAP = 0.06
"""Parts of a body are at most so far from each other [m]."""
JUMP = 0.08
"""Where depth changes by more from a pixel to the next there is a border [m]."""
CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)
IN_BODY = 0.12
"""Joints are inside of their body, whose surface is seen [m]."""
KEPT = 20.0
"""An arm stays on the page for so long after it was last seen [s]."""
SAME = 0.5
"""Two sightings with middles so near to each other are of one arm [m]."""


@dataclass(frozen=True)
class RobotsSeen:
    """Arms that no driver announces.

    Attributes:
        stamp: exposure of the newest picture that was looked at [s].
        robots: those seen lately.
        warning: what they are, in words; or empty.
    """

    stamp: float
    robots: tuple[SeenRobot, ...] = ()
    warning: str = ""


def robot_watch(cell: Cell) -> tuple[RobotWatch, ...]:
    """The watch of a cell; none where no fixed camera of the guard's has colour."""
    cameras = [
        c.info
        for c in cell.cameras
        if c.info.mounted_on == "base" and c.info.guard and c.info.color is not None
    ]
    if not cameras:
        return ()
    recogniser = ArmRecogniser(CropModel(network_file(NETWORK), 1))
    return (RobotWatch(cell.robot, cameras, cell.static, recogniser),)


class RobotWatch:
    """Looks for other arms in the cameras' colour pictures.

    Args:
        robot: the cell's own arm.
        cameras: that stand, and have colour.
        static: declared solids in ``base``: what lies on them is no arm.
        recogniser: of arms.
    """

    name = "robot watch"
    period = 0.5
    latency = 0.3

    def __init__(
        self,
        robot: Robot,
        cameras: Sequence[RgbdCameraInfo],
        static: Sequence[Solid],
        recogniser: ArmRecogniser,
    ) -> None:
        self.cameras: Sequence[CameraUse] = tuple(CameraUse(c.name, RATE, SCALE) for c in cameras)
        self._robot, self._static, self._recogniser = robot, tuple(static), recogniser
        self.reset()

    def reset(self) -> None:
        """None has been seen."""
        self._seen: list[SeenRobot] = []
        self._said: RobotsSeen | None = None

    def warm_up(self) -> None:
        """Load what a first look would load."""
        nothing = np.zeros((270, 480, 3), np.uint8)
        self._recogniser.recognise(Picture("nothing", nothing))

    def update(self, frames: Sequence[PosedFrame]) -> RobotsSeen | None:
        """Look at the colour pictures; where there are none, what was said before stands."""
        looked = [f for f in frames if f.frame.color is not None and f.color_lens is not None]
        if not looked:
            return self._said
        now = max(f.frame.stamp for f in looked)
        for posed in looked:
            for found in self._others(posed):
                self._remember(found)
        self._seen = [s for s in self._seen if s.stamp > now - KEPT]
        words = [f"{s.words()}, which no driver announces: it counts as moving" for s in self._seen]
        self._said = RobotsSeen(now, tuple(self._seen), "; ".join(words))
        return self._said

    def _remember(self, found: SeenRobot) -> None:
        """In the place of what was known of the same arm; a type is kept until another is seen."""
        before = [s for s in self._seen if _apart(s, found) <= SAME]
        named = [s.robot for s in before if s.robot != "unknown"]
        if found.robot == "unknown" and named:
            found = replace(found, robot=named[-1])
        self._seen = [s for s in self._seen if s not in before]
        self._seen.append(found)

    def _others(self, posed: PosedFrame) -> list[SeenRobot]:
        """The arms of a picture that are not the cell's own."""
        image, lens, T = posed.frame.color, posed.color_lens, posed.T_base_camera
        if image is None or lens is None or T is None or posed.joints is None:
            return []
        found = self._recogniser.recognise(Picture(posed.info.name, image), lens)
        if not found.arms:
            return []
        points = _points(posed)
        seen_at = lens.project(transform(inverse(posed.info.T_depth_color), points))
        in_base = transform(T, points)
        others = []
        for arm in found.arms:
            body = thin(in_base[_inside(_narrowed(arm.mask), seen_at)], GRAIN)
            body = _largest(body[~self._known(body, posed.joints.position)])
            if len(body) < LEAST:
                continue
            joints: Points = np.empty((0, 3))
            if arm.believed:
                T_base_color = T @ posed.info.T_depth_color
                joints = transform(T_base_color, np.vstack([arm.base[None], arm.joints]))
                if _away(joints, body) > IN_BODY:  # two in one mask, and the pose is the own one's
                    joints = joints[:0]
            others.append(SeenRobot(_name(arm), body, joints, posed.frame.stamp))
        return others

    def _known(self, points: Points, q: JointVector) -> Mask:
        """(k,) which points are of the cell's own arm, or beside it, or of a declared solid."""
        known = np.zeros(len(points), bool)
        for center, radius in zip(sphere_centers(self._robot, q), self._robot.spheres.radius):
            known |= ((points - center) ** 2).sum(axis=1) < (radius + OWN) ** 2
        for solid in self._static:  # a mask runs over to what is behind
            known |= solid.distance(points) < DECLARED
        return known


def _name(arm: Arm) -> str:
    """Its type, where that is more likely than not."""
    return arm.robot if arm.types.get(arm.robot, 0.0) >= SURE else "unknown"


def _points(posed: PosedFrame) -> Points:
    """(k, 3) what the depth picture shows, in the depth lens's frame [m]; no border of it."""
    depth = np.nan_to_num(posed.depth, nan=0.0, posinf=0.0)
    far, near = (cv2.morphologyEx(depth, way, CROSS) for way in (cv2.MORPH_DILATE, cv2.MORPH_ERODE))
    whole = (far - near < JUMP) & (near > 0.0)
    return posed.info.depth.deproject(depth).reshape(-1, 3)[whole.reshape(-1)]


def _narrowed(probability: Floats32) -> Mask:
    """A mask without its border, where what is behind shows through."""
    return np.asarray(cv2.erode((probability >= SURE).astype(np.uint8), CROSS), bool)


def _inside(mask: Mask, pixels: Points) -> Mask:
    """(k,) which pixels lie in a mask."""
    h, w = mask.shape
    there = ((pixels >= 0.0) & (pixels <= np.array([w - 1, h - 1]))).all(axis=1)
    column, row = np.round(pixels[there]).astype(np.int64).T
    out = np.zeros(len(pixels), bool)
    out[there] = mask[row, column]
    return out


def _largest(points: Points) -> Points:
    """The largest part of a body that hangs together: crumbs are of what is behind."""
    if not len(points):
        return points
    cell = np.floor(points / GAP).astype(np.int64)
    cell -= cell.min(axis=0)
    there = np.zeros(cell.max(axis=0) + 1, bool)
    there[tuple(cell.T)] = True
    part = ndimage.label(there, np.ones((3, 3, 3)))[0][tuple(cell.T)]
    return np.asarray(points[part == np.bincount(part).argmax()])


def _away(joints: Points, body: Points) -> float:
    """How far half of the joints are from what is seen of the body, at most [m]."""
    apart = np.linalg.norm(joints[:, None] - body[None], axis=2).min(axis=1)
    return float(np.median(apart))


def _apart(a: SeenRobot, b: SeenRobot) -> float:
    """Distance of two bodies' middles [m]."""
    return float(np.linalg.norm(a.points.mean(axis=0) - b.points.mean(axis=0)))
