"""A camera's pose from depth of the arm: trimmed point-to-plane registration of its surface.

A depth camera sees the arm at known joint angles. The surface that it should see is drawn from the
current pose, each pixel's reading is compared with the surface along its normal (Chen and Medioni
1992; projective association: Blais and Levine 1995), and readings far from it belong to something
else: a person, the table, a hose. What the camera reads too much is solved for, too, held by its
usual size, so that the answer's covariance holds it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import DepthImage, Floats, Floats32, Pose, Poses, Vector3
from armsight.devices.data import DepthNoise
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, inverse, transform
from armsight.recognition.own_arm.answer import DepthView, OwnArmPose, spread
from armsight.recognition.own_arm.arm_errors import (
    TYPICAL,
    ArmErrors,
    in_camera,
    link_errors,
    link_places,
)
from armsight.recognition.own_arm.covariance import clustered_covariance, considered
from armsight.recognition.own_arm.kernels import agreement, lens_array, normal_equations
from armsight.recognition.own_arm.starts import best_apart, climb, scattered
from armsight.recognition.own_arm.surface import ArmSurface, Rendered, render

UNSEEN = "the arm is hardly seen"
WARPS: tuple[Callable[[Floats, Floats, Floats], Floats], ...] = (
    lambda x, y, z: x,
    lambda x, y, z: y,
    lambda x, y, z: 2.0 * (x * x + y * y),
    lambda x, y, z: z - 1.5,
    lambda x, y, z: np.sin(2.0 * np.pi * z / 0.9),
    lambda x, y, z: np.cos(2.0 * np.pi * z / 0.9),
)
"""How a depth error differs over the picture and with the distance: tilts, corners, scale, and the
wave of a modulated light (of 0.9 m in a Kinect v2)."""


@dataclass(frozen=True)
class DepthOptions:
    """How the registration works.

    Attributes:
        bias: standard deviation of what the camera reads too much or too little [m]; 0.02 for one
            that was never calibrated.
        warp: share of it by which that differs from place to place, in each of :data:`WARPS`.
        arm: how far the arm is from what it says.
        shift, turn: how far an old pose may be off at the arm [m] and in direction [rad].
        starts: poses that are tried about an old one; followed: of these, to the end.
        windows: distances beyond which a reading is no part of the arm, one an iteration [m].
        drawn: width of the pictures in which the arm is drawn [px].
        least_score, least_seen, most_sigma: what an answer must reach to be believed: see
            :class:`Confirmation`; the standard deviation on the arm [m].
    """

    bias: float = 0.004
    warp: float = 0.25
    arm: ArmErrors = TYPICAL
    shift: float = 0.10
    turn: float = 0.09
    starts: int = 1500
    followed: int = 6
    windows: tuple[float, ...] = (
        0.08,
        0.06,
        0.05,
        0.04,
        0.03,
        0.03,
        0.025,
        0.025,
        0.02,
        0.02,
        0.02,
    )
    drawn: int = 256
    least_score: float = 0.6
    least_seen: float = 0.2
    most_sigma: float = 0.015


@dataclass(frozen=True)
class MovingDepth:
    """Depth images in which what moves is worth more than what stands.

    Attributes:
        depths: (f, h, w) [m]; credit: (f, h, w) what a pixel is worth.
    """

    depths: Floats32
    credit: Floats32


class DepthScene:
    """Depth views of the arm by one standing camera, ready to be compared with poses of it."""

    def __init__(
        self,
        surface: ArmSurface,
        lens: PinholeCamera,
        noise: DepthNoise,
        views: Sequence[DepthView],
        options: DepthOptions,
    ) -> None:
        if not views:
            raise ValueError("no view of the arm: at least one is needed")
        self.surface, self.lens, self.options, self.views = surface, lens, options, tuple(views)
        self.array = lens_array(lens)
        self.sigma = np.array([noise.a, noise.b, noise.c])
        self.depths = np.stack([without_edges(v.depth) for v in views])
        self.corners = [surface.posed(v.joints) for v in views]
        posed = [surface.posed_points(v.joints) for v in views]
        self.points = np.stack([p for p, _ in posed])
        self.normals = np.stack([n for _, n in posed])
        self.pivot: Vector3 = self.points.reshape(-1, 3).mean(axis=0)
        self._worth = np.ones(self.depths.shape, np.float32)
        factor = options.drawn / lens.width
        straight = PinholeCamera(lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy)
        self.small = straight.scaled(factor)

    def agreement(
        self, poses: Poses, tolerance: float, points: int, moving: MovingDepth | None = None
    ) -> Floats:
        """(k,) how well the views agree with (k, 4, 4) poses, by about so many points a view."""
        step = max(self.points.shape[1] // points, 1)
        return agreement(
            np.ascontiguousarray(poses),
            np.ascontiguousarray(self.points[:, ::step]),
            np.ascontiguousarray(self.normals[:, ::step]),
            self.depths if moving is None else moving.depths,
            self._worth if moving is None else moving.credit,
            self.array,
            tolerance,
        )

    def drawn(self, frame: int, T_camera_base: Pose) -> Rendered:
        """The arm of a view as the camera would see it."""
        size = (self.small.width, self.small.height)
        return render(
            self.surface, self.corners[frame], T_camera_base, lens_array(self.small), size
        )


def register_depth(
    surface: ArmSurface,
    lens: PinholeCamera,
    noise: DepthNoise,
    views: Sequence[DepthView],
    start: Pose,
    options: DepthOptions | None = None,
    seed: int = 0,
) -> OwnArmPose:
    """The pose of a depth camera from an old one and what it sees of the arm.

    Args:
        surface: of the arm.
        lens: of the depth images.
        noise: random error of its readings.
        views: at least one; more poses of the arm say more.
        start: ``T_base_camera`` as it was believed.
        options: how.
        seed: of the starts that are tried.

    Raises:
        ValueError: there is no view.
    """
    scene = DepthScene(surface, lens, noise, views, options or DepthOptions())
    return follow(scene, near_starts(scene, inverse(start), np.random.default_rng(seed)))


def near_starts(scene: DepthScene, T_camera_base: Pose, rng: np.random.Generator) -> list[Pose]:
    """The best few poses about an old one."""
    o = scene.options
    poses = scattered(T_camera_base, scene.pivot, o.shift, o.turn, o.starts, rng)
    scores = scene.agreement(poses, 0.03, 250)
    chosen = best_apart(poses, scores, scene.pivot, o.followed)
    return better(scene, [poses[k] for k in chosen], rng)


def better(scene: DepthScene, poses: Sequence[Pose], rng: np.random.Generator) -> list[Pose]:
    """Each pose a little better, the best first."""
    found = []
    for pose in poses:

        def score(candidates: Poses) -> Floats:
            return scene.agreement(candidates, 0.02, 300)

        found.append(climb(pose, scene.pivot, score, 0.03, 0.05, 5, 60, rng))
    return [pose for pose, _ in sorted(found, key=lambda f: -f[1])]


def follow(scene: DepthScene, starts: Sequence[Pose]) -> OwnArmPose:
    """The answer that agrees best among those that the starts lead to."""
    # Agreement alone would prefer an arm that is nearly hidden; what is seen counts as well.
    return max((_refined(scene, T) for T in starts), key=lambda a: a.score * a.seen)


def _refined(scene: DepthScene, T_camera_base: Pose) -> OwnArmPose:
    """Gauss-Newton from one start."""
    T, bias, o = T_camera_base.copy(), 0.0, scene.options
    links = scene.surface.robot.n + 1
    count = len(scene.views)
    whole: Floats = np.zeros((7, 7))
    H: Floats = np.zeros((count * links, 7, 7))
    g: Floats = np.zeros((count * links, 7))
    used = 0
    for window in o.windows:
        H, g, used = np.zeros_like(H), np.zeros_like(g), 0
        for k in range(count):
            drawn = scene.drawn(k, T)
            if not len(drawn.points):
                continue
            _, n = normal_equations(
                T,
                bias,
                drawn.points,
                drawn.normals,
                drawn.owner + k * links,
                scene.depths[k],
                scene.lens.rays,
                scene.array,
                window,
                scene.sigma,
                H,
                g,
            )
            used += n
        whole = H.sum(axis=0)
        whole[6, 6] += 1.0 / o.bias**2
        gradient = g.sum(axis=0)
        gradient[6] += bias / o.bias**2
        if used < 60:
            break
        damped = whole + 1e-6 * np.diag(np.diag(whole)) + 1e-9 * np.eye(7)
        step = np.linalg.solve(damped, -gradient)
        T = exp(step[:6]) @ T
        bias += float(step[6])
    if used < 60:
        nothing = np.full((6, 6), np.nan)
        return OwnArmPose(inverse(T), nothing, np.inf, -1.0, 0.0, bias, count, UNSEEN)
    covariance = clustered_covariance(whole, g)[:6, :6] + _considered(scene, T, H, whole)
    return _judged(scene, T, bias, covariance)


def _judged(scene: DepthScene, T: Pose, bias: float, covariance: Floats) -> OwnArmPose:
    """The answer, and whether it is to be believed."""
    o = scene.options
    found = confirmation(scene, T, bias)
    points = scene.points.reshape(-1, 3)[:: max(scene.points.size // 600, 1)]
    sigma = spread(covariance, T, points)
    problem = ""
    if found.score < o.least_score:
        share = 50 * (1 + found.score)
        problem = f"only {share:.0f} % of what is seen there is the arm, the rest looks through it"
    elif found.seen < o.least_seen:
        problem = f"only {100 * found.seen:.0f} % of the arm is seen"
    elif not sigma < o.most_sigma:
        problem = f"what is seen leaves {1e3 * sigma:.0f} mm open; show other poses of the arm"
    return OwnArmPose(
        inverse(T), covariance, sigma, found.score, found.seen, bias, len(scene.views), problem
    )


def _considered(scene: DepthScene, T: Pose, H: Floats, whole: Floats) -> Floats:
    """(6, 6) what errors of the arm and of the sensor add that no pixel knows of."""
    robot, o = scene.surface.robot, scene.options
    joints = [view.joints for view in scene.views]
    H = H.reshape(len(joints), -1, 7, 7)
    twists = in_camera(link_errors(robot, joints, o.arm), T)
    arm = np.einsum("vlab,vlbm->am", H[..., :6], twists)
    x, y, z = np.moveaxis(link_places(robot, joints, T), -1, 0)
    shapes = np.stack([shape(x / z, y / z, z) for shape in WARPS], axis=-1)
    warp = o.warp * o.bias * np.einsum("vla,vlm->am", H[..., 6], shapes)
    return considered(whole, np.hstack([arm, warp]))[:6, :6]


@dataclass(frozen=True)
class Confirmation:
    """How an arm drawn at a pose compares with the readings.

    Attributes:
        agree, through, drawn: pixels of the arm that are confirmed, that are seen through, and all.
    """

    agree: int
    through: int
    drawn: int

    @property
    def score(self) -> float:
        """Share of what speaks for the pose of all that speaks, -1..1; what hides says nothing."""
        return (self.agree - self.through) / max(self.agree + self.through, 1)

    @property
    def seen(self) -> float:
        """Share of the arm that is confirmed."""
        return self.agree / max(self.drawn, 1)


def confirmation(scene: DepthScene, T_camera_base: Pose, bias: float) -> Confirmation:
    """Compare the arm, drawn at a pose, with all views."""
    agree, through, count = 0, 0, 0
    for k in range(len(scene.views)):
        drawn = scene.drawn(k, T_camera_base)
        count += max(len(drawn.points), 40)
        p = transform(T_camera_base, drawn.points)
        pixel = np.round(scene.lens.project(p))
        h, w = scene.depths[k].shape
        inside = (pixel >= 0).all(1) & (pixel[:, 0] < w) & (pixel[:, 1] < h)
        u, v = pixel[inside].astype(int).T
        z = p[inside, 2]
        off = scene.depths[k][v, u] - bias - z
        a, b, c = scene.sigma
        tolerance = 0.008 + 3.0 * (a + b * z + c * z * z)
        with np.errstate(invalid="ignore"):
            agree += int((np.abs(off) < tolerance).sum())
            through += int((off > np.maximum(2.0 * tolerance, 0.03)).sum())
    return Confirmation(agree, through, count)


def without_edges(depth: DepthImage, step: float = 0.03) -> DepthImage:
    """The image without pixels at jumps of depth, which mix both sides (flying pixels)."""
    d = np.asarray(depth, np.float32)
    bad = np.zeros(d.shape, bool)
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            jump = np.abs(np.diff(d, axis=axis)) > step * np.minimum(
                np.take(d, range(d.shape[axis] - 1), axis),
                np.take(d, range(1, d.shape[axis]), axis),
            )
            if axis == 0:
                bad[:-1] |= jump
                bad[1:] |= jump
            else:
                bad[:, :-1] |= jump
                bad[:, 1:] |= jump
    return np.where(bad, np.float32(np.nan), d)
