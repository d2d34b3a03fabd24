"""Boards drawn, seen through a lens and found again; printed true to scale."""

import re
import zlib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from armsight.calibration.boards import (
    CharucoBoard,
    Checkerboard,
    CircleGrid,
    Detection,
    Miss,
    TagGrid,
    parse_board,
    raster,
)
from armsight.calibration.boards.circles import eccentricity
from armsight.calibration.printing import board_pdf
from armsight.calibration.recorded_set import load
from armsight.calibration.report import read_lines
from armsight.errors import UsageError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp

CAMERA = PinholeCamera(640, 480, 560, 560, 319.5, 239.5)
BOARDS = [
    Checkerboard(),
    Checkerboard(10, 7, 0.025, hollow=False),
    CharucoBoard(7, 5, 0.03, 0.022),
    CharucoBoard(7, 6, 0.03, 0.022, legacy=True),
    TagGrid(4, 3, 0.04),
    TagGrid(3, 3, 0.05, dictionary="DICT_5X5_100"),
    TagGrid(3, 3, 0.04, kalibr=True),
    CircleGrid(7, 5, 0.03, 0.018),
    CircleGrid(4, 7, 0.02, 0.016, asymmetric=True),
]
NAMES = [f"{type(b).__name__}-{k}" for k, b in enumerate(BOARDS)]


def picture(board, T, camera=CAMERA, blur=0.7, noise=1.0, seed=0):
    """The board by one homography at four times the size, area-averaged: an oracle of its own."""
    image, x0, y0 = raster(board, 4000, 0.02)
    n = 4
    K = camera.K.copy()
    K[:2, :2] *= n
    K[0, 2], K[1, 2] = (camera.cx + 0.5) * n - 0.5, (camera.cy + 0.5) * n - 0.5
    place = np.array([[1 / 4000, 0, x0 + 0.5 / 4000], [0, 1 / 4000, y0 + 0.5 / 4000], [0, 0, 1]])
    H = K @ T[:3, [0, 1, 3]] @ place
    big = cv2.warpPerspective(
        image, H, (camera.width * n, camera.height * n), flags=cv2.INTER_AREA, borderValue=150
    )
    small = cv2.resize(big, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), blur).astype(float)
    small += np.random.default_rng(seed).normal(0, noise, small.shape)
    return np.clip(0.7 * small + 20, 0, 255).astype(np.uint8)


def centred(board, z, tilt):
    middle = 0.5 * (board.points.max(0) + board.points.min(0))
    turn = exp([0, 0, 0, *tilt])
    T = turn.copy()
    T[:3, 3] = [0, 0, z] - turn[:3, :3] @ middle
    return T


@pytest.mark.parametrize("board", BOARDS, ids=NAMES)
@pytest.mark.parametrize("tilt", [(0, 0, 0.2), (0.5, -0.3, 0.1), (-0.4, 0.4, 3.0)])
def test_corners_are_found_where_they_are(board, tilt):
    T = centred(board, 0.45, tilt)
    found = board.detect(picture(board, T))
    assert isinstance(found, Detection)
    assert len(found.corner) >= 0.9 * len(board.points)
    truth = CAMERA.project(board.points[found.corner] @ T[:3, :3].T + T[:3, 3])
    error = np.linalg.norm(found.pixel - truth, axis=1)
    # A plain board whose colours do not tell may be read turned; these here all tell, or are
    # read the way that was drawn.
    if board.turns:
        for turn in board.turns:
            other = CAMERA.project(board.points[turn.corner] @ T[:3, :3].T + T[:3, 3])
            miss = np.linalg.norm(found.pixel - other[found.corner], axis=1)
            error = miss if np.median(miss) < np.median(error) else error
    limit = 0.25 if isinstance(board, TagGrid) else 0.12
    assert np.sqrt(np.mean(error**2)) < limit


def test_the_hollow_square_tells_the_turn():
    board = Checkerboard()
    for turn in (0.0, np.pi):
        T = centred(board, 0.5, (0, 0, turn))
        found = board.detect(picture(board, T))
        assert isinstance(found, Detection)
        truth = CAMERA.project(board.points[found.corner] @ T[:3, :3].T + T[:3, 3])
        np.testing.assert_allclose(found.pixel, truth, atol=0.3)


