"""Colours, words, plots and voxels of the page."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from page_fakes import GRID, make_cell, make_guard, make_snapshot

from armsight.devices.data import ArmStatus, GripperState, Wrench
from armsight.devices.line import DeviceHealth
from armsight.geometry.pose import from_rpy, make_pose, transform
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import CameraCorrection, CameraStatus, Declared, Emptiness
from armsight.motion.data import GuardMode
from armsight.motion.permits import Permit, PermitState
from armsight.runtime.view import ComponentHealth
from armsight.viewer import colors, html
from armsight.viewer.accuracy import NEVER, TrueErrors, accuracy
from armsight.viewer.cameras import TILE, mosaic
from armsight.viewer.danger import FADE, voxels
from armsight.viewer.devices import devices
from armsight.viewer.history import SECONDS, History
from armsight.viewer.nodes import quaternions
from armsight.viewer.primitives import CUBE, CYLINDER, SPHERE
from armsight.viewer.solids import is_wall, scale_of, wall_face


def test_every_mode_has_its_own_colour_and_words() -> None:
    assert set(colors.MODES) == set(GuardMode)
    assert len({color for _, color in colors.MODES.values()}) == len(GuardMode)
    for mode in GuardMode:
        guard = make_guard(1.0, mode=mode, reason="because")
        text = html.banner(guard, "")
        assert colors.MODES[mode][0] in text
        assert colors.MODES[mode][1] in text
        assert "because" in text


def test_a_goal_is_gone_to_and_a_velocity_is_named_by_what_it_does() -> None:
    assert "to box" in html.banner(make_guard(1.0, goal="box"), "")
    assert "at box" in html.banner(make_guard(1.0, goal="box", reached=True), "")
    works = html.banner(make_guard(1.0, mode=GuardMode.VELOCITY, goal="works the lid"), "")
    assert ">works the lid<" in works


def test_words_from_outside_cannot_become_markup() -> None:
    evil = "<img src=x onerror=alert(1)>"
    pieces = [
        html.banner(make_guard(1.0, reason=evil, goal=evil), evil),
        html.cameras([CameraStatus(evil, 0.0, False, 1, 2, evil)], 1.0),
        html.components([ComponentHealth(evil, 0.1, 1, 0, 0.0, (0.0, 0.0), evil)]),
        html.timings([(evil, 0.1)]),
        devices([ArmStatus(0.0, "protective_stop", 0.5, evil)], [DeviceHealth(evil, "lost", evil)]),
        devices([ArmStatus(0.0, evil, 0.5)], []),  # type: ignore[arg-type]  # of a recording
    ]
    for piece in pieces:
        assert "<img" not in piece
        assert "&lt;img" in piece
        assert len(re.findall("<div", piece)) == len(re.findall("</div", piece))


def test_devices_say_how_they_are() -> None:
    readings = [
        ArmStatus(0.0, "emergency_stop", 0.5),
        Wrench(0.0, np.array([3.0, 4.0, 0.0]), np.zeros(3)),
        GripperState(0.0, 0.042, True),
    ]
    text = devices(readings, [DeviceHealth("camera 'c'", "open", clock_error=0.002)])
    for word in ("emergency stop", "50 %", "5.0 N", "42 mm", "moves", "±2.0 ms", html.BAD):
        assert word in text
    assert devices([], []) == ""


def test_what_is_believed_of_the_cameras_and_what_is_true() -> None:
    """Standard deviations as the file's covariance says; never calibrated ones say so."""
    left, right, _ = (camera.info for camera in make_cell().cameras)
    C = np.diag([1.0, 4.0, 2.25, 1e-8, 1e-8, 4e-8]) * np.array([1e-6] * 3 + [1.0] * 3)
    left = replace(left, name="<l>", covariance=C)
    text = accuracy([left, right], {})
    assert "2.00 mm" in text
    assert f"{np.rad2deg(2e-4):.3f}" in text
    assert text.count(NEVER) == 1
    assert "&lt;l&gt;" in text
    assert "simulation" not in text
    told = accuracy([left, right], {"<l>": 0.00074, "right": 0.0674})
    assert "0.7 mm" in told
    assert "67.4 mm" in told
    assert "simulation" in told


