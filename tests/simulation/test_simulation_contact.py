"""Contact that pushes: springs, weights, friction and what the truth keeps, against statics."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.body_regions import BODY_REGIONS
from armsight.geometry.pose import from_rpy, make_pose
from armsight.geometry.shapes import Solid
from armsight.robots import load_robot, load_tool
from armsight.robots.kinematics import tcp_jacobian, tcp_pose
from armsight.robots.sprung_tip import SprungTip, pressing_force
from armsight.simulation.giving import DENT, GIVING
from armsight.simulation.kernels import rotation_between, turn
from armsight.simulation.spec import (
    ArmSpec,
    GripperSpec,
    MovingObjectSpec,
    PersonSpec,
    WorldSpec,
    WrenchSpec,
)
from armsight.simulation.truth import region_at
from armsight.simulation.world import SimulatedWorld

EXACT = WrenchSpec(500.0, noise=(0.0, 0.0), bias=(0.0, 0.0), drift=(0.0, 0.0), low_pass=100.0)


@pytest.fixture(scope="module")
def robot():
    return load_robot("ur5").with_tool(load_tool("pen"))


def cell(robot, **more):
    arm = ArmSpec(robot, np.eye(4), robot.home, repeatability=0.0)
    return WorldSpec(arm, pushes=True, time_step=0.001, wrench=EXACT, **more)


def ball_before(robot, gap, radius=0.03, **more):
    tip = tcp_pose(robot, robot.home)
    center = tip[:3, 3] + tip[:3, 2] * (gap + radius)
    return MovingObjectSpec(
        Solid("ball", "sphere", (radius, 0, 0), make_pose(None, center)), **more
    )


def drive(world, robot, velocity, seconds):
    """Move the tip along its own z [m/s]; the wrench's readings."""
    felt = []
    end = world.clock.now() + seconds
    while world.clock.now() < end - 1e-9:
        T, J = tcp_pose(robot, world._data.qpos[:6]), tcp_jacobian(robot, world._data.qpos[:6])
        twist = np.concatenate([T[:3, 2] * velocity, np.zeros(3)])
        world.arm.command_velocity(np.linalg.solve(J.T @ J + 1e-6 * np.eye(6), J.T @ twist))
        world.advance(world.clock.now() + 0.008)
        while (reading := world.wrench.read()) is not None:
            felt.append(reading)
    return felt


def test_a_ball_on_a_stand_pushes_back_as_its_springs_say(robot):
    """At rest: Hooke for stand and surface in series, Newton's third law at the sensor."""
    spec = ball_before(robot, 0.01, mass=0.1, surface=20e3, hold=2000.0)
    with SimulatedWorld(cell(robot, objects=(spec,))) as world:
        free = drive(world, robot, 0.0, 0.3)[-1].force
        start = world.truth.tip_position()
        drive(world, robot, 0.05, 0.4)
        felt = drive(world, robot, 0.0, 0.6)[-1].force - free
        contact = world.truth.contacts[0]
        pushed = np.linalg.norm(world.truth.tip_position() - start) - 0.01
        assert (contact.kind, contact.owner) == ("object", "ball")
        expected = pushed / (1 / 2000.0 + 1 / 20e3)
        assert felt[2] == pytest.approx(-expected, rel=0.08)
        assert np.abs(felt[:2]).max() < 0.1 * abs(felt[2])
        assert contact.force == pytest.approx(expected, rel=0.1)
        held = contact.end - contact.start
        assert 0.5 * expected * held < contact.impulse < 1.05 * expected * held
        drive(world, robot, -0.05, 0.6)
        back = world._pose("ball")[:3, 3]
        assert back == pytest.approx(spec.solid.T_frame_solid[:3, 3], abs=1e-3)


