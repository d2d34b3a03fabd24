"""From a picture to the arms in it: lumps in the whole, crops, landmarks, kinematics, judgement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import ColorImage, Floats, Floats32
from armsight.errors import RecognitionError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import make_pose
from armsight.recognition.any_arm.best_outline import OUTLINE, best_outlined
from armsight.recognition.any_arm.edges import at_edges
from armsight.recognition.any_arm.evidence import STRIDE, Evidence
from armsight.recognition.any_arm.frames import LOOKS, Lump, find_lumps
from armsight.recognition.any_arm.lens_doubt import doubted
from armsight.recognition.any_arm.model import CropModel, Look
from armsight.recognition.any_arm.observing import observe
from armsight.recognition.any_arm.outline import drawn_into
from armsight.recognition.any_arm.presence import (
    ARM,
    EXPLAINED,
    FOUND,
    STAYS,
    SURE,
    is_arm,
    is_speck,
    may_be_arm,
    sureness,
)
from armsight.recognition.any_arm.sighting import Arm, Intrinsics, Sighting
from armsight.recognition.any_arm.solver import Fit, cost_of, solve
from armsight.recognition.any_arm.trust import LEAD, features, read_trust
from armsight.recognition.any_arm.views import FIRST, Crop, mask_in_picture, take_crop, zoomed
from armsight.recognition.inference.intrinsics import check_size
from armsight.recognition.inference.pictures import Picture
from armsight.robots.catalogue import load_robot
from armsight.robots.robot import Robot

FAINT = 0.15
"""Share of the strongest lump below which another is none."""
MARGIN = 1.3
"""Side of a crop over the arm's box."""
OTHER_MARGINS = (1.0, 1.9)
"""The same of the looks at what is doubtful."""
GOES_ON = 0.25 * FIRST / STRIDE
"""How far an arm that the crop's edge cuts is thought to go on beyond it [cells]."""
TYPES = 2
"""Likeliest types that are fitted."""
RIVAL = 0.2
"""Share of the known types' probability below which a second type is not fitted."""
COMPARED = 5
"""Fits of a type whose outlines are drawn."""
KIND = 16.0
"""Cost of a type for each unit by which the log of its probability is less; chosen likewise."""
ASSUMED_FOV = np.deg2rad(65.0)
"""Field of view along the longer side of a picture that says nothing of its lens: phones' 60 to 70
deg, however they are held."""


@dataclass(frozen=True)
class _Candidate:
    fit: Fit
    overlap: float
    score: float
    kind: float
    mass: float
    points: int
    cost: float
    gap: float

    def features(self, lead: float) -> Floats:
        """Of its trust."""
        C = self.fit.joint_covariances()
        sigma = float(np.sqrt(np.trace(C, axis1=1, axis2=2)).mean())
        return features(
            self.cost, self.points, self.overlap, self.kind, self.mass, sigma, lead, self.gap
        )


