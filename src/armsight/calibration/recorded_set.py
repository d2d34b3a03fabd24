"""Calibrating from a folder of images and poses, as people have them.

Layouts that are read:

* ``images/N.png`` with ``poses/N.yaml`` (x y z qx qy qz qw), ROS-Industrial's; its
  ``cal_data.yaml`` gives board and lens;
* ``*image-N.png`` with ``*pose*_N.yaml`` (six numbers: translation, axis times angle), ViSP's;
* images with ``poses.csv`` (a header names the columns; ``_mm`` and ``_deg`` are understood),
  ``poses.txt`` (7, 12 or 16 numbers a line), ``poses.yaml`` or ``poses.json`` (a list);
* images alone: a lens calibration.

Poses are ``T_base_flange``. A lens comes from any YAML (ROS ``camera_info``, OpenCV) or ViSP XML in
the folder, unless it is named; without one it is solved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from armsight.arrays import Floats, Poses
from armsight.calibration.boards import Board, CharucoBoard, Checkerboard, Detection
from armsight.calibration.calibrate import Calibration, CalibrationOptions, calibrate
from armsight.calibration.diagnosis.raw_poses import RawPoses
from armsight.calibration.diagnosis.solved import diagnose_solution
from armsight.calibration.diagnosis.start import diagnose_start
from armsight.calibration.files import images_in, number_of, read_lens, read_poses, read_yaml
from armsight.calibration.findings import Finding
from armsight.calibration.lens import LensCalibration, calibrate_lens, zhang
from armsight.calibration.lens_prior import sheet_prior
from armsight.calibration.problem import (
    ArmView,
    BoardPlacement,
    Lens,
    Mount,
    Problem,
    Rig,
    Sighting,
)
from armsight.calibration.robot_errors import RobotErrors
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera
from armsight.robots.robot import Robot


@dataclass(frozen=True)
class RecordedSet:
    """A folder, read.

    Attributes:
        folder: where.
        images: their paths, one a view.
        detections: of each view, or None; misses: why not.
        poses: (n, 4, 4) ``T_base_flange`` of each view, or None for lens frames alone.
        raw: the same as written.
        joints: (n, j) [rad], or None.
        lens: given with the set, or None; size: (width, height) of the images [px].
        board: what was looked for.
        findings: what was odd about the files.
    """

    folder: Path
    images: tuple[Path, ...]
    detections: tuple[Detection | None, ...]
    misses: tuple[str, ...]
    poses: Poses | None
    raw: RawPoses | None
    joints: Floats | None
    lens: PinholeCamera | None
    size: tuple[int, int]
    board: Board
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class RecordedAnswer:
    """What a recorded set says.

    Attributes:
        calibration: camera and board, or None for a set of lens frames.
        lens: of a set of lens frames, else None.
        findings: everything odd, mistakes first.
    """

    calibration: Calibration | None
    lens: LensCalibration | None
    findings: tuple[Finding, ...] = field(default=())


def load(
    folder: Path,
    board: Board | None = None,
    lens_file: Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> RecordedSet:
    """Read a folder and find the board in its images.

    Raises:
        CalibrationError: nothing usable is there; says what is missing.
    """
    if not folder.is_dir():
        raise CalibrationError(f"{folder}: no such folder")
    images = images_in(folder)
    if not images:
        raise CalibrationError(f"{folder}: no images in it or in {folder / 'images'}")
    board = board or board_of(folder)
    if board is None:
        raise CalibrationError(
            f"{folder}: which board? give --board, such as checkerboard:7x5:30 or charuco:5x7:36:27"
        )
    findings: list[Finding] = []
    try:
        table = read_poses(folder)
    except CalibrationError:
        if any(folder.glob("*pose*")):
            raise
        table = None
    pairs = list(range(len(images)))
    if table is not None:
        images, pairs, odd = _paired(images, table.keys, table.source)
        findings += odd
    say = progress or (lambda _: None)
    detections: list[Detection | None] = []
    misses: list[str] = []
    size: tuple[int, int] | None = None
    for number, file in enumerate(images):
        say(f"{file.name} ({number + 1} of {len(images)})")
        gray = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        if gray is None:
            detections.append(None)
            misses.append("image cannot be read")
            continue
        shape = (gray.shape[1], gray.shape[0])
        if size is not None and shape != size:
            detections.append(None)
            misses.append(f"image is {shape[0]}x{shape[1]}, the first is {size[0]}x{size[1]}")
            continue
        size = size or shape
        found = board.detect(np.asarray(gray, np.uint8))
        detections.append(found if isinstance(found, Detection) else None)
        misses.append("" if isinstance(found, Detection) else found.reason)
    if size is None:
        raise CalibrationError(f"{folder}: none of {len(images)} images can be read")
    lens = _find_lens(folder, lens_file, size)
    if lens is not None and (lens.width, lens.height) != size:
        findings.append(
            Finding(
                "lens_resolution",
                "error",
                f"the lens is for {lens.width}x{lens.height}, the images are {size[0]}x{size[1]}",
                "give the lens of this resolution",
            )
        )
    raw = None
    if table is not None:
        raw = RawPoses(table.raw.position[pairs], table.raw.rotation[pairs], table.raw.kind)
    joints = table.joints[pairs] if table is not None and table.joints is not None else None
    return RecordedSet(
        folder,
        tuple(images),
        tuple(detections),
        tuple(misses),
        raw.poses() if raw is not None else None,
        raw,
        joints,
        lens,
        size,
        board,
        tuple(findings),
    )


def _paired(
    images: list[Path], keys: tuple[str, ...], source: str
) -> tuple[list[Path], list[int], list[Finding]]:
    """Images that have a pose, the pose of each, and what does not match."""
    if any(keys):
        by_key = {k: i for i, k in enumerate(keys)}
        by_number = {number_of(k): i for i, k in enumerate(keys)}
        kept, pairs = [], []
        for file in images:
            for index in (
                by_key.get(file.name),
                by_key.get(file.stem),
                by_number.get(number_of(file.name)),
            ):
                if index is not None:
                    kept.append(file)
                    pairs.append(index)
                    break
        odd = []
        if len(kept) < max(len(images), len(keys)):
            odd.append(
                Finding(
                    "unpaired",
                    "warning",
                    f"{len(images)} images and {len(keys)} poses in {source}: {len(kept)} pairs",
                    "number images and poses alike",
                )
            )
        if not kept:
            raise CalibrationError(f"{source}: no pose belongs to an image by name or number")
        return kept, pairs, odd
    n = min(len(images), len(keys))
    odd = []
    if len(images) != len(keys):
        odd.append(
            Finding(
                "unpaired",
                "warning",
                f"{len(images)} images but {len(keys)} poses in {source}, tied by order alone",
                "name the image of each pose",
            )
        )
    return images[:n], list(range(n)), odd


def _find_lens(folder: Path, lens_file: Path | None, size: tuple[int, int]) -> PinholeCamera | None:
    if lens_file is not None:
        lens = read_lens(lens_file, *size)
        if lens is None:
            raise CalibrationError(f"{lens_file}: no lens found in it")
        return lens
    for file in sorted([*folder.glob("*.y*ml"), *folder.glob("*.xml")]):
        if "pose" in file.stem:
            continue
        try:
            lens = read_lens(file, *size)
        except CalibrationError:
            continue
        if lens is not None:
            return lens
    return None


def board_of(folder: Path) -> Board | None:
    """The board that a ROS-Industrial ``cal_data.yaml`` describes, or None."""
    file = folder / "cal_data.yaml"
    if not file.is_file():
        return None
    document = read_yaml(file)
    finder = document.get("target_finder") if isinstance(document, dict) else None
    if not isinstance(finder, dict):
        return None
    kind = str(finder.get("type", ""))
    names = [
        "DICT_4X4_50",
        "DICT_4X4_100",
        "DICT_4X4_250",
        "DICT_4X4_1000",
        "DICT_5X5_50",
        "DICT_5X5_100",
        "DICT_5X5_250",
        "DICT_5X5_1000",
        "DICT_6X6_50",
        "DICT_6X6_100",
        "DICT_6X6_250",
        "DICT_6X6_1000",
        "DICT_7X7_50",
        "DICT_7X7_100",
        "DICT_7X7_250",
        "DICT_7X7_1000",
        "DICT_ARUCO_ORIGINAL",
        "DICT_APRILTAG_16h5",
        "DICT_APRILTAG_25h9",
        "DICT_APRILTAG_36h10",
        "DICT_APRILTAG_36h11",
    ]
    try:
        if kind.startswith("Charuco"):
            return CharucoBoard(
                int(finder["cols"]),
                int(finder["rows"]),
                float(finder["chessboard_dim"]),
                float(finder["aruco_marker_dim"]),
                names[int(finder.get("dictionary", 10))],
            )
        if kind.startswith("Checkerboard"):
            return Checkerboard(
                int(finder["cols"]), int(finder["rows"]), float(finder["square"]), False
            )
    except (KeyError, ValueError, IndexError):
        raise CalibrationError(f"{file}: target_finder is incomplete") from None
    return None


def problem_of(
    recorded: RecordedSet,
    mount: Mount = "base",
    robot: Robot | None = None,
    sigma: float = 0.15,
    keep_lens: bool = False,
) -> Problem:
    """The set as a problem: one camera, one board.

    Raises:
        CalibrationError: no board was seen, there is no lens and none can be told, or none is
            there that could be kept.
    """
    seen = [(i, d) for i, d in enumerate(recorded.detections) if d is not None]
    if not seen or recorded.poses is None:
        reasons = ", ".join(sorted({m for m in recorded.misses if m})) or "no poses"
        raise CalibrationError(
            f"{recorded.folder}: no {recorded.board.describe()} in any of {len(recorded.images)} "
            f"images ({reasons}); check the board's kind and size"
        )
    width, height = recorded.size
    points = recorded.board.points
    lens = recorded.lens
    if lens is None and keep_lens:
        raise CalibrationError(f"{recorded.folder}: no lens there to be kept; give --lens FILE")
    if lens is None:
        lens = zhang([points[d.corner] for _, d in seen], [d.pixel for _, d in seen], width, height)
        if lens is None:
            raise CalibrationError(
                f"{recorded.folder}: no lens given, and these images do not tell one; give --lens"
            )
        prior = sheet_prior(lens, focal=0.5, center=0.1, distortion=1.0)
    else:
        lens = replace(lens, width=width, height=height)
        prior = sheet_prior(lens, focal=0.01, aspect=0.003, center=0.01)
    joints = recorded.joints if robot is not None else None
    views = tuple(
        ArmView(T, None if joints is None else joints[i]) for i, T in enumerate(recorded.poses)
    )
    return Problem(
        (Rig("camera", mount),),
        (Lens("camera", 0, lens, prior=prior, keep=keep_lens),),
        (BoardPlacement("board", points, "flange" if mount == "base" else "base"),),
        views,
        tuple(
            Sighting(i, 0, 0, d.corner, d.pixel, sigma)
            for i, d in seen
            if len(d.corner) >= min(5, len(points))
        ),
        RobotErrors(robot) if joints is not None and robot is not None else None,
    )


def solve_set(
    recorded: RecordedSet,
    mount: Mount = "base",
    robot: Robot | None = None,
    seed: int = 0,
    folds: int | None = None,
    progress: Callable[[str], None] | None = None,
    keep_lens: bool = False,
) -> RecordedAnswer:
    """Solve a recorded set and say what is wrong with it.

    Args:
        recorded: the set.
        mount: what carries the camera.
        robot: model of the arm when the set has joint angles.
        seed: of random samples.
        folds: of the left-out test; one a view up to 20 views by default.
        progress: called with each stage.
        keep_lens: the lens that was given stays as it is, whatever the images say.

    Raises:
        CalibrationError: it cannot be solved at all.
    """
    findings = list(recorded.findings)
    lost = [m for m in recorded.misses if m]
    if lost:
        findings.append(
            Finding(
                "unseen",
                "note",
                f"no board in {len(lost)} of {len(recorded.images)} images: "
                + ", ".join(sorted(set(lost))),
                "leave them out, or improve light and focus",
            )
        )
    if recorded.poses is None:
        frames = [(d.corner, d.pixel) for d in recorded.detections if d is not None]
        lens = calibrate_lens(recorded.board.points, frames, *recorded.size)
        return RecordedAnswer(None, lens, tuple(findings))
    problem = problem_of(recorded, mount, robot, keep_lens=keep_lens)
    findings += diagnose_start(problem, 0, recorded.raw, seed)
    views = len({s.view for s in problem.sightings})
    options = CalibrationOptions(
        solve_lenses=recorded.lens is None,
        ladder=True,
        folds=folds or (views if views <= 20 else 8),
    )
    fatal = [f for f in findings if f.severity == "error"]
    try:
        answer = calibrate(problem, np.random.default_rng(seed), options, progress)
    except CalibrationError as error:
        if fatal:
            raise CalibrationError(
                f"{recorded.folder}: {fatal[0].message}; {fatal[0].cure}"
            ) from None
        raise CalibrationError(f"{recorded.folder}: {error}") from None
    if not fatal:
        findings += diagnose_solution(answer.solution, 0)
        findings += verdict_findings(answer)
    order = {"error": 0, "warning": 1, "note": 2}
    findings.sort(key=lambda f: order[f.severity])
    return RecordedAnswer(answer, None, tuple(findings))


def verdict_findings(answer: Calibration) -> list[Finding]:
    """What the answer itself says of the data's quality."""
    out = []
    sigma = answer.target_sigma(0)
    noise = float(np.median([s.sigma for s in answer.problem.sightings]))
    white = answer.freedom.white
    if answer.left_out is not None and answer.left_out.mm > 1.3:
        out.append(
            Finding(
                "inconsistent",
                "warning",
                f"poses and images agree only to {answer.left_out.mm:.1f} mm in views that the "
                f"solve has not seen ({answer.left_out.px:.1f} px; corners scatter by "
                f"{noise:.2f} px)",
                "check that the arm was at rest, its poses are those of the images, and board and "
                "camera are tight",
            )
        )
    if white is not None and white[0] > 0.002:
        out.append(
            Finding(
                "arm_noise",
                "warning",
                f"the arm's poses scatter by {1e3 * white[0]:.1f} mm and "
                f"{np.rad2deg(white[1]):.2f} deg",
                "an arm repeats to 0.1 mm: look for late poses, a loose board or a wrong flange",
            )
        )
    if sigma > 0.005:
        out.append(
            Finding(
                "uncertain",
                "warning",
                f"a point 1.0-1.5 m away would be off by about {1e3 * sigma:.0f} mm",
                "take more views, tilted by 20-40 deg about different axes, over the whole image",
            )
        )
    return out
