"""The charging paper's pose, as the baseline: contacts triangulated, a plane, the layout's roll.

Equation 1 gives the middle of each contact in space, equations 2 and 3 the plane through them by
least squares, the known layout the origin and the roll.
"""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Floats, Points, Pose
from armsight.charging.fit import Fit
from armsight.charging.ports.table import PORTS
from armsight.geometry.pose import make_pose
from armsight.geometry.stereo import StereoPair


def contact_pixels(fit: Fit, view: int, names: tuple[str, ...]) -> Floats:
    """(n, 2) middles of the ellipses about contacts in one picture of a fit; NaN where unseen.

    The pixels are those of the picture's part that was fitted.
    """
    out = np.full((len(names), 2), np.nan)
    edges = fit.edges[view]
    for i, rim in enumerate(fit.curves.rims):
        if rim.name not in names:
            continue
        p = edges[fit.curves.rim == i]
        p = p[np.isfinite(p).all(axis=1)].astype(np.float32)
        if len(p) >= 6:
            out[names.index(rim.name)] = cv2.fitEllipse(p)[0]
    return out


def plane_pose(points: Points, layout: Floats) -> Pose:
    """Pose of a port by its contacts in space.

    Args:
        points: (n, 3) contacts in the left camera's frame [m].
        layout: (n, 2) where they are in the port's frame [m].
    """
    x, y, z = points.T
    A = np.column_stack([x, y, np.ones(len(x))])
    (a, b, c), *_ = np.linalg.lstsq(A, z, rcond=None)
    normal = np.array([a, b, -1.0])
    normal /= np.linalg.norm(normal)  # towards the camera
    flat = np.column_stack([x, y, a * x + b * y + c])
    across = np.cross([0.0, -1.0, 0.0], normal)
    across /= np.linalg.norm(across)
    R = np.column_stack([across, np.cross(normal, across), normal])
    seen = (flat - flat.mean(axis=0)) @ R[:, :2]
    known = layout - layout.mean(axis=0)
    turn = np.arctan2(
        np.sum(known[:, 0] * seen[:, 1] - known[:, 1] * seen[:, 0]), np.sum(known * seen)
    )
    cos, sin = np.cos(turn), np.sin(turn)
    R = R @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    origin = flat.mean(axis=0) - R[:, :2] @ layout.mean(axis=0)
    return make_pose(R, origin)


def paper_pose(
    name: str, left: Floats, right: Floats, pair: StereoPair, exact: bool = False
) -> Pose | None:
    """The paper's pose of a port from the pixels of its AC contacts in both pictures.

    Args:
        name: type of the port.
        left: (n, 2) pixels in the order of the table.
        right: the same in the other picture.
        pair: that took the pictures.
        exact: triangulate by the rays, not by equation 1, which holds near the axis only.

    Returns:
        ``T_left_port``, or None where fewer than three contacts are seen by both.
    """
    layout = np.array([(p.x, p.y) for p in PORTS[name].pins])
    seen = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    if seen.sum() < 3:
        return None
    triangulate = pair.triangulate if exact else pair.triangulate_converging
    return plane_pose(triangulate(left[seen], right[seen]), layout[seen])
