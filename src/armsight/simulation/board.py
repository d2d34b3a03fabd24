"""Pictures of a calibration board on the flange: colour, infrared and depth, to 0.03 px.

A board drawn by OpenGL's texture filter moves its corners by tenths of a pixel; calibration asks
for hundredths. So the cell is rendered as ever, and the board is cast ray by ray through the true
lens, with many rays a pixel, onto the print as it really is: scaled and bent, lit, glaring,
blurred, noisy. The truth about lenses, offsets, bracket and print is drawn from a seed and known
here alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from armsight.arrays import Bytes, DepthImage, Floats, JointVector, Pose, Vector3
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, inverse
from armsight.simulation.spec import CameraSpec
from armsight.simulation.units import draw_camera
from armsight.simulation.world import SimulatedWorld


@dataclass(frozen=True)
class Print:
    """A printed board.

    Attributes:
        image: (h, w) uint8, the print at ``per_meter`` pixels a metre.
        x0, y0: its first pixel's outer corner in the board's frame [m]; per_meter: [px/m].
        center: (2,) middle of the corners [m]; half: (2,) half their extent [m].
        scale: print error [1]; bend: (2,) bending along x and y at the edge [m].
    """

    image: Bytes
    x0: float
    y0: float
    per_meter: float
    center: tuple[float, float]
    half: tuple[float, float]
    scale: float = 0.0
    bend: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class StudioErrors:
    """How wrong the simulated sensors and the board are; scale 1 as in docs/calibration.md.

    Attributes:
        board: scale of print and bracket errors.
        depth: scale of the depth errors.
        glare: brightness of the lamp's reflection on the board, 0..1.
    """

    board: float = 1.0
    depth: float = 1.0
    glare: float = 0.8


@dataclass(frozen=True)
class DepthErrors:
    """Systematic depth error of one camera (docs/calibration.md).

    Attributes:
        offset: [m]; scale: [1]; wiggle: amplitude [m] and phase [rad] with period 0.9 m;
        corner: at the image's corner, with r squared [m].
    """

    offset: float
    scale: float
    wiggle: float
    phase: float
    corner: float

    def of(self, z: Floats, radius: Floats) -> Floats:
        """Error [m] at depth z [m] and share ``radius`` of the way to the image's corner."""
        ripple = self.wiggle * np.sin(2 * np.pi * z / 0.9 + self.phase)
        return self.offset + self.scale * z + ripple + self.corner * radius**2


@dataclass(frozen=True)
class StudioCamera:
    """The truth about one camera.

    Attributes:
        name: of the camera; model: of the catalogue; rate: frames a second [Hz].
        infrared, color: true lenses; T_infrared_color: colour lens in the infrared lens.
        T_world_infrared: where the infrared (depth) lens stands.
        depth: its systematic depth error.
    """

    name: str
    model: str
    rate: float
    infrared: PinholeCamera
    color: PinholeCamera
    T_infrared_color: Pose
    T_world_infrared: Pose
    depth: DepthErrors


@dataclass(frozen=True)
class Photograph:
    """What one camera saw of the resting arm: several exposures averaged.

    Attributes:
        color, infrared: (h, w) uint8 grey.
        depth: (h, w) float32 [m] on the board, NaN elsewhere, at the infrared lens's resolution.
    """

    color: Bytes
    infrared: Bytes
    depth: DepthImage