class ArmRecogniser:
    """Asks a crop network about pictures.

    Args:
        model: the network.
        robots: the arms in the pictures are among these; else they may be of any type.

    Raises:
        RecognitionError: the network's card does not say how far to trust it, or it does not know
            one of the robots.
    """

    def __init__(self, model: CropModel, robots: Sequence[str] = ()) -> None:
        self.model = model
        self._told = bool(robots)
        self.robots = tuple(dict.fromkeys(robots)) or model.robots
        for name in self.robots:
            if name not in model.robots:
                raise RecognitionError(
                    f"{model.name} does not know {name}, only {', '.join(model.robots)}; "
                    "'armsight extend' adds a robot"
                )
        try:
            self.trust = read_trust(model.card)
        except (KeyError, TypeError, ValueError, OverflowError):
            raise RecognitionError(
                f"{model.name}: its card's trust is damaged; take the original"
            ) from None

    def recognise(self, picture: Picture, camera: PinholeCamera | None = None) -> Sighting:
        """The arms in a picture.

        Args:
            picture: of any size.
            camera: of that picture; None to assume a phone's field of view, of which no distance
                is believed.

        Raises:
            RecognitionError: the network answers with something that is no number, or the camera is
                of pictures of another size.
        """
        h, w = picture.image.shape[:2]
        lens = camera or assumed_lens(w, h)
        check_size(lens, w, h)
        arms: list[Arm] = []
        doubtful: list[tuple[Look, Crop]] = []
        shown = 0
        for longest, least, stays in zip(LOOKS, FOUND, STAYS, strict=True):
            # A small arm is overlooked in the whole; larger, other things look like one, too.
            if arms or max(h, w) <= shown:
                break
            lumps = find_lumps(self.model, picture.image, longest)[0]
            arms = self._arms(picture.image, lens, lumps, least, stays, doubtful)
            shown = longest
        if not arms and doubtful:
            arms = [self._judged(*doubtful[0], lens)[0]]
        arms = [arm for arm in arms if not is_speck(arm.mask, arm.trust)]
        notes = list(picture.notes)
        if not arms:
            notes.append("no robot arm found")
        source = _source(picture, camera)
        if source == "exif":
            notes.append(
                "focal length from the picture's own file: distances may be off by some 5 %"
            )
        if camera is None and arms:
            notes.append(
                "intrinsics assumed (65 deg along the longer side): distances scale with the focal "
                "length"
            )
        notes += [
            f"this {arm.robot} may as well be of the type {other}: they look alike"
            for arm in arms
            for other in arm.alike
        ]
        arms = [doubted(arm, source, self.trust.threshold) for arm in arms]
        arms.sort(key=lambda arm: (arm.believed, float(arm.mask.sum())), reverse=True)
        return Sighting(
            picture.name, tuple(arms), lens.K, np.array(lens.distortion), source, tuple(notes)
        )

    def _arms(
        self,
        image: ColorImage,
        lens: PinholeCamera,
        lumps: Sequence[Lump],
        least: float,
        stays: float,
        doubtful: list[tuple[Look, Crop]],
    ) -> list[Arm]:
        """The arms in lumps of a picture, each once; what may be one is added to ``doubtful``."""
        arms: list[Arm] = []
        for lump in lumps:
            if lump.strength < FAINT * lumps[0].strength:
                break
            look, crop = self.looked(image, lens, lump.low, lump.high)
            sure = is_arm(look, least)
            if not (sure or may_be_arm(look, lump.strength)):
                continue
            arm: Arm | None = None
            if self._mean_sureness(look, crop, image, lens) < stays:
                arm = self._judged(look, crop, lens)[0]
                if arm.overlap < EXPLAINED:
                    continue
            if not sure:
                doubtful.append((look, crop))
                continue
            arm = arm or self._judged(look, crop, lens)[0]
            if not any(_same(arm, other) for other in arms):
                arms.append(arm)
        return arms

    def _mean_sureness(
        self, look: Look, crop: Crop, image: ColorImage, lens: PinholeCamera
    ) -> float:
        """Of a look, and if that is doubtful of nearer, wider and mirrored ones, too.

        What is an arm stays one; what only looks like it, from here, does not.
        """
        first = sureness(look)
        if first >= SURE:
            return first
        images = [zoomed(image, lens, crop, MARGIN / margin).image for margin in OTHER_MARGINS]
        images.append(np.ascontiguousarray(crop.image[:, ::-1]))
        more = [sureness(self.model.look(image)) for image in images]
        return float(np.mean([first, *more]))

    def looked(
        self, image: ColorImage, lens: PinholeCamera, low: Floats, high: Floats
    ) -> tuple[Look, Crop]:
        """Two looks at a box of a picture, the second one aimed at what the first one saw.

        Returns:
            both together, in the second one's crop; the first alone where it saw nothing.
        """
        crop = take_crop(image, lens, low, high, MARGIN, FIRST)
        first = self.model.evidence(crop.image)
        box = _mask_box(first, crop)
        if box is None:
            return self.model.read(first), crop
        aimed = take_crop(image, lens, *_in_picture(crop, lens, *box), MARGIN)
        return self.model.look_again(first, aimed.image, aimed.onto(crop)), aimed

    def examined(
        self, image: ColorImage, lens: PinholeCamera, low: Floats, high: Floats
    ) -> tuple[Arm, Floats] | None:
        """The arm in a box of a picture and the features of its trust; None where there is no pose.

        Args:
            image: the picture.
            lens: that took it.
            low: (2,) upper left corner of the box [px].
            high: (2,) lower right one.
        """
        look, crop = self.looked(image, lens, low, high)
        if not is_arm(look):
            return None
        arm, features = self._judged(look, crop, lens)
        return None if features is None else (arm, features)

    def _judged(self, look: Look, crop: Crop, lens: PinholeCamera) -> tuple[Arm, Floats | None]:
        types = look.types
        sharp = at_edges(look.arm, crop.image)
        if look.stranger and not self._told:
            mask = mask_in_picture(crop, sharp, lens)
            nobody = Arm(
                "unknown", types, mask, None, np.empty(0), np.empty((0, 3)), np.empty((0, 3, 3)),
                0.0, 0.0, False, "an arm that is none of the known ones",
            )  # fmt: skip
            return nobody, None
        known = sorted(self.robots, key=lambda name: -types[name])[:TYPES]
        share = sum(types[name] for name in self.robots)
        candidates: list[tuple[str, _Candidate]] = []
        for name in known:
            if types[name] < RIVAL * share:
                continue
            kind = 1.0 if len(self.robots) == 1 else types[name] / max(share, 1e-6)
            found = self._candidate(look, sharp, crop, name, kind)
            if found is not None:
                candidates.append((name, found))
        if not candidates:
            mask = mask_in_picture(crop, sharp, lens)
            nothing = Arm(
                known[0], types, mask, None, np.empty(0), np.empty((0, 3)),
                np.empty((0, 3, 3)), 0.0, 0.0, False, "too little of the arm is seen for a pose",
                self._alike(look, known[0]),
            )  # fmt: skip
            return nothing, None
        (name, found), *others = sorted(candidates, key=lambda candidate: candidate[1].score)
        lead = min((other.score - found.score for _, other in others), default=LEAD)
        f = found.features(lead)
        alike = self._alike(look, name)
        # Of types that are as likely as each other one is right.
        trust = min(self.trust.of(f), 1.0 / (1 + len(alike)))
        turned = make_pose(crop.R)
        joints = found.fit.joints() @ crop.R.T
        covariance = crop.R @ found.fit.joint_covariances() @ crop.R.T * self.trust.widen**2
        believed = trust >= self.trust.threshold and not alike
        problem = "" if believed else self._doubt(trust, alike)
        T = np.asarray(turned @ found.fit.T_camera_base)
        mask = mask_in_picture(crop, drawn_into(sharp, found.fit, found.overlap, crop), lens)
        arm = Arm(
            name, types, mask, T, found.fit.q, joints, covariance, found.overlap, trust,
            believed, problem, alike,
        )  # fmt: skip
        return arm, f

    def _alike(self, look: Look, name: str) -> tuple[str, ...]:
        """The types that an arm of this one may as well be, of those that are to be had."""
        return tuple(other for other in look.alike if other in self.robots and other != name)

    def _doubt(self, trust: float, alike: tuple[str, ...]) -> str:
        """Why an answer is not believed."""
        if self.trust.threshold >= 1.0:
            return f"I do not know: how far to trust {self.model.name} was never measured"
        if alike:
            return f"I do not know: it may as well be of the type {' or '.join(alike)}; say --robot"
        return f"I do not know: {100 * trust:.0f} % sure that joints are right to 10 cm"

    def _robot(self, name: str) -> Robot:
        """The robot of a type; what the card says of it is believed only as far as it fits.

        Raises:
            RecognitionError, RobotError: there is none, or it has other links than the card says.
        """
        robot = load_robot(name)
        if len(self.model.landmarks[name].middle) != robot.n + 1:
            raise RecognitionError(
                f"{self.model.name}: its card describes another {name} than the one here; take "
                "the original"
            )
        return robot

    def _candidate(
        self, look: Look, arm: Floats32, crop: Crop, name: str, kind: float
    ) -> _Candidate | None:
        """The best fit of a type: landmarks, and of the best ones the outlines."""
        robot, marks = self._robot(name), self.model.landmarks[name]
        seen = observe(look, crop, name, marks)
        fits = solve(robot, marks, seen)[:COMPARED]
        found = best_outlined(fits, seen, arm, crop, self.model.threads)
        if found is None:
            return None
        fit, overlap = found.fit, found.overlap
        cost = cost_of(fit, seen)
        mass = float(look.places[name].mass.mean())
        score = cost + OUTLINE * (1.0 - overlap) - KIND * float(np.log(kind + 1e-3))
        return _Candidate(fit, overlap, score, kind, mass, len(seen.link), cost, found.gap)


