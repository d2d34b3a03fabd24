"""Vehicle files, the car that they describe in a cell, and what the cell is told of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from armsight.charging.ports.table import PORTS
from armsight.charging.vehicle_file import FOLDER, load_vehicle, packaged
from armsight.errors import UsageError, WorkcellError
from armsight.experiments.station_bench import charging_cell, parked
from armsight.geometry.pose import exp, from_rpy, inverse, make_pose, transform
from armsight.mapping.snapshot import Declared, VoxelGrid
from armsight.runtime.configure import mapping_config
from armsight.simulation.parked_car import SPEED, ParkedCar
from armsight.simulation.spec import SocketSpec
from armsight.tasks.parked_car import ParkedCarOnMap
from armsight.workcell import parse_workcell, world_spec

TEXT = (FOLDER / "hatchback.toml").read_text()
T_PORT = make_pose(np.column_stack([[0, -1, 0], [0, 0, 1], [-1, 0, 0]]), (0.9, 0.0, 0.85))


def corridor(radius=0.05):
    """Points of a plug on its way in, from 0.3 m before the face to the seat, by the port."""
    turn, z = np.meshgrid(np.linspace(0, 2 * np.pi, 24), np.linspace(-0.035, 0.30, 40))
    ring = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], -1)
    return ring.reshape(-1, 3)


@pytest.mark.parametrize("seed", range(4))
def test_wherever_a_car_is_parked_nothing_stands_in_the_way_into_its_port(seed):
    """The car is one thing: a flank that stays where the port was before blocks the plug."""
    rng = np.random.default_rng(seed)
    place = (rng.uniform(0.87, 0.97), rng.uniform(-0.05, 0.15), rng.uniform(0.75, 0.95))
    cell = parked(charging_cell(), place, 180 + rng.uniform(-10, 10), lean_deg=rng.uniform(0, 10))
    spec = world_spec(cell)
    way = transform(spec.socket.T_world_socket, corridor())
    for solid in (*spec.static, *spec.undeclared):
        assert solid.distance(way).min() > 0.0, solid.name
    for solid in spec.socket.solids:
        assert solid.distance(corridor()).min() > 0.0, solid.name


@pytest.mark.parametrize("name", packaged())
def test_a_packaged_vehicle_lets_its_plug_in_and_closes_round_it(name):
    shape = load_vehicle(name)
    outline = [rim.outline for rim in PORTS[shape.inlet].of_kind("mouth")]
    for mouth in outline:  # the opening holds the whole mouth
        for edge, at in (
            (shape.opening_mm.left, mouth.radius - mouth.x),
            (shape.opening_mm.right, mouth.radius + mouth.x),
            (shape.opening_mm.down, mouth.radius - mouth.y),
        ):
            assert edge > 1e3 * at
    # a probe beside the opening at the body's depth is in the body, one in the opening is not
    solids = shape.solids
    beside = np.array([[0.2, 0.0, -0.05], [-0.2, 0.0, -0.05], [0.0, 0.2, -0.05], [0, -0.3, -0.05]])
    assert (np.min([s.distance(beside) for s in solids], axis=0) < 0).all()
    assert min(float(s.distance(np.zeros((1, 3)))[0]) for s in solids) > 0.05
    assert min(float(s.distance(np.array([[0, 0, -0.2]]))[0]) for s in solids) < 0.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('inlet = "type2"', 'inlet = "type3"', "no inlet 'type3'; there are type1"),
        ('inlet = "type2"', 'inlet = "type2_plug"', "no inlet 'type2_plug'"),
        ("front_mm = 10", "front_mm = nan", "front_mm: Input should be a finite number"),
        ("height_m = [0.60, 1.10]", "height_m = [1.1, 0.6]", "the second has to be greater"),
        ("behind_mm = 90", "behind_mm = 5", "behind_mm: Input should be greater than or equal"),
        ("up = 0.55 }", "up = 0.06 }", "side_m.up ends within the opening"),
        ("thickness_m = 0.6", "thickness = 0.6", "thickness: Extra inputs are not permitted"),
        ("front_mm = 10", "front_mm 10", "not TOML"),
        ("front_mm = 10", "front_mm = 1" + 5000 * "0", "not TOML"),
        ("lean_deg = [-5, 25]", '[lid]\nlatch = "magnet"', "lid.latch: Input should be 'push',"),
        ("lean_deg = [-5, 25]", '[lid]\nlatch = "push"\nopens_deg = 40', "lid.opens_deg"),
        ("lean_deg = [-5, 25]", '[lid]\nlatch = "push"', "opening_mm.right ends within the lid"),
        (
            "thickness_m = 0.6",
            "thickness_m = 0.095",
            "behind_mm has to be less than thickness_m less front_mm",
        ),
    ],
)
def test_a_broken_vehicle_file_is_an_error_that_says_where(tmp_path, old, new, words):
    assert old in TEXT
    file = tmp_path / "car.toml"
    file.write_text(TEXT.replace(old, new))
    with pytest.raises(UsageError, match=words):
        load_vehicle(file)


def test_a_vehicle_that_is_not_there_names_those_that_are(tmp_path):
    with pytest.raises(UsageError, match="packaged are city_car, crossover, hatchback"):
        load_vehicle(tmp_path / "none.toml")
    with pytest.raises(UsageError, match="packaged are city_car"):
        load_vehicle("no\0name")
    text = charging_cell().text
    wrong = text.replace('[simulation.car]\nport = "type2"', '[simulation.car]\nport = "ccs2"')
    with pytest.raises(WorkcellError, match="hatchback has type2, not ccs2"):
        world_spec(parse_workcell(wrong))
    with pytest.raises(WorkcellError, match="vehicle"):
        world_spec(parse_workcell(text.replace('vehicle = "hatchback"', 'vehicle = "tank"')))


def test_a_port_where_no_such_car_has_one_is_no_such_car():
    shape = load_vehicle("hatchback")
    assert shape.contradiction(T_PORT) == ""
    low = T_PORT.copy()
    low[2, 3] = 0.3
    assert "0.3 m above the floor; expected 0.6 to 1.1 m" in shape.contradiction(low)
    leaning = T_PORT @ make_pose(from_rpy((np.deg2rad(-40), 0, 0))[:3, :3])
    assert "deg above the horizontal" in shape.contradiction(leaning)


def test_a_car_is_driven_no_faster_than_it_may_and_keeps_its_height():
    car = ParkedCar(SocketSpec("port", T_PORT, np.zeros((0, 4, 4)), np.zeros((0, 3))), seed=1)
    position, quaternion = np.zeros((1, 3)), np.zeros((1, 4))
    car.update(0.0, position, quaternion)
    np.testing.assert_allclose(position[0], T_PORT[:3, 3])
    car.drag(np.array([0.95, 0.08, 5.0]))
    assert not car.parked
    last = position.copy()
    for k in range(1, 200):
        car.update(0.01 * k, position, quaternion)
        assert np.linalg.norm(position - last) < SPEED * 0.01 + 1e-9
        last = position.copy()
    np.testing.assert_allclose(position[0], [0.95, 0.08, 0.85], atol=1e-9)
    assert car.parked
    places = []
    for k in range(20):
        car.anew()
        car.update(1000.0 * (k + 1), position, quaternion)
        assert car.parked
        away = inverse(T_PORT) @ car.T_world_socket
        places.append(away[:3, 3])
        assert np.abs((car.T_world_socket - T_PORT)[:2, 3]).max() <= 0.1
        assert car.T_world_socket[2, 3] == pytest.approx(0.85)
        assert np.rad2deg(np.arccos(away[2, 2])) <= 10.001
    assert np.ptp(places, axis=0)[0] > 0.05
    car.reset()
    np.testing.assert_array_equal(car.T_world_socket, T_PORT)


SURE = np.zeros((6, 6))


def moved(millimetres):
    return T_PORT @ exp(np.array([1e-3 * millimetres, 0, 0, 0, 0, 0]))


def test_the_cars_body_is_said_once_and_a_surer_one_takes_its_place():
    body = ParkedCarOnMap(load_vehicle("hatchback"), np.eye(4))
    assert body.standing == {}
    body.found(T_PORT, SURE)
    (first,) = body.standing
    np.testing.assert_allclose(
        body.standing[first][0].T_frame_solid,
        T_PORT @ body.shape.solids[0].T_frame_solid,
        atol=1e-12,
    )
    said = body.standing[first]
    body.found(moved(1), SURE)
    assert list(body.standing) == [first]
    body.found(moved(8), SURE)  # a better look: both stand until the map counts the new one
    assert len(body.standing) == 2
    assert body.standing[first] is said
    second = next(reversed(body.standing))
    waiting = Declared(second, (), waiting=True)
    assert body.told(SimpleNamespace(declared=(waiting,))) == ""
    assert len(body.standing) == 2
    body.told(SimpleNamespace(declared=(Declared(second, (), taken=True),)))
    assert list(body.standing) == [second]


def test_a_side_whose_tilt_is_unsure_is_said_farther_out_but_not_so_far_as_to_be_seen_through():
    """The guard took what stood out of the first look's side for somebody, and hardly moved."""
    shape = load_vehicle("city_car")
    surface = np.array([[0.0, 0.4, 0.010], [0.5, 0.0, 0.010], [-0.4, -0.3, 0.010]])
    for tilt_deg, covered_deg in ((0.0, 0.0), (1.0, 3.0), (4.0, 5.0)):
        body = ParkedCarOnMap(shape, np.eye(4))
        tilt = np.deg2rad(tilt_deg)
        body.found(T_PORT, np.diag([0, 0, 0, tilt**2, 0.2 * tilt**2, 0.0]))
        (solids,) = body.standing.values()
        lean = from_rpy((np.deg2rad(covered_deg), 0.0, 0.0))
        true = transform(T_PORT @ lean, surface)
        inside = np.min([s.distance(true) for s in solids], axis=0)
        assert inside.max() < 0.002
        out = transform(T_PORT, np.array([[0.0, 0.4, 0.065]]))
        assert min(float(s.distance(out)[0]) for s in solids) > 0.0


