"""Pictures of a cell in which a printed board hangs: its corners are right to 0.03 px.

A board drawn by OpenGL's texture filter moves its corners by tenths of a pixel; calibration asks
for hundredths. So OpenGL draws the cell, and the print is cast ray by ray through the true lens,
with many rays a pixel, onto the sheet as it really is: scaled and bent, lit, glaring, blurred. What
stands before the board hides it. The cell behind is only clutter to whoever looks for a board, and
is drawn coarsely; without a board in the cell pictures are as fine as ever.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats, Floats32, Pose
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, unit
from armsight.simulation.board import BoardUnit, board_window
from armsight.simulation.print_kernels import cast_print
from armsight.simulation.rendering import Renderer, Shot

PictureKind = Literal["color", "infrared"]
LAMP = np.array([0.6, 0.4, 3.2])
"""Where the lamp hangs, in world [m]; a camera's infrared light sits at its lens."""
BLUR = {"color": 0.6, "infrared": 0.65}
"""Of the optics, standard deviation [px]."""
NOISE = {"color": 3.0, "infrared": 5.0}
"""Of a single exposure, standard deviation [grey levels]."""
GLARE_WIDTH = np.deg2rad(6.0)
"""Of the lamp's reflection on the paper [rad]."""
HIDES = 0.015
"""What is nearer than the board by this much hides it [m]."""
STILL = 2e-6
"""Within this motion of every joint a picture is the same [rad]."""


@dataclass(frozen=True)
class Exposure:
    """The cell at one instant before one lens, to be developed later.

    Attributes:
        kind: of the picture; lens: true one; T_world_lens: its pose.
        scene: the cell as OpenGL will draw it; scene_lens: how coarsely.
        nearer: what may stand before the board, with its lens; None with no board in view.
        T_world_board: where the board is then; None with no board in view.
        window: u0, v0, u1, v1 of the board in the picture.
    """

    kind: PictureKind
    lens: PinholeCamera
    T_world_lens: Pose
    scene: Shot
    scene_lens: PinholeCamera
    nearer: tuple[Shot, PinholeCamera] | None
    T_world_board: Pose | None
    window: tuple[int, int, int, int]


