"""What is believed of a lens before it is calibrated: the maker's sheet, generously."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats
from armsight.geometry.camera import PinholeCamera


def sheet_prior(
    camera: PinholeCamera,
    focal: float = 0.05,
    aspect: float = 0.004,
    center: float = 0.02,
    distortion: float = 0.3,
) -> Floats:
    """(9, 9) information about a lens from its sheet.

    Five frames cannot tell a focal length from a distance; a sheet can. The sigmas are wide enough
    never to matter with fifty frames. Real units: two Kinect v2 differ by 0.3-0.6 % between fx and
    fy, and their centres lie 5-20 px from the middle of 1920.

    Args:
        camera: the sheet's values.
        focal: sigma of the focal length, as a share of it.
        aspect: sigma of fx / fy.
        center: sigma of the principal point, as a share of the image's width.
        distortion: sigma of k1; k2, k3 twice that, p1 and p2 a thirtieth.
    """
    f = 0.5 * (camera.fx + camera.fy)
    H = np.zeros((9, 9))
    common, apart = 1 / (focal * f) ** 2, 1 / (aspect * f) ** 2
    H[:2, :2] = common * 0.25 * np.ones((2, 2)) + apart * np.array([[1.0, -1.0], [-1.0, 1.0]])
    H[2, 2] = H[3, 3] = 1 / (center * camera.width) ** 2
    d = distortion
    for index, sigma in zip(range(4, 9), (d, 2 * d, d / 30, d / 30, 2 * d)):
        H[index, index] = 1 / sigma**2
    return H