@pytest.mark.parametrize("tilt_deg", [0.0, 0.3, 1.0, 1.8])
def test_a_side_that_leans_the_other_way_is_seen_within_what_is_said_to_be_coarse(tilt_deg):
    """Else its own far end would count as somebody until the second look."""
    shape = load_vehicle("hatchback")
    body, tilt = ParkedCarOnMap(shape, np.eye(4)), np.deg2rad(tilt_deg)
    body.found(T_PORT, np.diag([0, 0, 0, tilt**2, tilt**2, 0.0]))
    (solids,) = body.standing.values()
    assert {s.coarse for s in solids} == {solids[0].coarse}
    assert 0.05 <= solids[0].coarse <= 0.25
    ends = np.array([[x, y, 0.010] for x in (-1.4, 1.5) for y in (-0.3, 0.5)])
    for turn in ((3.0 * tilt, 0.0, 0.0), (0.0, 3.0 * tilt, 0.0), (0.0, -3.0 * tilt, 0.0)):
        true = transform(T_PORT @ from_rpy(turn), ends)
        deep = -np.min([s.distance(true) for s in solids], axis=0)
        assert deep.max() <= solids[0].coarse


def test_a_second_look_that_agrees_lets_the_body_be_said_where_it_is():
    """It stayed up to 5 cm before itself where both looks found the port in one place."""
    shape = load_vehicle("hatchback")
    body = ParkedCarOnMap(shape, np.eye(4))
    body.found(T_PORT, np.diag([0, 0, 0, np.deg2rad(1.5) ** 2, 0, 0]))
    body.found(moved(1), SURE)
    assert len(body.standing) == 2
    newest = list(body.standing.values())[-1]
    before = transform(moved(1), np.array([[0.0, 0.4, 0.012]]))
    assert min(float(s.distance(before)[0]) for s in newest) > 0.0
    body.found(T_PORT, np.diag([0, 0, 0, np.deg2rad(0.2) ** 2, 0, 0]))
    assert list(body.standing.values())[-1] is newest