class BoardStudio:
    """Takes photographs of a board on the flange of a simulated arm.

    Attributes:
        cameras: the truth about each; for drawing and for scoring only.
        T_flange_board: the true bracket; print: the true board.
    """

    def __init__(
        self,
        world: SimulatedWorld,
        cameras: tuple[CameraSpec, ...],
        board: Print,
        T_flange_board: Pose,
        seed: int = 0,
        errors: StudioErrors | None = None,
        redraw: float = 0.0,
    ) -> None:
        """Set up the studio.

        Args:
            world: with the arm; it needs no cameras of its own.
            cameras: as the cell specifies them.
            board: as designed; its true print errors are drawn here.
            T_flange_board: as designed; the true bracket is drawn here.
            seed: of the truth and of the noise.
            errors: how wrong everything is.
            redraw: the clutter behind the board is drawn anew when a joint has moved by this much
                [rad]; inf draws it once, which is quick.
        """
        errors = errors or StudioErrors()
        self._redraw = redraw
        rng = np.random.default_rng((seed, 77))
        self._world = world
        self._errors = errors
        s = errors.board
        self.print = replace(
            board,
            scale=s * float(rng.normal(0, 0.002)),
            bend=(s * float(rng.normal(0, 3e-4)), s * float(rng.normal(0, 3e-4))),
        )
        off = rng.normal(0, 1, 6) * np.array([0.012, 0.012, 0.012, 0.05, 0.05, 0.05])
        self.T_flange_board = T_flange_board @ exp(s * off)
        self.cameras = tuple(self._camera(c, (seed, 20 + i)) for i, c in enumerate(cameras))
        self._noise = np.random.default_rng((seed, 78))
        self._lamp = np.array([0.6, 0.4, 3.2])  # in world, above the table
        self._backgrounds: dict[tuple[int, bool], tuple[Floats, Bytes]] = {}

    def _camera(self, spec: CameraSpec, seed: tuple[int, ...]) -> StudioCamera:
        """The unit that the seed puts there, as for every other command."""
        unit = draw_camera(replace(spec, errors=True), seed)
        info, errors = spec.info, unit.errors
        assert errors is not None
        infrared = unit.infrared(info.infrared_scale or 1)
        return StudioCamera(
            info.name,
            info.model,
            info.rate,
            infrared,
            unit.color if unit.color is not None else infrared,
            unit.T_depth_color,
            unit.T_mount_camera,
            DepthErrors(errors.offset, errors.scale, errors.wiggle, errors.phase, errors.radial),
        )

    def flange(self) -> Pose:
        """``T_world_flange`` as it truly is now."""
        world = self._world
        world._settle()
        body = int(world._cell.link_bodies[-1])
        T = np.eye(4)
        T[:3, :3] = world._data.xmat[body].reshape(3, 3)
        T[:3, 3] = world._data.xpos[body]
        return np.asarray(T @ world.spec.arm.robot.T_last_flange)

    def place(self, joints: JointVector) -> None:
        """Put the arm at joint angles at once, without moving it there: for pools of photographs.

        The arm's sag and the error of its rest are not simulated then.
        """
        self._world._data.qpos[: len(joints)] = joints

    def photograph(
        self, index: int, frames: int = 5, blur_px: float = 0.0, color: bool = True
    ) -> Photograph:
        """What a camera sees now.

        Args:
            index: of the camera.
            frames: exposures averaged (depth: their mean).
            blur_px: extra blur, as of a moving arm or a dirty lens.
            color: whether the colour picture is wanted; else it is black.
        """
        camera = self.cameras[index]
        T_world_board = self.flange() @ self.T_flange_board
        infrared = self._picture(
            index,
            False,
            camera.infrared,
            camera.T_world_infrared,
            T_world_board,
            0.65 + blur_px,
            5.0 / np.sqrt(frames),
        )
        image = np.zeros((camera.color.height, camera.color.width), np.uint8)
        if color:
            T = camera.T_world_infrared @ camera.T_infrared_color
            image = self._picture(
                index, True, camera.color, T, T_world_board, 0.6 + blur_px, 3.0 / np.sqrt(frames)
            )
        return Photograph(image, infrared, self._depth(camera, T_world_board, frames))

    # ------------------------------------------------------------------ brightness

    def _picture(
        self,
        index: int,
        is_color: bool,
        lens: PinholeCamera,
        T_world_lens: Pose,
        T_world_board: Pose,
        blur: float,
        noise: float,
    ) -> Bytes:
        image = self._background(index, is_color, lens, T_world_lens).astype(np.float32)
        T = inverse(T_world_lens) @ T_world_board
        box = self._box(lens, T)
        if box is not None and T[2, 2] > 0.05:
            u0, v0, u1, v1 = box
            roi = image[v0:v1, u0:u1]
            paper, cover = self._cast(lens, T, box)
            hidden = self._hidden(lens, T_world_lens, T, box)
            light, glare = self._light(T_world_lens, T_world_board, lens, box, is_color)
            drawn = np.minimum(paper * light + glare, 255.0)
            cover = cover * (1.0 - hidden)
            roi[:] = roi * (1 - cover) + drawn * cover
            pad = 6
            a, b = max(v0 - pad, 0), max(u0 - pad, 0)
            region = image[a : v1 + pad, b : u1 + pad]
            region[:] = cv2.GaussianBlur(region, (0, 0), blur)
        image += noise * self._noise.standard_normal(image.shape, dtype=np.float32)
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)

    def _background(
        self, index: int, is_color: bool, lens: PinholeCamera, T_world_lens: Pose
    ) -> Bytes:
        """The cell in grey; redrawn when the arm has moved, at half size (it is only clutter)."""
        q = np.array(self._world._data.qpos[: self._world.spec.arm.robot.n])
        held = self._backgrounds.get((index, is_color))
        if held is not None and np.abs(held[0] - q).max() <= max(self._redraw, 1e-4):
            return held[1]
        small = lens.scaled(0.25 if lens.width > 1000 else 0.5)
        color = self._world.picture(T_world_lens, small)
        gray = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
        full = np.asarray(
            cv2.resize(gray, (lens.width, lens.height), interpolation=cv2.INTER_LINEAR), np.uint8
        )
        self._backgrounds[index, is_color] = (q, full)
        return full

    def _light(
        self,
        T_world_lens: Pose,
        T_world_board: Pose,
        lens: PinholeCamera,
        box: tuple[int, int, int, int],
        is_color: bool,
    ) -> tuple[Floats, Floats]:
        """Brightness of the paper by the lamp (or the camera's own infrared), and its glare."""
        u0, v0, u1, v1 = box
        normal = -T_world_board[:3, 2]
        at = T_world_board[:3, 3]
        eye = T_world_lens[:3, 3]
        source = self._lamp if is_color else eye
        toward = _unit(source - at)
        light = 0.5 + 0.4 * max(float(normal @ toward), 0.0)
        step = 8
        v, u = np.mgrid[v0 : v1 + step : step, u0 : u1 + step : step]
        rays = np.column_stack(
            [(u.ravel() - lens.cx) / lens.fx, (v.ravel() - lens.cy) / lens.fy, np.ones(u.size)]
        )
        rays = rays @ T_world_lens[:3, :3].T
        t = ((at - eye) @ normal) / np.minimum(rays @ normal, -1e-6)
        hit = eye + rays * np.abs(t)[:, None]
        to_eye = eye - hit
        to_source = source - hit
        half = _rows(_rows(to_eye) + _rows(to_source))
        angle = np.arccos(np.clip(half @ normal, -1, 1))
        lobe = np.exp(-((angle / np.deg2rad(6.0)) ** 2)).reshape(u.shape)
        spot = cv2.resize(
            lobe.astype(np.float32),
            (u.shape[1] * step, u.shape[0] * step),
            interpolation=cv2.INTER_LINEAR,
        )[: v1 - v0, : u1 - u0]
        strength = 200.0 * self._errors.glare * (1.0 if is_color else 0.6)
        return np.full((1, 1), light), np.asarray(strength * spot, np.float64)

    # ------------------------------------------------------------------ geometry

    def _box(self, lens: PinholeCamera, T: Pose) -> tuple[int, int, int, int] | None:
        """Pixels that the print may touch: u0, v0, u1, v1, or None."""
        p = self.print
        h, w = p.image.shape
        x = p.x0 + np.array([0, w, w, 0, w / 2, w, w / 2, 0]) / p.per_meter
        y = p.y0 + np.array([0, 0, h, h, 0, h / 2, h, h / 2]) / p.per_meter
        corners = np.column_stack([x, y, np.zeros(8)]) @ T[:3, :3].T + T[:3, 3]
        if corners[:, 2].min() < 0.1:
            return None
        around = np.hypot(corners[:, 0], corners[:, 1]) / corners[:, 2]
        if around.max() > 1.3 * np.hypot(lens.width, lens.height) / (2 * lens.fx):
            return None
        uv = lens.project(corners)
        u0, v0 = np.floor(uv.min(0)).astype(int) - 6
        u1, v1 = np.ceil(uv.max(0)).astype(int) + 7
        u0, v0, u1, v1 = max(u0, 0), max(v0, 0), min(u1, lens.width), min(v1, lens.height)
        return (u0, v0, u1, v1) if u1 - u0 > 4 and v1 - v0 > 4 else None

    def _cast(
        self, lens: PinholeCamera, T: Pose, box: tuple[int, int, int, int]
    ) -> tuple[Floats, Floats]:
        """Mean paper brightness (0..255) and cover (0..1) of each pixel, many rays a pixel."""
        u0, v0, u1, v1 = box
        # One pixel more all about, so that rays between pixel centres can be interpolated.
        pad = lens_rays(lens, u0 - 1, v0 - 1, u1 + 1, v1 + 1)
        size = (u1 - u0) * (v1 - v0)
        n = 6 if size < 20_000 else 4
        total = np.zeros((v1 - v0, u1 - u0))
        cover = np.zeros_like(total)
        offsets = (np.arange(n) + 0.5) / n - 0.5
        for dv in offsets:
            for du in offsets:
                ray = _between(pad, float(du), float(dv))
                value, inside = self._paper(T, ray)
                total += value * inside
                cover += inside
        mean = np.where(cover > 0, total / np.maximum(cover, 1), 0.0)
        return mean, cover / n**2

    def _paper(self, T: Pose, ray: Floats) -> tuple[Floats, Floats]:
        """Brightness where rays (h, w, 2) meet the bent print, and whether they meet it."""
        p = self.print
        x, y, _ = self._meet(T, ray)
        column = _whole((x / (1 + p.scale) - p.x0) * p.per_meter)
        row = _whole((y / (1 + p.scale) - p.y0) * p.per_meter)
        h, w = p.image.shape
        inside = (column >= 0) & (column < w) & (row >= 0) & (row < h)
        value = p.image[np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)]
        return np.asarray(20.0 + value * (225.0 / 255.0)), np.asarray(inside, np.float64)

    def _meet(self, T: Pose, ray: Floats) -> tuple[Floats, Floats, Floats]:
        """Board x, y and depth along the axis [m] where (h, w, 2) rays meet the print."""
        R_t = T[:3, :3].T
        origin = -R_t @ T[:3, 3]
        d = ray @ R_t[:, :2].T + R_t[:, 2]
        p = self.print
        z = np.zeros(ray.shape[:2])
        x = y = t = z
        down = np.where(np.abs(d[..., 2]) < 1e-6, 1e-6, d[..., 2])
        for _ in range(3 if any(p.bend) else 1):
            t = (z - origin[2]) / down
            x, y = origin[0] + t * d[..., 0], origin[1] + t * d[..., 1]
            a, b = (
                (x / (1 + p.scale) - p.center[0]) / p.half[0],
                (y / (1 + p.scale) - p.center[1]) / p.half[1],
            )
            z = p.bend[0] * (a * a - 1 / 3) + p.bend[1] * (b * b - 1 / 3)
        return x, y, t

    def _hidden(
        self, lens: PinholeCamera, T_world_lens: Pose, T: Pose, box: tuple[int, int, int, int]
    ) -> Floats:
        """Share of each pixel of the box that a part of the arm hides from the lens."""
        small = lens.scaled(192 / lens.width)
        world = self._world
        shot = world.renderer.take(world._data, T_world_lens, small)
        depth = world.renderer.depth(shot, small).depth
        world.renderer.give_back(shot)
        _, _, plane = self._meet(T, small.rays)
        nearer = (depth < plane - 0.015).astype(np.float32)
        nearer[~np.isfinite(depth)] = 0.0
        full = cv2.resize(nearer, (lens.width, lens.height), interpolation=cv2.INTER_LINEAR)
        u0, v0, u1, v1 = box
        return np.asarray(full[v0:v1, u0:u1], float)

    # ------------------------------------------------------------------ depth

    def _depth(self, camera: StudioCamera, T_world_board: Pose, frames: int) -> DepthImage:
        """Depth on the board with the camera's errors; NaN elsewhere."""
        lens = camera.infrared
        z = np.full((lens.height, lens.width), np.nan)
        T = inverse(camera.T_world_infrared) @ T_world_board
        box = self._box(lens, T)
        if box is None or T[2, 2] <= 0.05:
            return z.astype(np.float32)
        dark = np.zeros(z.shape, bool)
        u0, v0, u1, v1 = box
        ray = lens_rays(lens, u0, v0, u1, v1)
        value, inside = self._paper(T, ray)
        _, _, plane = self._meet(T, ray)
        hidden = self._hidden(lens, camera.T_world_infrared, T, box)
        front = (inside > 0) & (hidden < 0.5)
        z[v0:v1, u0:u1][front] = plane[front]
        dark[v0:v1, u0:u1] = front & (value < 100)
        cosine = abs(float(_unit(T[:3, 3]) @ T[:3, 2]))
        angle = float(np.arccos(min(cosine, 1.0)))
        v, u = np.mgrid[0 : lens.height, 0 : lens.width]
        radius = np.hypot((u - lens.cx) / lens.cx, (v - lens.cy) / lens.cy) / np.sqrt(2)
        g = angle**2 / max(np.pi / 2 - angle, 0.1) ** 2
        if "v2" in camera.model:
            sigma = 1e-3 * (1.5 - 0.5 * z + 0.3 * z**2 + 0.1 * z**1.5 * g)
        else:
            sigma = 1e-3 * (1.2 + 1.9 * (z - 0.4) ** 2 + 0.1 * g / np.sqrt(np.maximum(z, 0.1)))
        sigma = sigma * np.where(dark, 3.0, 1.0) * self._errors.depth / np.sqrt(frames)
        bias = camera.depth.of(z, radius) + np.where(dark, 0.004 * self._errors.depth, 0.0)
        # One error of the whole frame (modulation, temperature) that no averaging removes.
        whole = 5e-4 * self._errors.depth * self._noise.standard_normal()
        out = z + bias + whole + sigma * self._noise.standard_normal(z.shape)
        out[~((z > 0.4) & (z < 4.5))] = np.nan
        return out.astype(np.float32)