def test_the_truth_is_asked_for_again_only_when_the_map_corrects_otherwise() -> None:
    asked = []

    class Truth:
        def camera_error(self, name: str, T: np.ndarray, gain: float) -> float | None:
            asked.append((name, T[0, 3], gain))
            return None if name == "wrist" else 0.001 + T[0, 3]

    infos = [camera.info for camera in make_cell().cameras]
    errors = TrueErrors(Truth(), infos)  # type: ignore[arg-type]
    assert errors.now(None) == {"<left>": 0.001, "right": 0.001}
    moved = make_pose(None, [0.002, 0.0, 0.0])
    snapshot = replace(make_snapshot(1, 1.0), corrections=(CameraCorrection("right", moved, 1.01),))
    for _ in range(3):
        assert errors.now(snapshot) == {"<left>": 0.001, "right": pytest.approx(0.003)}
    assert asked[3:] == [("right", 0.002, 1.01)]
    assert TrueErrors(None, infos).now(snapshot) == {}


def test_a_camera_is_not_alive_for_longer_than_any_map_waits() -> None:
    status = CameraStatus("c", 1.0, True, 5, 0)
    assert html.GOOD in html.cameras([status], 1.1)
    old = html.cameras([status], 4.0)
    assert html.GOOD not in old
    assert "nothing of it since" in old


def test_too_close_is_red() -> None:
    assert html.BAD in html.figures(make_guard(1.0, distance=0.2, protective_distance=0.3), 0, 0)
    assert html.BAD not in html.figures(
        make_guard(1.0, distance=0.4, protective_distance=0.3), 0, 0
    )


def test_the_page_says_what_became_of_an_empty_cell() -> None:
    snapshot = SimpleNamespace(
        emptiness=Emptiness(waiting=True, reason="something moves near (1, 0, 0) m"),
        things=(),
        declared=(),
        inside=(),
    )
    assert "something moves near" in html.emptiness(snapshot)
    snapshot.emptiness, snapshot.things = Emptiness(said=True), (1, 2, 3)
    assert "3 voxels of things" in html.emptiness(snapshot)
    snapshot.declared = (
        Declared("car", (), taken=True),
        Declared("<box>", (), reason="a camera sees through it"),
    )
    assert "car is declared" in html.emptiness(snapshot)
    assert "&lt;box&gt;: a camera sees through it" in html.emptiness(snapshot)
    assert html.emptiness(None) == ""


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_any_distance_has_words(value: float) -> None:
    assert html.metres(value) == "–" or html.metres(value).endswith(" m")


def test_near_is_warm_far_is_cold_nothing_is_black() -> None:
    depth = np.array([[0.5, 2.0, 4.0, np.nan, 99.0, np.inf]], np.float32)
    [near, middle, far, none, beyond, infinite] = colors.depth_picture(depth, 6, 0.5, 4.0)[0]
    assert near[0] > near[2]
    assert far[2] >= far[0]
    assert middle[1] > 200
    assert tuple(none) == (12, 12, 12)
    assert tuple(beyond) == tuple(far)
    assert tuple(infinite) == (12, 12, 12)


