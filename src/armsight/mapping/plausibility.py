"""Whether a depth picture can be true: lies with fresh stamps are refused, and free nothing.

A camera whose driver repeats an old buffer, mirrors its picture or delivers that of another camera
sends well-formed frames with good stamps. Three things that no true picture can do are looked for:

* it sees through declared solids;
* it sees through the arm where the joints say that the arm is;
* it shows again, value for value, what it showed before, although this camera's pictures are noisy.

Each needs many pixels to agree, so that edges, flying pixels and what the calibration leaves cannot
refuse an honest picture. What hides solids or arm is no contradiction: somebody may stand there.
Missing returns free nothing, so a covered lens is no lie; it is said all the same.
"""

from __future__ import annotations

from hashlib import blake2b
from typing import Final

import numpy as np

from armsight.arrays import Bytes, Floats32, Points, Pose, Words
from armsight.devices.data import RgbdCameraInfo
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, transform
from armsight.mapping.kernels.pixels import VALID
from armsight.mapping.kernels.sightlines import count_through
from armsight.mapping.kernels.solids import trace_solids
from armsight.mapping.self_filter import BodyFields, BodyPose
from armsight.mapping.static_geometry import StaticGeometry

STEP: Final = 12
"""Every so many pixels of a picture are looked at, in both directions."""
BEHIND: Final = 0.10
"""A return this far behind the surface of a declared solid was seen through it [m] ..."""
BEHIND_ANGLE: Final = 0.02
"""... and this much farther a metre of depth: declared poses are a degree off [rad]."""
SOLID_SHARE: Final = 0.05
"""A picture lies when it sees through solids at more than this share of the pixels they fill ..."""
LEAST_PIXELS: Final = 30
"""... and at least at so many."""
ARM_POINTS: Final = 64
"""Points deep in the arm at which it is looked for, about."""
ARM_DEEP: Final = 0.02
"""So deep within a link's surface [m]; in thinner links at two thirds of what there is."""
ARM_BEHIND: Final = 0.08
"""A return this far behind such a point was seen through the arm [m]."""
ARM_SHARE: Final = 0.25
"""A picture lies when it sees through the arm at more than this share of the points in view ..."""
LEAST_POINTS: Final = 5
"""... and at least at so many."""
NOISY_SHARE: Final = 0.5
"""A camera at rest is noisy when more of its pixels than this change from picture to picture ..."""
NOISY_PICTURES: Final = 10
"""... so many times in a row."""
COVERED: Final = 0.25
"""A lens seems covered when its pictures lose this share of the returns that they used to have."""
USUAL_PICTURES: Final = 15
"""Pictures after which it is known how many returns there are; more are averaged over as many."""
REMEMBERED: Final = 9000
"""Pictures of which the fingerprint is kept: five minutes at 30 Hz."""


