"""The printed board in the simulated world: sharp, where it truly hangs, hidden by things."""

from dataclasses import replace

import numpy as np
import pytest
from simulation_cells import make_robot

from armsight.calibration.boards import Checkerboard, raster
from armsight.devices.camera_models import camera_info
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, from_rpy, inverse, look_at, make_pose
from armsight.geometry.shapes import Solid
from armsight.simulation.board import board_window, draw_board
from armsight.simulation.pictures import lens_rays
from armsight.simulation.print_kernels import BLACK, WHITE, cast_print
from armsight.simulation.spec import ArmSpec, BoardSpec, CameraSpec, Print, WorldSpec
from armsight.simulation.world import SimulatedWorld

BOARD = Checkerboard()


def printed(per_meter=6000):
    image, x0, y0 = raster(BOARD, per_meter, 0.02)
    p = BOARD.points
    middle, half = 0.5 * (p.max(0) + p.min(0)), 0.5 * np.ptp(p, axis=0)
    return Print(image, x0, y0, per_meter, (middle[0], middle[1]), (half[0], half[1]))


def true_corners(p, T_lens_board, lens):
    """Where the corners of a print with errors fall, by hand."""
    x, y = BOARD.points[:, 0], BOARD.points[:, 1]
    a, b = (x - p.center[0]) / p.half[0], (y - p.center[1]) / p.half[1]
    z = p.bend[0] * (a * a - 1 / 3) + p.bend[1] * (b * b - 1 / 3)
    points = np.column_stack([x * (1 + p.scale), y * (1 + p.scale), z])
    return lens.project(points @ T_lens_board[:3, :3].T + T_lens_board[:3, 3])


def cast_by_hand(rays, T, p, samples):
    """``cast_print`` in plain numpy, for a flat print."""
    h, w = rays.shape[0] - 2, rays.shape[1] - 2
    total, hits = np.zeros((h, w)), np.zeros((h, w))
    inv = inverse(T)
    steps = (np.arange(samples) + 0.5) / samples - 0.5
    v, u = np.mgrid[1 : h + 1, 1 : w + 1]
    for dv in steps:
        for du in steps:
            side, row = (1 if du >= 0 else -1), (1 if dv >= 0 else -1)
            first = rays[v, u] + abs(du) * (rays[v, u + side] - rays[v, u])
            second = rays[v + row, u] + abs(du) * (rays[v + row, u + side] - rays[v + row, u])
            ray = (1 - abs(dv)) * first + abs(dv) * second
            d = np.concatenate([ray, np.ones((h, w, 1))], axis=2) @ inv[:3, :3].T
            far = -inv[2, 3] / d[..., 2]
            at = inv[:3, 3] + far[..., None] * d
            column = np.floor((at[..., 0] / (1 + p.scale) - p.x0) * p.per_meter).astype(int)
            line = np.floor((at[..., 1] / (1 + p.scale) - p.y0) * p.per_meter).astype(int)
            H, W = p.image.shape
            inside = (column >= 0) & (column < W) & (line >= 0) & (line < H)
            total += inside * p.image[np.clip(line, 0, H - 1), np.clip(column, 0, W - 1)]
            hits += inside
    grey = BLACK + total / np.maximum(hits, 1) * (WHITE - BLACK) / 255
    return np.where(hits > 0, grey, 0.0), hits / samples**2


@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), (0.5, -0.3, 0.2), (1.2, 0.1, 0.0)])
def test_rays_meet_the_print_as_by_hand(tilt):
    lens = PinholeCamera(320, 240, 300.0, 305.0, 158.0, 121.0, (0.05, -0.1, 0.001, 0.0, 0.0))
    p = replace(printed(1500), scale=0.01)
    T = np.ascontiguousarray(make_pose(None, [-0.05, -0.04, 0.5]) @ exp(np.array([0, 0, 0, *tilt])))
    u0, v0, u1, v1 = board_window(p, lens, T)
    rays = lens_rays(lens, u0 - 1, v0 - 1, u1 + 1, v1 + 1)
    mean = np.empty((v1 - v0, u1 - u0), np.float32)
    cover = np.empty_like(mean)
    sheet = np.array([p.x0, p.y0, p.per_meter, p.scale, *p.center, *p.half, 0.0, 0.0])
    cast_print(rays, T, p.image, sheet, 4, mean, cover)
    expected, share = cast_by_hand(rays, T, p, 4)
    # A ray that falls on the very edge of a print's pixel may be rounded either way.
    assert np.mean(np.abs(mean - expected) > 0.5) < 0.01
    assert np.mean(np.abs(cover - share) > 0.01) < 0.01
    assert cover.max() == 1.0


def test_a_board_seen_from_behind_is_not_drawn():
    lens = PinholeCamera(320, 240, 300.0, 300.0, 160.0, 120.0)
    T = make_pose(None, [0.0, 0.0, 0.6]) @ from_rpy((np.pi, 0, 0), (0, 0, 0))
    assert board_window(printed(1500), lens, T) is None
    assert board_window(printed(1500), lens, make_pose(None, [0, 0, -0.6])) is None


