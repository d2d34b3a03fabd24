"""Pictures of ports, drawn once and kept as files: drawing takes longer than looking at them.

They lie in ``results/cache/port-pictures`` (or where ``ARMSIGHT_CACHE`` says), named by everything
that decides them; delete the folder when the studio's looks have changed.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np

from armsight.arrays import Bytes, Pose
from armsight.experiments.cache import cache_folder
from armsight.experiments.port_scene import (
    T_WORLD_PORT,
    PortPicture,
    PortStudio,
    PortView,
    cut,
    left_pose,
)
from armsight.geometry.pose import inverse
from armsight.geometry.stereo import StereoPair
from armsight.writing import write_atomically

LOOKS = 4
"""Raise it when the studio draws differently: old pictures are then left aside."""


class Album:
    """Pictures of one pair, from the file or drawn now."""

    def __init__(self, pair: StereoPair, samples: int = 4, folder: Path | None = None) -> None:
        self.pair = pair
        self.samples = samples
        self._folder = folder or cache_folder() / "port-pictures"
        self._studio: PortStudio | None = None

    def picture(
        self,
        view: PortView,
        both: bool = True,
        window: float | None = None,
        T_left_port: Pose | None = None,
        keep: bool = True,
    ) -> PortPicture:
        """Pictures of a situation, kept as files or not; see :meth:`PortStudio.photograph`."""
        files = [
            self._folder / f"{self._name(view, window, T_left_port)}-{side}.png" for side in "lr"
        ]
        files = files[: 1 + both]
        kept = [
            cv2.imread(str(file), cv2.IMREAD_UNCHANGED) if file.is_file() else None
            for file in files
        ]
        if any(image is None for image in kept):
            if self._studio is None:
                self._studio = PortStudio(self.pair, self.samples)
            drawn = self._studio.photograph(view, both, window, T_left_port)
            for file, image in zip(files if keep else (), drawn.images):
                done, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
                assert done
                write_atomically(file, data.tobytes())
            return drawn
        T_world_left = left_pose(view, self.pair, T_left_port)
        return _known(T_world_left, self.pair, [np.asarray(image) for image in kept], window)

    def close(self) -> None:
        """Give OpenGL's memory back."""
        if self._studio is not None:
            self._studio.close()

    def _name(self, view: PortView, window: float | None, T: Pose | None) -> str:
        pair = [
            self.pair.left.fx,
            self.pair.left.width,
            self.pair.right.cx,
            *self.pair.T_left_right.ravel().tolist(),
        ]
        place = None if T is None else T.ravel().tolist()
        key = json.dumps([LOOKS, self.samples, pair, window, asdict(view), place], sort_keys=True)
        return hashlib.sha256(key.encode()).hexdigest()[:20]


def _known(
    T_world_left: Pose, pair: StereoPair, images: list[Bytes], window: float | None
) -> PortPicture:
    """A kept picture with its truth, which the view alone decides."""
    lenses, poses = [], []
    for lens, T in ((pair.left, np.eye(4)), (pair.right, pair.T_left_right))[: len(images)]:
        pose = inverse(T_world_left @ T) @ T_WORLD_PORT
        lenses.append(lens if window is None else cut(lens, pose, window))
        poses.append(pose)
    return PortPicture(tuple(images), tuple(lenses), tuple(poses))


__all__ = ["Album"]