class Plausibility:
    """Looks at the pictures of one camera.

    Args:
        info: of the camera.
        solids: declared ones.
        fields: of the arm.
        noise: (3,) a, b, c of the camera's sigma(z) = a + b z + c z^2 [m].
    """

    def __init__(
        self,
        info: RgbdCameraInfo,
        solids: StaticGeometry,
        fields: BodyFields,
        noise: Floats32,
    ) -> None:
        self._lens: PinholeCamera = info.depth
        self._range = info.range
        self._noise = np.asarray(noise, float)
        self._solids = solids
        self._part, self._inside = _deep_points(fields)
        h, w = info.depth.height, info.depth.width
        self._rows, self._columns = slice(STEP // 2, h, STEP), slice(STEP // 2, w, STEP)
        rays = np.asarray(info.depth.rays, np.float32)
        flat = rays.reshape(-1, 2)
        self._view = flat.min(axis=0), flat.max(axis=0)
        self._rays = np.ascontiguousarray(rays[self._rows, self._columns])
        self._last: Floats32 = np.zeros(self._rays.shape[:2], np.float32)
        self._traced_from = b""
        self._before: Floats32 | None = None
        self._stood_at = b""
        self._changed = 0
        self._usual, self._pictures = 0.0, 0
        self._seen: Words = np.zeros(REMEMBERED, np.uint64)
        self._next = 0

    def contradiction(
        self,
        depth: Floats32,
        label: Bytes,
        T_base_camera: Pose,
        body: BodyPose,
        error: tuple[float, float],
        stamp_error: float,
    ) -> str:
        """What a picture sees through although it is there, or nothing.

        Args:
            depth: (h, w) float32 [m].
            label: (h, w) uint8, not 0 where there is a usable return.
            T_base_camera: where the camera was.
            body: where the arm was.
            error: (m, rad) of the camera's pose.
            stamp_error: greatest error of the stamp against the joints' [s].
        """
        T = T_base_camera
        return self._through_solids(self._sample(depth, label), T) or self._through_arm(
            depth, label, T, body, error, stamp_error
        )

    def _sample(self, depth: Floats32, label: Bytes) -> Floats32:
        """Usable returns of the pixels that are looked at, NaN where there is none."""
        at = self._rows, self._columns
        return np.where(label[at] >= VALID, depth[at], np.float32(np.nan))

    def warning(self, label: Bytes) -> str:
        """What is odd about a picture that is believed, or nothing.

        Args:
            label: (h, w) uint8, not 0 where there is a usable return.
        """
        share = float((label[self._rows, self._columns] != 0).mean())
        known = self._pictures >= USUAL_PICTURES
        if known and share < (1.0 - COVERED) * self._usual:
            lost = 1.0 - share / self._usual
            return (
                f"{lost:.0%} of the returns that it used to have are missing: is its lens covered?"
            )
        self._pictures += 1
        self._usual += (share - self._usual) / min(self._pictures, USUAL_PICTURES)
        return ""

    def repeats(self, depth: Floats32, label: Bytes, T: Pose) -> str:
        """Whether a picture was told before; each is asked about once.

        Noise never repeats, and only a camera that has shown noise is held to it.

        Args:
            depth: (h, w) float32 [m], as the camera gave it.
            label: (h, w) uint8, not 0 where there is a usable return.
            T: where the camera is believed to be.
        """
        sample = self._sample(depth, label)
        mark = np.frombuffer(blake2b(sample.tobytes(), digest_size=8).digest(), np.uint64)[0]
        known = bool((self._seen == mark).any())
        if self._noisy and known:
            return "it repeats an earlier picture, value for value, under a new stamp"
        before, stood = self._before, self._stood_at
        self._before, self._stood_at = sample, T.tobytes()
        if before is not None and stood == self._stood_at and not self._noisy:
            both = np.isfinite(before) & np.isfinite(sample)
            changed = float((before != sample)[both].mean()) if both.any() else 0.0
            self._changed = self._changed + 1 if changed > NOISY_SHARE else 0
        if not known:
            self._seen[self._next] = mark
            self._next = (self._next + 1) % REMEMBERED
        return ""

    @property
    def _noisy(self) -> bool:
        return self._changed >= NOISY_PICTURES

    def _through_solids(self, sample: Floats32, T: Pose) -> str:
        """Whether too many returns lie behind the first declared solid of their ray."""
        if not len(self._solids.kinds):
            return ""
        if T.tobytes() != self._traced_from:
            self._traced_from = T.tobytes()
            everywhere = np.full(3, 1e3)
            solids = self._solids
            trace_solids(
                self._rays,
                np.ascontiguousarray(T),
                self._noise,
                *self._range,
                -everywhere,
                everywhere,
                (*solids.table[:3], np.full(len(solids.kinds), np.inf)),
                (BEHIND, BEHIND_ANGLE, 3.0),
                np.empty_like(self._last),
                self._last,
            )
        filled = np.isfinite(self._last) & np.isfinite(sample)
        through = filled & (sample > self._last)
        count, of = int(through.sum()), int(filled.sum())
        if count < LEAST_PIXELS or count <= SOLID_SHARE * of:
            return ""
        name = self._which(through, T)
        return f"it sees through declared solids, '{name}' first, at {count / of:.0%} of its pixels"

    def _which(self, through: np.ndarray, T: Pose) -> str:
        """The declared solid that most of these pixels should have ended at."""
        z = self._last[through][:, None] - BEHIND
        points = transform(T, np.concatenate([self._rays[through] * z, z], axis=1).astype(float))
        nearest = np.argmin([s.distance(points) for s in self._solids.solids], axis=0)
        return self._solids.solids[int(np.bincount(nearest).argmax())].name

    def _through_arm(
        self,
        depth: Floats32,
        label: Bytes,
        T: Pose,
        body: BodyPose,
        error: tuple[float, float],
        stamp_error: float,
    ) -> str:
        """Whether too many returns lie behind points deep in the arm."""
        T_base_cells = np.linalg.inv(body.T_cells_base)[self._part]
        in_base = (T_base_cells[:, :3, :3] @ self._inside[:, :, None])[:, :, 0]
        at = transform(inverse(T), in_base + T_base_cells[:, :3, 3])
        slip = body.speed[self._part] * stamp_error
        pixel = self._lens.project(at)
        # Around the point, as far as the arm may be beside it.
        aside = (error[0] + slip) / np.maximum(at[:, 2], 0.1) + error[1]
        room = np.minimum(np.ceil(self._lens.fx * aside), 12).astype(np.int64)
        near, far = self._range
        limit = at[:, 2] + ARM_BEHIND + slip
        # Far beside the picture a lens's distortion folds back: what is there seems in the middle.
        way = at[:, :2] / np.maximum(at[:, 2:], 1e-9)
        beside = ((way < self._view[0]) | (way > self._view[1])).any(axis=1)
        pixel[beside | (at[:, 2] <= near) | (limit >= far)] = np.nan
        seen, through = count_through(depth, label, pixel, limit, room)
        if through < LEAST_POINTS or through <= ARM_SHARE * seen:
            return ""
        return f"it sees through the arm at {through} of {seen} points where the joints put it"


def _deep_points(fields: BodyFields) -> tuple[np.ndarray, Points]:
    """Parts (p,) of the arm and (p, 3) points deep in them, in cells of the parts' grids."""
    parts, points = [], []
    each = max(ARM_POINTS // max(len(fields.offset), 1), 2)
    for m, (start, shape) in enumerate(zip(fields.offset, fields.shape)):
        values = fields.values[start : start + int(np.prod(shape))].reshape(shape)
        if values.min() > -0.5 * ARM_DEEP:
            continue  # a plate: nothing is deep in it
        nodes = np.argwhere(values <= max(-ARM_DEEP, 2 / 3 * float(values.min())))
        # The farthest from those taken, so that they are spread over the part.
        taken = [int(np.argmin(values[tuple(nodes.T)]))]
        gap = np.linalg.norm(nodes - nodes[taken[0]], axis=1)
        while len(taken) < min(each, len(nodes)):
            taken.append(int(np.argmax(gap)))
            gap = np.minimum(gap, np.linalg.norm(nodes - nodes[taken[-1]], axis=1))
        points.append(nodes[taken].astype(float))
        parts.append(np.full(len(taken), m))
    if not parts:
        return np.zeros(0, np.int64), np.zeros((0, 3))
    return np.concatenate(parts), np.concatenate(points)