def test_a_car_that_has_moved_is_withdrawn_at_once_and_a_refusal_is_said():
    body = ParkedCarOnMap(load_vehicle("hatchback"), np.eye(4))
    body.found(T_PORT, SURE)
    (first,) = body.standing
    body.found(moved(60), SURE)
    (second,) = body.standing
    assert second != first
    refused = Declared(second, (), reason="refused: camera left sees through it")
    snapshot = SimpleNamespace(declared=(refused,))
    assert body.told(snapshot) == "the car's side: refused: camera left sees through it"
    body.gone()
    assert body.standing == {}
    assert body.told(snapshot) == ""
    assert ParkedCarOnMap(None, np.eye(4)).contradiction(np.eye(4)) == ""


def room_map(lower, upper, voxel=0.02):
    shape = tuple(np.rint((np.array(upper) - lower) / voxel).astype(int))
    grid = VoxelGrid(np.array(lower), voxel, shape)
    return SimpleNamespace(declared=(), stamp=1.0, grid=grid, hazard_radius=0.0174)


def test_a_port_at_the_end_of_what_is_mapped_is_left_alone():
    """The guard would refuse the contact: nobody sees who is beside it. It had been waited for."""
    shape = load_vehicle("hatchback")
    body = ParkedCarOnMap(shape, np.eye(4))
    beside, whole = moved(0), room_map((-1.0, -1.0, 0.0), (1.5, 1.0, 1.6))
    assert shape.contradiction(beside) == ""
    body.told(whole)
    assert body.contradiction(beside) == ""
    x = float(beside[0, 3])
    body.told(room_map((-1.0, -1.0, 0.0), (x + 0.14, 1.0, 1.6)))
    assert "too near the end of the mapped box" in body.contradiction(beside)
    body.told(room_map((-1.0, -1.0, 0.0), (x + 0.24, 1.0, 1.6)))
    assert body.contradiction(beside) == ""
    low = beside.copy()
    low[2, 3] = 0.3
    assert body.contradiction(low).startswith("not the car that is expected: the port is 0.3 m")