class BoardPictures:
    """Takes and develops pictures of a cell with a board."""

    def __init__(self, renderer: Renderer, board: BoardUnit) -> None:
        self._renderer = renderer
        self._board = board

    def take(
        self,
        data: Any,
        T_world_lens: Pose,
        lens: PinholeCamera,
        kind: PictureKind,
        T_world_board: Pose,
    ) -> Exposure:
        """Freeze the cell as ``data`` has it; :meth:`develop` may run in another thread."""
        coarse = lens.scaled(0.25 if lens.width > 1000 else 0.5)
        scene = self._renderer.take(data, T_world_lens, coarse, "color")
        T = inverse(T_world_lens) @ T_world_board
        window = board_window(self._board.print, lens, T)
        if window is None:
            return Exposure(kind, lens, T_world_lens, scene, coarse, None, None, (0, 0, 0, 0))
        small = lens.scaled(192 / lens.width)
        nearer = self._renderer.take(data, T_world_lens, small)
        return Exposure(
            kind, lens, T_world_lens, scene, coarse, (nearer, small), T_world_board, window
        )

    def develop(self, exposure: Exposure) -> Bytes:
        """The picture without noise: (h, w, 3) RGB in colour, (h, w) grey in infrared; uint8."""
        renderer, lens = self._renderer, exposure.lens
        color = renderer.color(exposure.scene, exposure.scene_lens, shadows=False)
        renderer.give_back(exposure.scene)
        if exposure.kind == "infrared":
            color = np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), np.uint8)
        fine = cv2.resize(color, (lens.width, lens.height), interpolation=cv2.INTER_LINEAR)
        image: Floats32 = np.asarray(fine, np.float32)
        if exposure.T_world_board is not None and exposure.nearer is not None:
            self._draw(image, exposure, exposure.T_world_board, exposure.nearer)
        return np.rint(image).astype(np.uint8)

    def _draw(
        self,
        image: Floats32,
        exposure: Exposure,
        T_world_board: Pose,
        nearer: tuple[Shot, PinholeCamera],
    ) -> None:
        """Put the board into a picture."""
        lens, (u0, v0, u1, v1) = exposure.lens, exposure.window
        T = np.ascontiguousarray(inverse(exposure.T_world_lens) @ T_world_board)
        paper = np.empty((v1 - v0, u1 - u0), np.float32)
        cover = np.empty_like(paper)
        samples = 6 if paper.size < 20_000 else 4
        rays = lens_rays(lens, u0 - 1, v0 - 1, u1 + 1, v1 + 1)
        cast_print(rays, T, self._board.print.image, self._board.sheet, samples, paper, cover)
        cover *= 1.0 - self._hidden(exposure, T, nearer)
        light, glare = self._light(exposure, T_world_board)
        drawn = np.minimum(paper * np.float32(light) + glare, np.float32(255.0))
        if image.ndim == 3:
            drawn, cover = drawn[..., None], cover[..., None]
        part = image[v0:v1, u0:u1]
        part[:] = part * (1 - cover) + drawn * cover
        pad = 6
        around = image[max(v0 - pad, 0) : v1 + pad, max(u0 - pad, 0) : u1 + pad]
        around[:] = cv2.GaussianBlur(around, (0, 0), BLUR[exposure.kind])

    def _hidden(
        self, exposure: Exposure, T_lens_board: Pose, nearer: tuple[Shot, PinholeCamera]
    ) -> Floats32:
        """Share of each pixel of the window that something hides from the lens."""
        (shot, small), lens = nearer, exposure.lens
        depth = self._renderer.depth(shot, small).depth
        self._renderer.give_back(shot)
        n, p = T_lens_board[:3, 2], T_lens_board[:3, 3]
        rays = np.concatenate([small.rays, np.ones((*small.rays.shape[:2], 1))], axis=2)
        with np.errstate(invalid="ignore", divide="ignore"):
            hides = depth < (n @ p) / (rays @ n) - HIDES
        full = cv2.resize(
            hides.astype(np.float32), (lens.width, lens.height), interpolation=cv2.INTER_LINEAR
        )
        u0, v0, u1, v1 = exposure.window
        return np.asarray(full[v0:v1, u0:u1], np.float32)

    def _light(self, exposure: Exposure, T_world_board: Pose) -> tuple[float, Floats32]:
        """Brightness of the paper by the lamp (or the camera's own infrared), and its glare."""
        lens, (u0, v0, u1, v1) = exposure.lens, exposure.window
        normal, at = -T_world_board[:3, 2], T_world_board[:3, 3]
        R, eye = exposure.T_world_lens[:3, :3], exposure.T_world_lens[:3, 3]
        source = LAMP if exposure.kind == "color" else eye
        light = 0.5 + 0.4 * max(float(normal @ unit(source - at)), 0.0)
        step = 8
        v, u = np.mgrid[v0 : v1 + step : step, u0 : u1 + step : step]
        flat = [(u.ravel() - lens.cx) / lens.fx, (v.ravel() - lens.cy) / lens.fy, np.ones(u.size)]
        rays = np.column_stack(flat) @ R.T
        far = ((at - eye) @ normal) / np.minimum(rays @ normal, -1e-6)
        hit = eye + rays * np.abs(far)[:, None]
        half = _rows(_rows(eye - hit) + _rows(source - hit))
        angle = np.arccos(np.clip(half @ normal, -1, 1))
        lobe = np.exp(-((angle / GLARE_WIDTH) ** 2)).reshape(u.shape).astype(np.float32)
        size = (u.shape[1] * step, u.shape[0] * step)
        spot = cv2.resize(lobe, size, interpolation=cv2.INTER_LINEAR)[: v1 - v0, : u1 - u0]
        strength = 200.0 * self._board.glare * (1.0 if exposure.kind == "color" else 0.6)
        return light, np.asarray(np.float32(strength) * spot, np.float32)


class Noise:
    """Noise of single exposures, cheaply: windows of one field of noise at random places."""

    SPARE = 512

    def __init__(self, lens: PinholeCamera, kind: PictureKind, seed: tuple[int, ...]) -> None:
        rng = np.random.default_rng(seed)
        shape = (lens.height + self.SPARE, lens.width + self.SPARE)
        drawn = np.rint(NOISE[kind] * rng.standard_normal(shape, dtype=np.float32))
        fields = [np.clip(sign * drawn, 0, 255).astype(np.uint8) for sign in (1, -1)]
        if kind == "color":  # the same in all three colours
            fields = [np.repeat(field[..., None], 3, axis=2) for field in fields]
        self._brighter, self._darker = fields
        self._size = (lens.height, lens.width)
        self._seed = seed

    def on(self, image: Bytes, sequence: int) -> Bytes:
        """A picture as the exposure of this number shows it."""
        v, u = np.random.default_rng((*self._seed, sequence)).integers(0, self.SPARE, 2)
        at = slice(v, v + self._size[0]), slice(u, u + self._size[1])
        brighter = cv2.add(image, np.ascontiguousarray(self._brighter[at]))
        return np.asarray(cv2.subtract(brighter, np.ascontiguousarray(self._darker[at])), np.uint8)


def lens_rays(lens: PinholeCamera, u0: int, v0: int, u1: int, v1: int) -> Floats:
    """(v1 - v0, u1 - u0, 2) normalised coordinates of a window's pixel centres."""
    v, u = np.mgrid[v0:v1, u0:u1].astype(float)
    rays = lens.normalise(np.stack([u, v], -1).reshape(-1, 2))
    return np.ascontiguousarray(rays.reshape(v1 - v0, u1 - u0, 2))


def _rows(v: Floats) -> Floats:
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12))
