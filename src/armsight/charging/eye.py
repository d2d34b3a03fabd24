"""The perceiver of charging: a pair's pictures in, the ports that they show out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Bytes, ColorImage, Floats, Mask, Pose
from armsight.calibration import se3
from armsight.charging.closer import Stack, Where, find_closer
from armsight.charging.find import PLUGS, FindOptions
from armsight.charging.fit import model_points
from armsight.charging.plane_fit import contact_pixels, paper_pose
from armsight.charging.ports.table import PORTS
from armsight.charging.pose import PortPose, locate, which_held
from armsight.charging.rehearsal import rehearse
from armsight.devices.data import StereoInfo
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse
from armsight.geometry.stereo import StereoPair
from armsight.motion.perception import CameraUse, PosedPair

GREEN, RED = (30, 220, 60), (235, 60, 50)
SHOWN = 360
"""Width of the pictures that are shown [px]."""
SHOWN_PLUGS = FindOptions(PLUGS, (0.3, 1.2))
"""Looked for where the arm shows its plug."""
NEARBY = 0.04
"""A port is no farther from where an earlier look saw it [m]."""
RESTS = 1e-3
"""A pair that has moved or turned by no more than this is where it was [m], [rad]."""
CLEAR = 0.6
"""Score of a port that is clear enough."""
FITS = 48
"""Edges of the part that is shown, at least [px]."""


@dataclass(frozen=True, eq=False)
class SeenPort:
    """A port by one look.

    Attributes:
        port: its type; score: share of its edges that were seen, 0..1.
        T_base_port: where; covariance: (6, 6) as a twist in its own frame [m], [rad].
        doubtful: whether its roll cannot be told.
    """

    port: str
    score: float
    T_base_port: Pose
    covariance: Floats
    doubtful: bool


@dataclass(frozen=True, eq=False)
class PortLook:
    """What one exposure of a pair showed.

    Attributes:
        stamp: of the exposure [s]; pair: its name.
        ports: the surest first.
        picture: about the surest, its edges drawn; the whole left picture where there is none.
        reason: why there is nothing, in words; empty when there is.
    """

    stamp: float
    pair: str
    ports: tuple[SeenPort, ...]
    picture: ColorImage
    reason: str = ""


class PortEye:
    """Looks for ports in the pictures of one pair, while the task wants them.

    Args:
        pair: its name.
        ports: types to look for.
        distance: nearest and farthest [m].
        paper: the poses are the charging paper's: equation 1 and a plane through the contacts.
        where: a port can be, in ``base``: where nothing is clear it is looked for there more
            closely (:mod:`armsight.charging.closer`); None: it is not.

    Attributes:
        shown: ``T_base_plug`` of a plug that the arm shows: it looks for plugs then; else None.
        expected: ``T_base_port`` by an earlier look: where none is clear it is looked for about
            there; else None.
    """

    latency = 0.6
    period = 0.3
    cameras: tuple[CameraUse, ...] = ()
    on_demand = True

    def __init__(
        self,
        pair: str,
        ports: Sequence[str],
        distance: tuple[float, float] = (0.25, 2.8),
        paper: bool = False,
        where: Where | None = None,
    ) -> None:
        self.name = f"ports/{pair}"
        self.stereo = (pair,)
        self._options = FindOptions(tuple(ports), distance)
        self._paper = paper
        self._where, self._stack = where, Stack()
        self._seen_from: Pose | None = None
        self.shown: Pose | None = None
        self.expected: Pose | None = None

    def warm_up(self) -> None:
        """Compile what finds and fits."""
        rehearse()

    def update(self, frames: Sequence[PosedPair]) -> PortLook | None:
        """See :class:`~armsight.motion.perception.Perceiver`."""
        view = frames[-1]
        frame, info = view.frame, view.info
        if view.T_base_camera is None:
            return None
        wrong = picture_fault(frame.left, frame.right, info.left, info.right)
        if wrong:
            empty = np.zeros((SHOWN * 3 // 4, SHOWN, 3), np.uint8)
            return PortLook(frame.stamp, info.name, (), empty, wrong)
        left, right = gray(frame.left), gray(frame.right)
        pair = info.lenses
        held = None
        if self.shown is not None:
            T_left_plug = inverse(view.T_base_camera) @ self.shown
            held = which_held((left, right), pair, PLUGS, np.asarray(T_left_plug))
        options = self._options if self.shown is None else SHOWN_PLUGS
        found = locate((left, right), pair, options) if held is None else (held,)
        where = self._where
        if self.expected is not None:
            where = Where(lambda T: True, self.expected, NEARBY)
        if where is not None and self.shown is None:
            found = self._closer(view, (left, right), found, where)
        ports = []
        for pose in found:
            T = self._pose(pose, pair)
            if T is not None:
                T_base_port = np.asarray(view.T_base_camera @ T)
                covariance = pose.covariance + mounting_spread(info, T)
                ports.append(
                    SeenPort(pose.port, pose.score, T_base_port, covariance, pose.doubtful)
                )
        picture = drawn(frame.left, info.left, found[0] if found else None)
        reason = "" if ports else "no port in the pictures"
        return PortLook(frame.stamp, info.name, tuple(ports), picture, reason)

    def _closer(
        self,
        view: PosedPair,
        images: tuple[Bytes, Bytes],
        found: tuple[PortPose, ...],
        where: Where,
    ) -> tuple[PortPose, ...]:
        """What was found; where none of it is clear, what is found more closely."""
        T, o = view.T_base_camera, self._options
        assert T is not None
        if self._seen_from is None or not np.allclose(self._seen_from, T, atol=RESTS):
            self._seen_from, self._stack = T, Stack()
        bright = self._stack.add(images, view.frame.stamp)
        if any(p.score >= CLEAR for p in found):
            return found
        closer = find_closer(bright, view.info.lenses, o.ports, o.distance, where.seen_from(T))
        return found if closer is None else (closer,)

    def _pose(self, pose: PortPose, pair: StereoPair) -> Pose | None:
        if not self._paper or self.shown is not None:
            return pose.T_ref_port
        names = tuple(pin.name for pin in PORTS[pose.port].pins)
        pixels = [
            contact_pixels(pose.fit, view, names) + pose.fit.corners[view] for view in range(2)
        ]
        return paper_pose(pose.port, pixels[0], pixels[1], pair)


def mounting_spread(info: StereoInfo, T_camera_port: Pose) -> Floats:
    """(6, 6) what is not known of a pair's mounting, as a twist of a port in its own frame."""
    if info.covariance is None:
        return np.zeros((6, 6))
    return se3.carried(inverse(T_camera_port), info.covariance)