def lens_rays(lens: PinholeCamera, u0: int, v0: int, u1: int, v1: int) -> Floats:
    """(v1 - v0, u1 - u0, 2) normalised coordinates of a window's pixel centres."""
    v, u = np.mgrid[v0:v1, u0:u1].astype(float)
    rays = lens.normalise(np.stack([u, v], -1).reshape(-1, 2))
    return np.asarray(rays.reshape(v1 - v0, u1 - u0, 2))


def _between(pad: Floats, du: float, dv: float) -> Floats:
    """Rays at pixel centres shifted by du, dv (within half a pixel), from rays one pixel wider."""
    a = pad[:, 1:-1] + (
        du * (pad[:, 2:] - pad[:, 1:-1]) if du >= 0 else -du * (pad[:, :-2] - pad[:, 1:-1])
    )
    return np.asarray(a[1:-1] + (dv * (a[2:] - a[1:-1]) if dv >= 0 else -dv * (a[:-2] - a[1:-1])))


def _unit(v: Vector3) -> Vector3:
    return np.asarray(v / max(float(np.linalg.norm(v)), 1e-12))


def _rows(v: Floats) -> Floats:
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12))


def _whole(x: Floats) -> Floats:
    """Whole numbers below; far outside the print (a ray along the board) is -1."""
    return np.asarray(np.floor(np.nan_to_num(np.clip(x, -1.0, 1e6), nan=-1.0)).astype(np.int64))
