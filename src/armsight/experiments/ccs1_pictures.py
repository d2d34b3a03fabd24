"""The rendered CCS1 stereo pictures of other people (yeonseong0612/ev-auto-charging, MIT).

Four pairs with the socket's pose and one without a socket, 640x480, rectified, 60 mm apart. Their
socket's origin is not ours: one constant offset is estimated from them and taken off.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Bytes, Pose, Poses
from armsight.errors import DatasetError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_quaternion, inverse, make_pose
from armsight.geometry.stereo import StereoPair

# rendered: their middle (320, 240) is the picture's, half a pixel from ours
_LENS = PinholeCamera(640, 480, 415.692, 415.692, 319.5, 239.5)
PAIR = StereoPair(_LENS, _LENS, make_pose(None, (0.06, 0.0, 0.0)))
T_SOCKET_PORT = make_pose([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Their socket: x right, y out of the car, z to the DC pins."""


@dataclass(frozen=True)
class ForeignPair:
    """A pair and, where there is a socket, its pose.

    Attributes:
        images: left and right, grey.
        T_left_socket: by its makers, or None.
    """

    images: tuple[Bytes, Bytes]
    T_left_socket: Pose | None


def foreign_pairs(folder: Path) -> list[ForeignPair]:
    """All pairs of a folder.

    Raises:
        DatasetError: a file is missing or broken.
    """
    try:
        with (folder / "gt_camera_socket.csv").open(encoding="utf-8", newline="") as stream:
            rows = {Path(row["image"]).name: row for row in csv.DictReader(stream)}
    except (OSError, KeyError) as error:
        raise DatasetError(f"{folder}: no poses of sockets: {error}") from None
    out = []
    for left in sorted((folder / "left").glob("*.png")):
        right = folder / "right" / f"r{left.name[1:]}"
        images = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in (left, right)]
        if images[0] is None or images[1] is None:
            raise DatasetError(f"{left}: it or its right partner cannot be read")
        row, T = rows.get(left.name), None
        if row is not None:
            T = from_quaternion(
                [float(row[k]) for k in ("qx", "qy", "qz", "qw")],
                [float(row[k]) for k in ("tx", "ty", "tz")],
            )
        out.append(ForeignPair((np.asarray(images[0]), np.asarray(images[1])), T))
    return out


def offset_free_errors(found: Poses, truth: Poses) -> tuple[list[float], list[float]]:
    """Errors of poses after one constant offset of the origins and axes [m], [rad].

    Args:
        found: (n, 4, 4) ours.
        truth: (n, 4, 4) theirs.
    """
    offsets = np.array([inverse(t) @ f for t, f in zip(truth, found)])
    mean = Rotation.from_matrix(offsets[:, :3, :3]).mean()
    middle = np.median(offsets[:, :3, 3], axis=0)
    shift = np.linalg.norm(offsets[:, :3, 3] - middle, axis=1)
    turn = (mean.inv() * Rotation.from_matrix(offsets[:, :3, :3])).magnitude()
    return shift.tolist(), np.atleast_1d(turn).tolist()
