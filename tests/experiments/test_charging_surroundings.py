"""What is drawn about a visit: where the pair stands, the light, and how somebody moves the car."""

import numpy as np
import pytest

from armsight.devices.camera_models import stereo_pair
from armsight.devices.data import StereoFrame
from armsight.experiments.car_nudges import KINDS, drawn
from armsight.experiments.charging_faults import FAULTS, faulty_visit
from armsight.experiments.port_scene import LIGHTS
from armsight.experiments.port_weather import Style
from armsight.experiments.station_bench import StationBench, charging_cell
from armsight.experiments.station_weather import PLACES, POST, Surroundings, surroundings
from armsight.geometry.pose import from_rpy, inverse, make_pose

CLEAN = Style(1.0, 0.0, 0.01, 0.0, 0.0, 0.0, 1.0, 1)
T_PORT = make_pose(from_rpy((np.pi / 2, 0.0, -np.pi / 2))[:3, :3], (0.92, 0.05, 0.85))


def test_all_places_and_lights_come_up_and_the_same_seed_draws_the_same():
    many = [surroundings(np.random.default_rng(k)) for k in range(200)]
    assert {s.place for s in many} == set(PLACES)
    assert {s.light for s in many} == set(LIGHTS)
    assert 0.15 < np.mean([s.style.wet > 0 for s in many]) < 0.35
    assert surroundings(np.random.default_rng(3)) == many[3]


@pytest.mark.parametrize("place", PLACES)
def test_the_port_is_before_the_pair_wherever_it_stands(place):
    """0.8 to 2.5 m away, no more than 45 deg off the port's axis, in the middle of its picture."""
    around = Surroundings(place, "indoor", 0.1, CLEAN, 1)
    pair = next(p for p in around.moved(charging_cell()).stereo if p.name == POST)
    T = inverse(pair.T_mount_camera) @ T_PORT
    away = float(np.linalg.norm(T[:3, 3]))
    assert 0.8 < away < 2.5
    assert -(T[:3, 2] @ T[:3, 3]) / away > np.cos(np.deg2rad(45.0))
    lens = stereo_pair(pair.model).left
    u, v = lens.project(T[None, :3, 3])[0]
    assert 0.2 * lens.width < u < 0.8 * lens.width
    assert 0.2 * lens.height < v < 0.8 * lens.height


def test_no_weather_leaves_a_picture_as_it_is_and_dirt_stays_on_the_port():
    """The same dirt lies on the same part of the port in both lenses, or it would be noise."""
    cell = charging_cell()
    section = next(p for p in cell.stereo if p.name == POST)
    bench = StationBench(cell, 5, rendered=True)
    with bench.world:
        camera = next(c for c in bench.world.stereo_cameras if c.info.name == POST)
        info = camera.info
    T = inverse(section.T_mount_camera) @ T_PORT
    blank = np.full((info.left.height, info.left.width, 3), 40, np.uint8)
    frame = StereoFrame(POST, 3, 0.0, 0.0, blank, blank)
    clean = Surroundings("as packaged", "indoor", 0.1, CLEAN, 1).over(frame, info, T)
    assert np.abs(clean.left.astype(int) - 40).max() <= 1
    dirt = Surroundings("as packaged", "indoor", 0.1, Style(1, 0, 0.01, 0.9, 0, 0, 1, 1), 1)
    seen = dirt.over(frame, info, T)
    axes = np.linspace(-0.06, 0.06, 15)
    on_port = np.array([(x, y, 0.0) for x in axes for y in axes])
    levels = []
    for picture, lens, T_lens in (
        (seen.left, info.left, np.eye(4)), (seen.right, info.right, info.lenses.T_left_right)
    ):  # fmt: skip
        at = inverse(T_lens) @ T
        u, v = np.rint(lens.project(on_port @ at[:3, :3].T + at[:3, 3])).astype(int).T
        levels.append(picture[v, u, 0].astype(float))
    assert levels[0].std() > 2.0
    assert np.corrcoef(*levels)[0, 1] > 0.8


def test_dirt_is_as_bright_as_the_light_that_falls_on_it():
    """In a dark cell it shone by itself, and hid a port 1 m away that anybody sees."""
    cell = charging_cell()
    section = next(p for p in cell.stereo if p.name == POST)
    bench = StationBench(cell, 5, rendered=True)
    with bench.world:
        info = next(c for c in bench.world.stereo_cameras if c.info.name == POST).info
    T = inverse(section.T_mount_camera) @ T_PORT
    black = np.zeros((info.left.height, info.left.width, 3), np.uint8)
    frame, dirty = StereoFrame(POST, 3, 0.0, 0.0, black, black), Style(1, 0, 0.01, 0.9, 0, 0, 1, 1)
    level = [
        Surroundings("as packaged", light, 0.1, dirty, 1).over(frame, info, T).left.max()
        for light in ("indoor", "dim")
    ]
    assert level[1] == pytest.approx(0.3 * level[0], abs=2.0)
    assert level[0] > 20


def test_a_low_sun_stands_before_the_port():
    around = Surroundings("as packaged", "low_sun", 0.1, CLEAN, 4)
    bench = StationBench(charging_cell(), 5, around=around)
    with bench.world:
        model, T = bench.world.plugged._model, bench.world.car.T_world_socket
        way = model.light_pos[0] - T[:3, 3]
    assert way @ T[:3, 2] > 0.0
    assert way[2] / np.linalg.norm(way) < np.sin(0.36)


@pytest.mark.parametrize("kind", KINDS)
def test_a_car_that_somebody_moves_goes_smoothly_and_no_farther_than_said(kind):
    for seed in range(30):
        nudge = drawn(kind, T_PORT, np.random.default_rng(seed))
        times = np.arange(0.0, nudge.lasts + 0.5, 0.008)
        way = np.array([nudge.at(t, T_PORT) for t in times])
        off = np.linalg.norm(way[:, :3, 3] - T_PORT[:3, 3], axis=1)
        assert off[0] == 0.0
        assert 0.003 <= off.max() <= 0.0201
        assert (off[-1] < 1e-9) == (kind == "leaned on")
        assert np.linalg.norm(np.diff(way[:, :3, 3], axis=0), axis=1).max() < 0.008 * 0.16
        if kind == "drawn away":
            assert (way[-1, :3, 3] - T_PORT[:3, 3]) @ T_PORT[:3, 2] < 0.0


@pytest.mark.slow  # whole visits
@pytest.mark.parametrize("kind", KINDS)
def test_a_visit_of_a_car_that_somebody_moves_ends_well(kind):
    found = faulty_visit(charging_cell(), kind, 5000 + FAULTS.index(kind))
    assert found["good"], found
    assert max(found["axial_n"], found["lateral_n"], found["pull_n"]) < 125.0