def picture_fault(
    left: ColorImage, right: ColorImage, left_lens: PinholeCamera, right_lens: PinholeCamera
) -> str:
    """Why a pair's pictures cannot be searched, in words; empty when they can."""
    for side, image, lens in (("left", left, left_lens), ("right", right, right_lens)):
        if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)):
            shape = "x".join(str(n) for n in image.shape)
            return (
                f"the {side} picture is {image.dtype} of {shape}: uint8, RGB or grey, is expected"
            )
        if image.shape[:2] != (lens.height, lens.width):
            h, w = image.shape[:2]
            return f"the {side} picture is {w}x{h}, its lens {lens.width}x{lens.height}"
        if float(image.max()) - float(image.min()) < 12.0:
            return f"the {side} picture shows nothing: covered, dark or over-exposed"
    return ""


def gray(image: ColorImage) -> Bytes:
    """(h, w) brightness of an (h, w, 3) picture, or an (h, w) one as it is."""
    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


def drawn(image: ColorImage, lens: PinholeCamera, pose: PortPose | None) -> ColorImage:
    """A picture about a port with its edges, seen ones green and missed ones red."""
    if pose is None:
        return drawn_edges(image, None)
    return drawn_edges(image, (lens.project(model_points(pose.fit)), pose.fit.found))


def drawn_edges(image: ColorImage, edges: tuple[Floats, Mask] | None) -> ColorImage:
    """A picture about (n, 2) pixels of edges, and whether each was seen; all of it without any."""
    image = image if image.ndim == 3 else np.dstack([image] * 3)
    out = image
    if edges is not None:
        pixels, found = edges
        out = image.copy()
        for (u, v), seen in zip(pixels, found[: len(pixels)]):
            if np.isfinite([u, v]).all():
                at = (round(16 * float(u)), round(16 * float(v)))
                cv2.circle(out, at, 16, GREEN if seen else RED, -1, cv2.LINE_AA, 4)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        middle = 0.5 * (low + high)
        half = max(FITS, 0.9 * float((high - low).max()))
        left, top = (max(0, int(middle[k] - half)) for k in range(2))
        right, bottom = (int(middle[k] + half) for k in range(2))
        part = out[top:bottom, left:right]
        out = part if part.size else out
    size = (SHOWN, max(1, round(SHOWN * out.shape[0] / out.shape[1])))
    return np.asarray(cv2.resize(out, size, interpolation=cv2.INTER_AREA), np.uint8)