def test_small_boards_lose_only_the_corner_by_the_hollow_square():
    board = Checkerboard()
    T = centred(board, 1.9, (0.2, 0.1, 0.3))
    found = board.detect(picture(board, T))
    assert isinstance(found, Detection)
    assert set(range(1, 24)) <= set(found.corner.tolist())


def test_misses_say_why():
    board = Checkerboard()
    black, white = np.zeros((480, 640), np.uint8), np.full((480, 640), 255, np.uint8)
    gray = np.full((480, 640), 128, np.uint8)
    reasons = [board.detect(image) for image in (black, white, gray)]
    assert [m.reason for m in reasons if isinstance(m, Miss)] == [
        "image is black",
        "image is over-exposed",
        "no board found",
    ]


def test_a_mirrored_board_is_refused():
    board = Checkerboard()
    image = picture(board, centred(board, 0.5, (0.1, 0.2, 0)))
    assert isinstance(board.detect(np.ascontiguousarray(image[:, ::-1])), Miss)


def test_a_blurred_board_is_missed_or_right():
    board = Checkerboard()
    T = centred(board, 0.8, (0.2, 0.1, 0))
    for blur in (2.0, 4.0, 8.0):
        found = board.detect(picture(board, T, blur=blur))
        if isinstance(found, Detection):
            truth = CAMERA.project(board.points[found.corner] @ T[:3, :3].T + T[:3, 3])
            assert np.median(np.linalg.norm(found.pixel - truth, axis=1)) < 0.3


@pytest.mark.parametrize("board", [*BOARDS, TagGrid(1, 1, 0.048, 0.0)], ids=[*NAMES, "tag"])
def test_pdf_is_true_to_scale(board):
    pdf = board_pdf(board, "A4")
    assert pdf.startswith(b"%PDF-1.4")
    assert zlib.crc32(pdf) == zlib.crc32(board_pdf(board, "A4"))
    pattern = rb"([\d.]+) ([\d.]+) ([\d.]+) ([\d.]+) re f"
    boxes = [[float(v) for v in m] for m in re.findall(pattern, pdf)]
    if isinstance(board, CircleGrid):
        starts = np.array(
            [[float(v) for v in m] for m in re.findall(rb"([\d.]+) ([\d.]+) m ", pdf)]
        )
        gap = np.linalg.norm(np.diff(starts, axis=0), axis=1).min()
        step = board.spacing * (2 if board.asymmetric else 1)
        assert gap == pytest.approx(step * 72 / 25.4 * 1e3, abs=0.01)
        return
    count = len(board.tiles())
    tiles = np.array(boxes[:count])
    x0, y0, x1, y1 = board.outline
    points = 72 / 25.4 * 1e3
    width = (tiles[:, 0] + tiles[:, 2]).max() - tiles[:, 0].min()
    height = (tiles[:, 1] + tiles[:, 3]).max() - tiles[:, 1].min()
    assert width == pytest.approx((x1 - x0) * points, abs=0.01)
    assert height == pytest.approx((y1 - y0) * points, abs=0.01)
    rule = np.array(boxes[count:])
    if len(rule):
        assert rule[:, 2].max() == pytest.approx(100 * 72 / 25.4, abs=1e-3)


def test_a_board_too_large_says_what_paper_holds_it():
    with pytest.raises(UsageError, match="use A2"):
        board_pdf(Checkerboard(13, 9, 0.04), "A4")
    with pytest.raises(UsageError, match="no paper"):
        board_pdf(Checkerboard(), "B5")