@pytest.mark.parametrize("depth", [0.0004, 0.010, 0.020, 0.032])
@pytest.mark.parametrize("aslant", [0.0, 50.0])
def test_a_tip_on_springs_gives_way_as_its_formula_says(robot, depth, aslant):
    """In its seat, on its spring and on its stop, pushed along the tool and from the side."""
    tip = SprungTip(300.0, 0.02, 1.0)
    floating = replace(robot, tool=replace(robot.tool, tip=tip))
    T = tcp_pose(robot, robot.home)
    way = T[:3, :3] @ from_rpy(np.deg2rad([aslant, 0, 0]), (0, 0, 0))[:3, 2]
    center = T[:3, 3] - 0.00506 * T[:3, 2] + (0.03 + 0.005) * way  # touches the ball of the tip
    ball = Solid("ball", "sphere", (0.03, 0, 0), make_pose(None, center))
    item = MovingObjectSpec(ball, hold=2000.0, surface=20e3, max_speed=10.0)
    with SimulatedWorld(cell(floating, objects=(item,))) as world:
        free = drive(world, robot, 0.0, 0.3)[-1].force
        for step in range(1, 101):  # its stand comes
            world.drag("ball", center - step / 100 * depth * way)
            world.advance(0.3 + 0.01 * step)
        felt = drive(world, robot, 0.0, 1.0)[-1].force - free
        place = world.tip.place
    expected = pressing_force(depth, 1.0 / (1.0 / 2000.0 + 1.0 / 20e3), tip)
    assert felt @ (T[:3, :3].T @ way) == pytest.approx(-expected, rel=0.1, abs=0.25)
    assert place @ (T[:3, :3].T @ way) == pytest.approx(-tip.moved(expected), rel=0.05, abs=1e-3)


def test_what_is_seen_of_a_thing_goes_back_by_its_stand_not_by_its_skin(robot):
    """A straw bends by 7 mm a newton, and that is in the skin; the face behind it hardly moves."""
    spec = ball_before(robot, 0.01, mass=4.4, surface=150.0, hold=3000.0)
    with SimulatedWorld(cell(robot, objects=(spec,))) as world:
        free = drive(world, robot, 0.0, 0.3)[-1].force
        start, ball = world.truth.tip_position(), world._pose("ball")[:3, 3]
        drive(world, robot, 0.05, 0.6)
        felt = drive(world, robot, 0.0, 0.8)[-1].force - free
        pushed = np.linalg.norm(world.truth.tip_position() - start) - 0.01
        moved = np.linalg.norm(world._pose("ball")[:3, 3] - ball)
        shown = next(m for m in world.movers() if m.name == "ball").T_world_solid[:3, 3]
        assert pushed > 0.01
        assert felt[2] == pytest.approx(-pushed / (1 / 150.0 + 1 / 3000.0), rel=0.1)
        assert moved == pytest.approx(-felt[2] / 3000.0, rel=0.15)
        assert np.linalg.norm(shown - ball) == pytest.approx(moved)


def test_who_is_somewhere_else_at_once_does_not_swing_out_beyond(robot):
    """A face on its neck that was put 1 m farther swung 0.2 m out to the other side."""
    spec = ball_before(robot, 0.5, mass=4.4, surface=20e3, hold=3000.0, max_speed=10.0)
    start, off = spec.solid.T_frame_solid[:3, 3], np.array([0.0, 1.0, 0.0])
    with SimulatedWorld(cell(robot, objects=(spec,))) as world:
        world.follow("ball", lambda time: start + (time > 0.2) * off)
        for k in range(1, 101):
            world.advance(0.008 * k)
            away = np.linalg.norm(world._pose("ball")[:3, 3] - start - (k > 26) * off)
            assert away < 1e-3 or k in (25, 26)
        assert world._pose("ball")[1, 3] == pytest.approx(start[1] + 1.0, abs=1e-4)


def test_a_straw_bends_by_some_centimetres_and_no_more(robot):
    """What is pushed on beyond that pushes the head itself: it cannot pass through the cup."""
    spec = ball_before(robot, 0.01, mass=0.6, surface=100.0, hold=400.0)
    with SimulatedWorld(cell(robot, objects=(spec,))) as world:
        drive(world, robot, 0.0, 0.1)
        start, ball = world.truth.tip_position(), world._pose("ball")[:3, 3]
        drive(world, robot, 0.1, 1.0)
        drive(world, robot, 0.0, 0.4)
        pushed = np.linalg.norm(world.truth.tip_position() - start) - 0.01
        moved = np.linalg.norm(world._pose("ball")[:3, 3] - ball)
        assert pushed > 0.08
        assert moved > 0.01
        assert DENT < pushed - moved < np.sqrt(3.0) * DENT, "along each of its axes by so much"


