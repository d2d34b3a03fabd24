"""Takes the colour and infrared pictures of a cell's cameras, when somebody wants them.

While the arm rests, and nothing else can move, exposures differ in their noise alone: what is
costly is drawn once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats, Pose
from armsight.geometry.camera import PinholeCamera
from armsight.simulation.board import BoardUnit
from armsight.simulation.pictures import STILL, BoardPictures, Exposure, Noise, PictureKind
from armsight.simulation.rendering import Renderer


class _Developed:
    """A picture that is drawn when it is first looked at."""

    def __init__(self, joints: Floats, T_world_lens: Pose, exposure: Exposure) -> None:
        self.joints, self.T_world_lens = joints, T_world_lens
        self._exposure: Exposure | None = exposure
        self._image: Bytes | None = None

    def image(self, pictures: BoardPictures) -> Bytes:
        """Without noise. Asked for by the render thread alone."""
        if self._image is None:
            assert self._exposure is not None
            self._image, self._exposure = pictures.develop(self._exposure), None
        return self._image


class Photographer:
    """Pictures of one world.

    Args:
        renderer: draws the cell.
        data: MuJoCo's state.
        joints: number of the arm's joints.
        lively: whether anything but the arm moves.
        board: the truth about the cell's board, or None.
        board_pose: where the board is now, in world.
        seed: of the noise.
    """

    def __init__(
        self,
        renderer: Renderer,
        data: Any,
        joints: int,
        lively: bool,
        board: BoardUnit | None,
        board_pose: Callable[[], Pose],
        seed: int,
    ) -> None:
        self._renderer, self._data, self._joints = renderer, data, joints
        self._lively = lively
        self._pictures = None if board is None else BoardPictures(renderer, board)
        self._board_pose = board_pose
        self._seed = seed
        self._last: dict[tuple[str, PictureKind], _Developed] = {}
        self._noise: dict[tuple[str, PictureKind], Noise] = {}

    def reset(self) -> None:
        """Back to time 0."""
        self._last.clear()

    def shoot(
        self,
        camera: tuple[str, int],
        T_world_lens: Pose,
        lens: PinholeCamera,
        kind: PictureKind,
        sequence: int,
        noisy: bool,
    ) -> Callable[[], Bytes]:
        """Freeze the cell before a lens; what is returned draws the picture, in any thread.

        Args:
            camera: its name and number.
            T_world_lens: true pose of the lens.
            lens: the true one.
            kind: of the picture.
            sequence: number of the exposure, for its noise.
            noisy: whether the sensor's noise is wanted.
        """
        if self._pictures is None:
            return self._plain(T_world_lens, lens, kind)
        pictures, key = self._pictures, (camera[0], kind)
        joints = np.array(self._data.qpos[: self._joints])
        held = self._last.get(key)
        if (
            held is None
            or self._lively
            or np.abs(held.joints - joints).max() > STILL
            or not np.array_equal(held.T_world_lens, T_world_lens)
        ):
            exposure = pictures.take(self._data, T_world_lens, lens, kind, self._board_pose())
            held = self._last[key] = _Developed(joints, T_world_lens.copy(), exposure)
        developed = held
        if not noisy:
            return lambda: developed.image(pictures)
        noise = self._noise.get(key)
        if noise is None:
            seed = (self._seed, 78, camera[1], 0 if kind == "color" else 1)
            noise = self._noise[key] = Noise(lens, kind, seed)
        return lambda: noise.on(developed.image(pictures), sequence)

    def _plain(
        self, T_world_lens: Pose, lens: PinholeCamera, kind: PictureKind
    ) -> Callable[[], Bytes]:
        """A picture of a cell without a board: as fine as the lens."""
        renderer = self._renderer
        shot = renderer.take(self._data, T_world_lens, lens, "color")

        def develop() -> Bytes:
            color = renderer.color(shot, lens)
            renderer.give_back(shot)
            if kind == "color":
                return color
            return np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), np.uint8)

        return develop