@pytest.mark.parametrize("shape", [(424, 512), (48, 64), (1, 1), (1080, 1920)])
def test_pictures_are_small(shape: tuple[int, int]) -> None:
    picture = colors.depth_picture(np.ones(shape, np.float32), 192, 0.5, 4.0)
    assert picture.dtype == np.uint8
    assert max(1, shape[1] // 12) >= 1
    assert picture.shape[1] <= 192
    assert colors.fit(picture, *TILE).shape == (TILE[1], TILE[0], 3)


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4, 5])
def test_a_mosaic_has_a_tile_for_each(count: int) -> None:
    tiles = mosaic([None] * count)
    columns = 1 if count < 2 else 2
    assert tiles.shape == (TILE[1] * max(1, -(-count // columns)), TILE[0] * columns, 3)


def test_voxels_are_the_newest_and_no_older_than_danger_lasts() -> None:
    snapshot = make_snapshot(3, 100.0, voxels=500)
    last = snapshot.last_occupied
    oracle = {
        tuple(index): 100.0 - last[tuple(index)]
        for index in np.argwhere(last > np.float32(100.0 - FADE))
    }
    centers, shades, age = voxels(snapshot, 100.0, 1000)
    assert {tuple(i) for i in GRID.index(centers)} == set(oracle)
    for center, old in zip(centers, age):
        assert oracle[tuple(GRID.index(center[None])[0])] == pytest.approx(old, abs=1e-4)
    assert np.all(shades[np.argmin(age)] == colors.DANGER[int(255 * (1 - age.min() / FADE))])
    few, _, few_age = voxels(snapshot, 100.0, 50)
    assert len(few) == 50
    assert few_age.max() <= np.sort(age)[50] + 1e-6
    none, _, _ = voxels(make_snapshot(1, 0.0, voxels=0), 0.0, 50)
    assert len(none) == 0


def test_history_is_bounded_and_relative() -> None:
    history = History(2)
    assert all(len(column) == 2 for column in history.columns())
    for i in range(2000):
        history.add(0.05 * i, float(i), -float(i))
    time, first, second = history.columns()
    assert time[-1] == 0.0
    assert time[0] >= -SECONDS
    assert len(time) <= SECONDS * 10 + 1
    np.testing.assert_array_equal(first, -second)
    assert np.all(np.diff(time) > 0)
    history.add(1.0, 7.0, 7.0)  # the session was reset
    assert history.columns()[1].tolist() == [7.0, 7.0]


@given(st.integers(0, 2**32 - 1))
def test_quaternions_are_scipys_one_by_one(seed: int) -> None:
    from scipy.spatial.transform import Rotation

    turns = Rotation.random(5, np.random.default_rng(seed))
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, :3, :3] = turns.as_matrix()
    for wxyz, turn in zip(quaternions(poses), turns):
        xyzw = turn.as_quat()
        assert abs(abs(wxyz @ xyzw[[3, 0, 1, 2]]) - 1.0) < 1e-12


@pytest.mark.parametrize(
    ("kind", "size", "extent"),
    [("box", (1.0, 2.0, 3.0), (1.0, 2.0, 3.0)), ("sphere", (0.5, 0.0, 0.0), (1.0, 1.0, 1.0)),
     ("cylinder", (0.2, 0.7, 0.0), (0.4, 0.4, 0.7))],
)  # fmt: skip
def test_instances_have_the_size_of_their_solid(kind, size, extent) -> None:  # type: ignore[no-untyped-def]
    shape = {"box": CUBE, "sphere": SPHERE, "cylinder": CYLINDER}[kind]
    vertices = shape.vertices * scale_of(Solid("s", kind, size, np.eye(4)))
    np.testing.assert_allclose(np.ptp(vertices, axis=0), extent, rtol=0.02)
    corners = vertices[shape.faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.all(np.sum(outward * corners.mean(axis=1), axis=1) > 0)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_wall_shows_the_face_towards_the_robot(axis: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = [3.0, 2.4, 2.0]
    size[axis] = 0.1
    solid = Solid("wall", "box", (size[0], size[1], size[2]), np.eye(4))
    assert is_wall(solid)
    T = from_rpy(rng.normal(size=3), rng.normal(size=3) * 3.0)
    inside = rng.normal(size=3)
    vertices, faces = wall_face(solid, T, inside)
    corners = transform(T, vertices.astype(float))
    assert np.allclose(np.abs(vertices), 0.5 * np.array(size), atol=1e-6)
    for a, b, c in corners[faces]:
        normal = np.cross(b - a, c - a)
        other = 2 * T[:3, 3] - a  # the far face's corner: the near face is nearer to the point
        assert (inside - T[:3, 3]) @ normal > 0
        assert np.linalg.norm(other - a) > 0


def test_tables_and_posts_are_no_walls() -> None:
    for size in ((1.4, 1.4, 0.05), (1.4, 1.4, 0.75), (0.06, 0.06, 2.0), (3.0, 0.4, 0.02)):
        assert not is_wall(Solid("s", "box", size, np.eye(4)))
    assert not is_wall(Solid("s", "sphere", (3.0, 0.0, 0.0), np.eye(4)))


def test_a_permit_is_shown_in_words_and_what_comes_from_outside_is_escaped() -> None:
    status = make_guard(1.0)
    assert html.permit(None) == html.permit(status) == ""
    asked = Permit("<b>ball", "thing", PermitState.GRANTED, speed=0.05, force=10.0, pressed=3.2)
    shown = html.permit(replace(status, permit=asked))
    assert "&lt;b&gt;ball" in shown
    assert "0.05 m/s, 10 N" in shown
    assert "pressed with 3.2 N" in shown
    refused = replace(asked, state=PermitState.REFUSED, reason="somebody is <beside> it")
    shown = html.permit(replace(status, permit=refused))
    assert "refused" in shown
    assert "somebody is &lt;beside&gt; it" in shown
    assert "10 N" not in shown