def test_a_blow_is_as_hard_as_two_masses_and_a_spring_make_it(robot):
    """A free hand hit by the arm: v sqrt(mu k) bounds it, and the muscles come on top."""
    speed = 0.2
    region = BODY_REGIONS["hand"]
    spec = ball_before(
        robot, 0.02, mass=region.mass, surface=region.stiffness, hold=GIVING["left_hand"].hold
    )
    with SimulatedWorld(cell(robot, objects=(spec,))) as world:
        drive(world, robot, speed, 0.35)
        blow = world.truth.contacts[0].force
        most = speed * np.sqrt(region.mass * region.stiffness)
        assert 0.3 * most < blow < most + speed * 0.35 * GIVING["left_hand"].hold


def test_a_soft_cover_strikes_no_harder_than_its_spring(robot):
    """A brush before a face: until November 2026 the mass of its skin struck thrice as hard."""
    speed, soft, region = 0.1, 300.0, BODY_REGIONS["face"]
    spec = ball_before(robot, 0.005, 0.09, mass=region.mass, surface=soft, hold=4000.0)
    with SimulatedWorld(cell(robot, objects=(spec,))) as world:
        while not world.truth.contacts:
            drive(world, robot, speed, 0.004)
        drive(world, robot, speed, 0.03)
        assert world.truth.contacts[0].force < 1.2 * soft * speed * 0.038


def test_a_persons_hand_follows_and_gives_way_and_the_truth_names_the_region(robot):
    tip = tcp_pose(robot, robot.home)[:3, 3]
    hand = PersonSpec("h", "hand", from_rpy((0, 0, np.pi), tip + np.array([0.3, 0.0, -0.05])))
    with SimulatedWorld(cell(robot, people=(hand,))) as world:
        end = tip + np.array([0.04, 0.0, 0.02])
        start = hand.T_world_person[:3, 3]
        world.follow("h", lambda t: start + (end - start) * min(t / 1.0, 1.0))
        lag = []
        for k in range(60):
            drive(world, robot, 0.0, 0.016)
            led = world._data.mocap_pos[world._cell.movers.leaders["h/right_hand"]]
            if k < 30:
                lag.append(np.linalg.norm(world._pose("h/right_hand")[:3, 3] - led))
        drive(world, robot, 0.0, 0.5)
        assert max(lag[5:]) < 0.02, "before it touches, the body is where its leader is"
        touched = [c for c in world.truth.contacts if c.kind == "person"]
        assert {c.region for c in touched} <= {"hand", "lower_arm"}
        pushed = [c for c in touched if c.part == "right_hand"]
        assert pushed
        assert all(c.force > 0.0 for c in pushed)
        gap = world._pose("h/right_hand")[:3, 3] - led
        assert np.linalg.norm(gap) * GIVING["right_hand"].hold < 60.0


def test_what_lies_on_the_table_stays_is_pushed_and_can_be_carried(robot):
    table = Solid("table", "box", (0.6, 0.6, 0.04), make_pose(None, (0.5, -0.4, 0.18)))
    box = MovingObjectSpec(
        Solid("box", "box", (0.05, 0.05, 0.06), make_pose(None, (0.45, -0.4, 0.235))),
        path="loose",
        mass=0.3,
    )
    with SimulatedWorld(cell(robot, static=(table,), objects=(box,))) as world:
        drive(world, robot, 0.0, 0.5)
        at = world._pose("box")[:3, 3]
        assert at == pytest.approx([0.45, -0.4, 0.23], abs=2e-3)
        world.drag("box", np.array([0.6, -0.3, 0.4]))
        drive(world, robot, 0.0, 1.0)
        assert world._pose("box")[:3, 3] == pytest.approx([0.6, -0.3, 0.4], abs=5e-3)
        world.drag("box", np.array([0.6, -0.3, 0.24]))
        drive(world, robot, 0.0, 0.5)
        world.drag("box", None)
        drive(world, robot, 0.0, 0.5)
        assert world._pose("box")[:3, 3] == pytest.approx([0.6, -0.3, 0.23], abs=5e-3)
        assert [m for m in world.movers() if m.name == "box"]