@pytest.mark.parametrize("port", ["type2", "type1", "ccs2"])
def test_the_packaged_cells_are_mapped_past_their_parking_place_and_no_farther_than_their_wall(
    port,
):
    """At 1.22 m one of 50 ports was at the map's end; at 1.34 m nobody sees what is behind the
    wall, and what might have been there held two of 20 arms with their plug half in."""
    cell = charging_cell(port)
    assert cell.plug is not None
    config = mapping_config(cell, cell.robot.T_world_base, 1.3)
    lower, upper = np.array(config.lower), np.array(config.upper)
    on_map = room_map(lower, upper)
    body = ParkedCarOnMap(load_vehicle(cell.plug.vehicle), cell.robot.T_world_base)
    body.told(on_map)
    for corner in np.ndindex(2, 2, 2, 2, 2):
        x, y, z = (0.84 + 0.2 * corner[0], -0.05 + 0.2 * corner[1], 0.75 + 0.2 * corner[2])
        car = parked(cell, (x, y, z), 170.0 + 20.0 * corner[3], lean_deg=20.0 * corner[4])
        socket = world_spec(car).socket
        assert socket is not None
        T = inverse(cell.robot.T_world_base) @ socket.T_world_socket
        assert body.contradiction(T) == ""
    wall = next(solid for solid in cell.solid if solid.name == "wall_front")
    end = float((cell.robot.T_world_base @ np.array([*upper, 1.0]))[0])
    assert wall.position[0] - 0.5 * wall.size[0] < end <= wall.position[0] + 0.5 * wall.size[0]
