"""Rendered boards under blur, noise and glare, and detectors of corners: ours and OpenCV's.

Every board is drawn through a lens with distortion (``calibration/synthetic_picture.py``), so the
true corners are known to the last digit.
"""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats
from armsight.calibration.boards import Checkerboard, Detection
from armsight.calibration.synthetic_picture import Conditions, board_picture, corners_of
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, make_pose

BOARD = Checkerboard(10, 7, 0.025, hollow=False)
LENS = PinholeCamera(1280, 960, 1100.0, 1102.0, 645.0, 476.0, (-0.15, 0.08, 0.0004, -0.0003, 0.0))
SCENES = {
    "clean": Conditions(),
    "blur 2 px": Conditions(blur=2.0),
    "noise 8": Conditions(noise=8.0),
    "glare": Conditions(glare=150.0),
    "dim, shaded": Conditions(light=90.0, dark=25.0, shade=0.6, noise=3.0),
    "all": Conditions(blur=1.5, noise=5.0, glare=90.0, shade=0.3),
}


def ours(gray: Bytes) -> Floats | None:
    """(k, 2), NaN where a corner is not given."""
    found = BOARD.detect(gray)
    if not isinstance(found, Detection):
        return None
    out = np.full((len(BOARD.points), 2), np.nan)
    out[found.corner] = found.pixel
    return out


def opencv_sb(gray: Bytes) -> Floats | None:
    """OpenCV's newest detector, with its flags for accuracy."""
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
    ok, found = cv2.findChessboardCornersSB(gray, BOARD.inner, flags=flags)
    return np.asarray(found, float).reshape(-1, 2) if ok else None


def opencv_classic(gray: Bytes) -> Floats | None:
    """OpenCV's classic detector with cornerSubPix, window 11, as in its tutorial."""
    ok, found = cv2.findChessboardCorners(gray, BOARD.inner)
    if not ok:
        return None
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 1e-3)
    found = cv2.cornerSubPix(gray, found, (11, 11), (-1, -1), stop)
    return np.asarray(found, float).reshape(-1, 2)


DETECTORS = {"armsight": ours, "OpenCV SB": opencv_sb, "OpenCV classic": opencv_classic}


def draw(rng: np.random.Generator, conditions: Conditions) -> tuple[Bytes, Floats]:
    """A picture of a board that lies whole in it, and its true corners."""
    middle = BOARD.points.mean(0)
    while True:
        z = rng.uniform(0.45, 1.2)
        u = rng.uniform(0.2, 0.8, 2) * [LENS.width, LENS.height]
        ray = np.append(LENS.normalise(u[None])[0], 1.0) * z
        lean, angle = np.deg2rad(rng.uniform(5, 50)), rng.uniform(-np.pi, np.pi)
        turn = exp([0, 0, 0, lean * np.cos(angle), lean * np.sin(angle), 0])
        turn = turn @ exp([0, 0, 0, 0, 0, rng.uniform(-np.pi, np.pi)])
        T = make_pose(turn[:3, :3], ray) @ make_pose(None, -middle)
        p = corners_of(BOARD, LENS, T)
        if p.min() > 30 and (p < np.array([LENS.width, LENS.height]) - 30).all():
            return board_picture(BOARD, LENS, T, rng, conditions), p


def errors(found: Floats, truth: Floats) -> Floats:
    """(k,) distances, the board counted from whichever side fits [px]."""
    ways = [found, found[::-1]]
    far = [np.linalg.norm(w - truth, axis=1) for w in ways]
    return min(far, key=lambda d: float(np.nanmedian(d)))


def scene_run(seed: int, scene: str, number: int) -> dict[str, list[float | None] | None]:
    """Errors of every detector on one picture [px]: None for a board that it does not find."""
    rng = np.random.default_rng([seed, 6, list(SCENES).index(scene), number])
    gray, truth = draw(rng, SCENES[scene])
    out: dict[str, list[float | None] | None] = {}
    for name, detect in DETECTORS.items():
        found = detect(gray)
        if found is None:
            out[name] = None
        else:
            out[name] = [float(d) if np.isfinite(d) else None for d in errors(found, truth)]
    return out