@pytest.mark.parametrize("grip", [True, False])
def test_fingers_hold_a_thing_by_friction(grip):
    robot = load_robot("ur5").with_tool(load_tool("gripper"))
    tip = tcp_pose(robot, robot.home)
    item = MovingObjectSpec(
        Solid("can", "box", (0.04, 0.04, 0.04), make_pose(tip[:3, :3], tip[:3, 3])),
        path="loose",
        mass=0.3,
    )
    low = tip[2, 3] - 0.03
    stand = Solid("stand", "box", (0.03, 0.03, low), make_pose(None, (*tip[:2, 3], low / 2)))
    spec = replace(cell(robot, objects=(item,), static=(stand,)), gripper=GripperSpec(force=30.0))
    with SimulatedWorld(spec) as world:
        drive(world, robot, 0.0, 0.2)
        assert world.gripper.read().width == pytest.approx(0.085, abs=1e-3)
        if grip:
            world.gripper.move(0.0)
        drive(world, robot, 0.0, 1.0)
        state = world.gripper.read()
        assert state.holding == grip
        if grip:
            assert state.width == pytest.approx(0.04, abs=3e-3)
        before = world._pose("can")[2, 3]
        drive(world, robot, -0.1, 0.6)
        lifted = world._pose("can")[2, 3] - before
        assert (lifted > 0.03) == grip
        if grip:
            world.gripper.move(0.085)
            drive(world, robot, 0.0, 1.0)
            assert world._pose("can")[2, 3] < before + 0.02
            assert not world.gripper.read().holding


def test_a_ball_in_a_hand_goes_with_it(robot):
    hand = PersonSpec("h", "hand", from_rpy((0, 0, np.pi), (1.0, 0.3, 0.5)))
    ball = MovingObjectSpec(
        Solid("ball", "sphere", (0.03, 0, 0), make_pose(None, (0.05, 0.0, 0.08))),
        held_by="h/right_hand",
    )
    for pushes in (True, False):
        spec = replace(cell(robot, people=(hand,), objects=(ball,)), pushes=pushes)
        with SimulatedWorld(spec) as world:
            world.follow("h", lambda t: np.array([1.0 - 0.1 * t, 0.3, 0.5]))
            drive(world, robot, 0.0, 1.0)
            [state] = [m for m in world.movers() if m.name == "ball"]
            wrist = world._pose("h/right_hand")
            expected = (wrist @ ball.solid.T_frame_solid)[:3, 3]
            assert state.T_world_solid[:3, 3] == pytest.approx(expected, abs=1e-9)
            led = world._data.mocap_pos[world._cell.movers.leaders["h/right_hand"]]
            assert wrist[:3, 3] == pytest.approx(led, abs=0.01)


def test_the_sensor_drifts_and_saturates(robot):
    wandering = replace(EXACT, drift=(2.0, 0.0), greatest=(3.0, 20.0))
    spec = replace(cell(robot), wrench=wandering)
    ends = []
    for seed in range(6):
        with SimulatedWorld(spec, seed) as world:
            felt = np.array([w.force for w in drive(world, robot, 0.0, 2.0)])
            assert np.abs(felt).max() <= 3.0
            ends.append(felt[-1] - felt[50])
    spread = np.std(ends)
    assert 0.15 < spread < 0.8  # 2 N a minute: 0.37 N in two seconds
    stamps = [w.stamp for w in drive(world, robot, 0.0, 0.5)]
    assert np.diff(stamps) == pytest.approx(0.002), "every reading comes, in order"


@pytest.mark.parametrize(
    ("part", "point", "region"),
    [
        ("head", (0.09, 0, 0.17), "face"),
        ("head", (-0.08, 0, 0.17), "skull"),
        ("head", (0.0, 0, 0.02), "neck"),
        ("torso", (0.1, 0, 0.4), "chest"),
        ("torso", (-0.1, 0, 0.4), "back"),
        ("torso", (0.1, 0, 0.2), "abdomen"),
        ("torso", (0.1, 0, 0.0), "pelvis"),
        ("left_hand", (0, 0, 0), "hand"),
        ("right_forearm", (0, 0, 0), "lower_arm"),
        ("right_shin", (0, 0, 0), "lower_leg"),
    ],
)
def test_regions_of_the_body(part, point, region):
    assert region_at(part, np.array(point)) == region
    assert region in BODY_REGIONS


def test_quaternions_turn_as_matrices_do():
    rng = np.random.default_rng(0)
    from scipy.spatial.transform import Rotation

    for _ in range(50):
        a, b = Rotation.random(rng=rng), Rotation.random(rng=rng)
        v = rng.normal(size=3)
        wxyz = [np.roll(r.as_quat(), 1) * rng.choice([-1, 1]) for r in (a, b)]
        assert turn(wxyz[0], v) == pytest.approx(a.apply(v), abs=1e-12)
        expected = (a * b.inv()).as_rotvec()
        assert rotation_between(wxyz[0], wxyz[1]) == pytest.approx(expected, abs=1e-9)