def world_of(solids=(), error=1.0, model="kinect_v2"):
    """A board that stands before a camera in world."""
    arm = ArmSpec(make_robot(), np.eye(4), np.zeros(6))
    T_world_camera = look_at((2.0, 0.0, 1.0), (0.0, 0.0, 1.0))
    info = camera_info("cam", model, T_mount_camera=T_world_camera)
    middle = BOARD.points.mean(0)
    T = T_world_camera @ make_pose(None, [0.02, -0.03, 0.9]) @ exp(np.array([0, 0, 0, 0.3, 0.2, 0]))
    spec = BoardSpec(printed(), "world", T @ make_pose(None, -middle), error)
    camera = CameraSpec(info, T_world_camera, lens_error=1.0)
    return SimulatedWorld(WorldSpec(arm, (camera,), undeclared=tuple(solids), board=spec), 3)


@pytest.mark.parametrize("model", ["kinect_v2", "kinect_v1"])
def test_corners_are_where_the_true_board_has_them(gl, model):
    """Through the true lenses, on the print as it was really printed: to a tenth of a pixel."""
    with world_of(model=model) as world:
        frame, unit = world.snap(0, 1), world.cameras[0].unit
        scale = world.cameras[0].info.infrared_scale
        T = inverse(unit.T_mount_camera) @ world.board.T_mount_board
        found = BOARD.detect(frame.infrared)
        true = true_corners(world.board.print, T, unit.infrared(scale))
        assert np.sqrt(np.mean((found.pixel - true[found.corner]) ** 2)) < 0.12
        grey = np.rint(frame.color.astype(float).mean(2)).astype(np.uint8)
        found = BOARD.detect(grey)
        true = true_corners(world.board.print, inverse(unit.T_depth_color) @ T, unit.color)
        assert np.sqrt(np.mean((found.pixel - true[found.corner]) ** 2)) < 0.08


def test_depth_sees_the_plate(gl):
    with world_of() as world:
        frame, unit = world.snap(0, 1), world.cameras[0].unit
        T = inverse(unit.T_mount_camera) @ world.board.T_mount_board
        corners = true_corners(world.board.print, T, unit.depth)
        z = np.array([frame.depth[round(v), round(u)] for u, v in corners])
        true = (BOARD.points @ T[:3, :3].T + T[:3, 3])[:, 2]
        assert np.nanmedian(np.abs(z - true)) < 0.06  # the unit's own errors


def test_what_stands_before_the_board_hides_it(gl):
    with world_of() as world:
        T = world.board.T_mount_board
    ball = Solid("ball", "sphere", (0.03, 0.0, 0.0), T @ make_pose(None, [0.06, 0.045, -0.2]))
    with world_of([ball]) as world:
        hidden = world.snap(0, 1).infrared
    with world_of() as world:
        clear = world.snap(0, 1).infrared
    changed = np.abs(hidden.astype(int) - clear.astype(int)) > 30
    assert changed.sum() > 200
    assert not hasattr(BOARD.detect(clear), "reason")
    assert hasattr(BOARD.detect(hidden), "reason")


def test_at_rest_exposures_differ_in_noise_alone(gl):
    with world_of() as world:
        one, two = world.snap(0, 1), world.snap(0, 2)
    with world_of() as world:
        again = world.snap(0, 1)
    np.testing.assert_array_equal(one.color, again.color)
    np.testing.assert_array_equal(one.infrared, again.infrared)
    for a, b, sigma in ((one.color, two.color, 3.0), (one.infrared, two.infrared, 5.0)):
        middle = (a > 30) & (a < 220)
        difference = a.astype(float)[middle] - b.astype(float)[middle]
        assert np.std(difference) == pytest.approx(sigma * np.sqrt(2), rel=0.1)


def test_pictures_come_only_when_asked_for(gl):
    with world_of() as world:
        camera = world.cameras[0]
        world.advance(0.2)
        assert camera.read().color is None
        camera.want_color(30.0)
        world.advance(0.4)
        frame = camera.read()
        assert frame.color is not None
        assert frame.infrared is None
        camera.want_infrared(True)
        world.advance(0.6)
        assert camera.read().infrared.shape == (424, 512)
        camera.stand_by(True)
        world.advance(1.0)
        camera.read()
        world.advance(1.4)
        assert camera.read() is None


def test_the_board_that_the_seed_puts_there():
    spec = BoardSpec(printed(1000), "flange", np.eye(4))
    a, b, c = draw_board(spec, 1), draw_board(spec, 1), draw_board(spec, 2)
    np.testing.assert_array_equal(a.T_mount_board, b.T_mount_board)
    assert not np.allclose(a.T_mount_board, c.T_mount_board)
    exact = draw_board(replace(spec, error=0.0), 1)
    np.testing.assert_array_equal(exact.T_mount_board, np.eye(4))
    assert exact.print.scale == 0.0
