"""The cameras on the page: frustums that carry what they see, and one mosaic of all pictures."""

from __future__ import annotations

import numpy as np
import viser

from armsight.arrays import ColorImage, Pose
from armsight.devices.data import RgbdCameraInfo, RgbdFrame
from armsight.viewer import colors
from armsight.viewer.nodes import Posed

PICTURE_WIDTH = 192
"""Of the picture on a frustum [px]."""
TILE = (288, 216)
"""Width and height of a tile of the mosaic [px]."""


class CameraFrustum:
    """One camera's frustum."""

    def __init__(self, scene: viser.SceneApi, name: str, info: RgbdCameraInfo) -> None:
        lens = info.depth
        self.info = info
        self._handle = scene.add_camera_frustum(
            name,
            fov=float(2.0 * np.arctan2(0.5 * lens.height, lens.fy)),
            aspect=lens.width * lens.fy / (lens.height * lens.fx),
            scale=0.11,
            color=(148, 163, 184),
            thickness=0.004,
            cast_shadow=False,
            receive_shadow=False,
        )
        self._node = Posed(self._handle)
        self._alive: bool | None = None
        self._shown: tuple[int, float] | None = None
        self.picture: ColorImage | None = None
        if info.mounted_on == "base":
            self.move(info.T_mount_camera)

    def move(self, T_base_camera: Pose) -> None:
        """Put the frustum at the pose of the depth lens."""
        self._node.move(T_base_camera)

    def show_health(self, alive: bool | None) -> None:
        """Grey before the first word, teal alive, red dead."""
        if alive is not self._alive:
            self._alive = alive
            self._handle.color = colors.ALIVE if alive else colors.DEAD

    def show_picture(self, frame: RgbdFrame) -> bool:
        """Put a frame's picture on the frustum; false if it is there already."""
        key = (frame.sequence, frame.stamp)
        if key == self._shown:
            return False
        self._shown = key
        if frame.color is not None:
            self.picture = colors.shrink(frame.color, PICTURE_WIDTH)
        else:
            near, far = self.info.range
            far = min(far, near + 3.5)
            self.picture = colors.depth_picture(frame.depth, PICTURE_WIDTH, near, far)
        self._handle.image = self.picture
        return True


def mosaic(pictures: list[ColorImage | None]) -> ColorImage:
    """All pictures in one, two columns; black where there is none yet."""
    width, height = TILE
    blank = np.full((height, width, 3), 12, np.uint8)
    tiles = [blank if p is None else colors.fit(p, width, height) for p in pictures] or [blank]
    columns = 1 if len(tiles) == 1 else 2
    tiles += [blank] * (-len(tiles) % columns)
    rows = [np.concatenate(tiles[i : i + columns], axis=1) for i in range(0, len(tiles), columns)]
    return np.concatenate(rows, axis=0)