def _mask_box(first: Evidence, crop: Crop) -> tuple[Floats, Floats] | None:
    """The box of the arm [px of the crop], None where there is none.

    Where the mask touches the crop's edge the arm goes on: half as much again.
    """
    within = crop.inside[STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE]
    seen = (1.0 - first.surface.links[0] > ARM) & within
    row, column = np.nonzero(seen)
    if not len(row):
        return None
    low = np.array([column.min(), row.min()], float)
    high = np.array([column.max() + 1, row.max() + 1], float)
    low, high = low - GOES_ON * (low == 0), high + GOES_ON * (high == seen.shape[::-1])
    return low * STRIDE, high * STRIDE


def _in_picture(
    crop: Crop, lens: PinholeCamera, low: Floats, high: Floats
) -> tuple[Floats, Floats]:
    """A box of the crop as one of the picture, within it."""
    u, v = np.meshgrid([low[0], high[0]], [low[1], high[1]])
    rays = crop.rays(np.stack([u.ravel(), v.ravel()], 1))
    points = np.hstack([rays, np.ones((4, 1))]) @ crop.R.T
    points[:, 2] = np.maximum(points[:, 2], 0.05)
    pixels = lens.project(points)
    size = np.array([lens.width, lens.height], float)
    return np.clip(pixels.min(axis=0), 0, size), np.clip(pixels.max(axis=0), 0, size)


def _same(a: Arm, b: Arm) -> bool:
    """Whether two lumps led to one arm."""
    x, y = a.mask > ARM, b.mask > ARM
    return bool((x & y).sum() > 0.5 * min(x.sum(), y.sum()))


def _source(picture: Picture, camera: PinholeCamera | None) -> Intrinsics:
    """Where the camera of a picture is from."""
    if camera is None:
        return "assumed"
    return "exif" if camera is picture.camera else "given"


def assumed_lens(w: int, h: int) -> PinholeCamera:
    """Of a w x h picture that says nothing of its lens."""
    f = 0.5 * max(w, h) / float(np.tan(0.5 * ASSUMED_FOV))
    return PinholeCamera(w, h, f, f, 0.5 * (w - 1), 0.5 * (h - 1))