def test_boards_from_words():
    assert parse_board("checkerboard:7x5:30") == Checkerboard()
    assert parse_board("checkerboard:10x7:25") == Checkerboard(10, 7, 0.025, False)
    assert parse_board("checkerboard:9x6:25:inner") == Checkerboard(10, 7, 0.025, False)
    assert parse_board("checkerboard:9x7:25:plain") == Checkerboard(9, 7, 0.025, False)
    assert parse_board("tag:48:10") == TagGrid(1, 1, 0.048, 0.0, 10)
    assert parse_board("aprilgrid:6x6:88:0.3").border == 2
    assert parse_board("charuco:5x8:36:27:legacy").legacy
    assert parse_board("acircles:4x11:20").turns == ()
    assert parse_board("charuco:5x7:36:27:DICT_5X5_100").dictionary == "DICT_5X5_100"
    assert len(parse_board("apriltag:6x4:30").points) == 96
    for words in ("chess:7x5:30", "checkerboard:7", "checkerboard:7x5:x"):
        with pytest.raises(UsageError, match="not understood"):
            parse_board(words)
    with pytest.raises(UsageError, match="odd"):
        parse_board("checkerboard:8x5:30:hollow")
    for absurd in (
        "checkerboard:900x5:30",
        "charuco:40x40:30:20",
        "apriltag:50x50:30",
        "checkerboard:7x5:-3",
        "circles:7x5:30:40",
        "aruco:3x3:30:0.3:0:NONE",
    ):
        with pytest.raises(UsageError):
            parse_board(absurd)


def test_colours_tell_the_turn_of_a_plain_board_where_they_can():
    board = Checkerboard(10, 7, 0.025, hollow=False)
    assert board.turns == ()
    T = centred(board, 0.5, (0.1, 0.2, np.pi - 0.1))
    found = board.detect(picture(board, T))
    assert isinstance(found, Detection)
    truth = CAMERA.project(board.points[found.corner] @ T[:3, :3].T + T[:3, 3])
    np.testing.assert_allclose(found.pixel, truth, atol=0.3)
    assert len(Checkerboard(8, 6, 0.025, hollow=False).turns) == 1
    assert len(Checkerboard(7, 7, 0.025, hollow=False).turns) == 3


def test_the_larger_board_is_meant_not_the_one_on_a_screen():
    board = Checkerboard(10, 7, 0.025, hollow=False)
    T = centred(board, 0.6, (0.3, 0.2, 0.1))
    image = picture(board, T)
    small = cv2.resize(image[100:380, 150:490], (85, 70), interpolation=cv2.INTER_AREA)
    image[5:75, 5:90] = small
    found = board.detect(image)
    assert isinstance(found, Detection)
    truth = CAMERA.project(board.points[found.corner] @ T[:3, :3].T + T[:3, 3])
    assert np.median(np.linalg.norm(found.pixel - truth, axis=1)) < 0.2


def test_eccentricity_is_that_of_a_drawn_circle():
    """The conic's middle against the mean of many points' images, weighted by area."""
    board = CircleGrid(3, 3, 0.1, 0.08)
    T = centred(board, 0.5, (0.7, 0.2, 0.0))
    H = CAMERA.K @ T[:3, [0, 1, 3]]
    middle = np.asarray(board.points[:, :2], float)
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    for k, found in enumerate(eccentricity(H, middle, 0.04)):
        rim = middle[k] + 0.04 * np.stack([np.cos(angle), np.sin(angle)], 1)
        p = np.column_stack([rim, np.ones(len(rim))]) @ H.T
        moments = cv2.moments((p[:, None, :2] / p[:, None, 2:]).astype(np.float32))
        seen = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
        m = H @ np.append(middle[k], 1.0)
        np.testing.assert_allclose(found, seen - m[:2] / m[2], atol=2e-3)
        assert np.linalg.norm(found) > 0.2


def test_why_the_board_is_another_is_no_second_reading_of_it(tmp_path: Path) -> None:
    """The reason stood in the table as `second best: the board has 9x6 inner corners ...`."""
    board = Checkerboard(10, 7, 0.025, hollow=False)
    for k in range(4):
        gray = picture(board, centred(board, 0.6, [0.3, 0.1 * k, 0.0]), seed=k)
        cv2.imwrite(str(tmp_path / f"{k}.png"), gray)
    read = load(tmp_path, replace(board, columns=9, rows=6))
    assert [r.what for r in read.read_as[:2]] == ["board", ""]
    assert all(not r.otherwise for r in read.read_as[:2])
    lines = [line.strip() for line in read_lines(read)]
    assert any(line.startswith("the board has 9x6 inner corners") for line in lines)
