"""The whole world: determinism, reset, movers, truth of contacts and distances."""

from dataclasses import replace

import numpy as np
import pytest
from simulation_cells import TABLE, camera, person

from armsight.errors import UsageError
from armsight.geometry.pose import from_rpy, make_pose
from armsight.geometry.shapes import Solid
from armsight.robots.catalogue import load_robot
from armsight.simulation import truth
from armsight.simulation.spec import ArmSpec, MovingObjectSpec, PersonSpec, WorldSpec
from armsight.simulation.world import SimulatedWorld


def full_spec(arm_spec):
    return WorldSpec(
        arm_spec,
        cameras=(
            camera(errors=True, pose_error=(0.005, 0.01), stamp_jitter=0.001),
            camera("kinect_v1", (-1.2, 1.4, 1.8), name="front", errors=True, phase=0.02),
        ),
        static=(TABLE,),
        people=(person(),),
        objects=(
            MovingObjectSpec(
                Solid("box", "box", (0.1, 0.1, 0.2), make_pose(None, (0.5, 0.4, 0.9))),
                "circle",
                (0.0, 0.0, 0.9),
                5.0,
            ),
        ),
    )


def run(world, seconds=0.7):
    """A run with changing commands; everything a consumer can see."""
    seen = []
    while world.clock.now() < seconds:
        world.arm.command_velocity(np.sin(world.clock.now() * np.arange(1, 7)))
        world.advance(world.clock.now() + 0.01)
        state = world.arm.read()
        seen += [state.position, state.velocity, state.effort, [state.stamp]]
        for cam in world.cameras:
            frame = cam.read()
            if frame is not None:
                seen += [frame.depth, [frame.stamp, frame.arrival]]
    seen += [m.T_world_solid for m in world.movers()]
    return [np.asarray(part) for part in seen]


def same(a, b):
    return len(a) == len(b) and all(np.array_equal(x, y, equal_nan=True) for x, y in zip(a, b))


def test_same_seed_same_bits_in_two_worlds_and_after_reset(gl, arm_spec):
    spec = full_spec(arm_spec)
    with SimulatedWorld(spec, seed=4) as one, SimulatedWorld(spec, seed=4) as two:
        first = run(one)
        assert any(part.ndim == 2 and part.shape[0] > 100 for part in first)
        assert same(first, run(two))
        two.drag("box", np.array([1.0, 1.0, 1.0]))
        two.cameras[0].bump(make_pose(None, (0.05, 0.0, 0.0)))
        two.advance(0.9)
        two.reset()
        assert two.clock.now() == 0.0
        assert same(first, run(two))
    with SimulatedWorld(spec, seed=5) as other:
        assert not same(first, run(other))


def test_time_may_pass_in_any_portions(arm_spec):
    """The state after a second does not depend on how the second was cut."""
    positions = []
    for step in (0.001, 0.0137, 1.0):
        with SimulatedWorld(WorldSpec(arm_spec, people=(person(),))) as world:
            world.arm.command_velocity(np.full(6, 0.2))
            while world.clock.now() < 1.0 - 1e-9:
                world.advance(min(world.clock.now() + step, 1.0))
            positions.append(world._data.qpos.copy())
            assert world.clock.now() == pytest.approx(1.0)
            world.advance(0.5)  # never runs backwards
            assert world.clock.now() == pytest.approx(1.0)
    assert np.array_equal(positions[0], positions[1])
    assert np.array_equal(positions[0], positions[2])


def test_works_without_opengl_when_nothing_is_seen(arm_spec, monkeypatch):
    from armsight.simulation import rendering

    def fail():
        raise AssertionError("no camera, so no OpenGL")

    monkeypatch.setattr(rendering, "OpenGLContext", fail)
    with SimulatedWorld(WorldSpec(arm_spec)) as world:
        world.advance(0.1)


def test_names_must_differ(arm_spec):
    with pytest.raises(UsageError, match="names of their own"):
        SimulatedWorld(WorldSpec(arm_spec, people=(person(), person())))


def test_a_fixed_camera_can_be_pushed_and_the_cell_is_not_told(gl, arm_spec):
    with SimulatedWorld(full_spec(arm_spec), seed=4) as world:
        fixed = next(c for c in world.cameras if c.info.mounted_on == "base")
        T, believed = fixed.T_mount_camera, fixed.info.T_mount_camera
        world.drag(fixed.info.name, T[:3, 3] + [0.03, 0.0, 0.04])
        assert np.array_equal(fixed.T_mount_camera[:3, :3], T[:3, :3])
        assert np.allclose(fixed.T_mount_camera[:3, 3] - T[:3, 3], [0.03, 0.0, 0.04])
        assert np.array_equal(fixed.info.T_mount_camera, believed)
        world.drag(fixed.info.name, None)
        assert np.allclose(fixed.T_mount_camera[:3, 3] - T[:3, 3], [0.03, 0.0, 0.04])
        with pytest.raises(UsageError, match=fixed.info.name):
            world.drag("nobody", np.zeros(3))
        world.reset()
        assert np.array_equal(fixed.T_mount_camera, T)


def test_unknown_things_cannot_be_dragged(arm_spec):
    with SimulatedWorld(WorldSpec(arm_spec, people=(person(),))) as world:
        with pytest.raises(UsageError, match="what moves: anna"):
            world.drag("bob", np.zeros(3))
        with pytest.raises(UsageError, match="neither a lone hand"):
            world.follow("anna", lambda t: np.zeros(3))


def thing(path="free", **changes):
    solid = Solid("thing", "sphere", (0.05, 0, 0), make_pose(None, (0.6, 0.0, 1.0)))
    return replace(MovingObjectSpec(solid, path, (0.0, 0.0, 1.0), 8.0), **changes)


def place(world, name="thing"):
    return next(m.T_world_solid[:3, 3] for m in world.movers() if m.name.startswith(name))


def test_objects_follow_their_paths(arm_spec):
    with SimulatedWorld(WorldSpec(arm_spec, objects=(thing("circle"),))) as world:
        for t in (1.0, 2.0, 5.5, 8.0):
            world.advance(t)
            turn = 2 * np.pi * t / 8.0
            expected = [0.6 * np.cos(turn), 0.6 * np.sin(turn), 1.0]
            assert np.allclose(place(world), expected, atol=2e-3)
    with SimulatedWorld(WorldSpec(arm_spec, objects=(thing("line"),))) as world:
        world.advance(4.0)
        assert np.allclose(place(world), [0, 0, 1], atol=1e-6)
        world.advance(8.0)
        assert np.allclose(place(world), [0.6, 0, 1], atol=1e-6)


def test_dragged_objects_go_at_their_speed_and_return(arm_spec):
    with SimulatedWorld(WorldSpec(arm_spec, objects=(thing("circle", max_speed=0.5),))) as world:
        goal = np.array([-1.0, 1.0, 1.5])
        world.drag("thing", goal)
        before = place(world).copy()
        world.advance(0.4)
        assert np.linalg.norm(place(world) - before) == pytest.approx(0.2, abs=0.005)
        world.advance(6.0)
        assert np.allclose(place(world), goal)
        world.drag("thing", None)
        world.advance(14.0)
        turn = 2 * np.pi * 14.0 / 8.0
        expected = [0.6 * np.cos(turn), 0.6 * np.sin(turn), 1.0]
        assert np.allclose(place(world), expected, atol=4e-3)


def hand(**changes):
    """A lone hand on the arm's front side that points at it."""
    where = from_rpy((0, 0, np.pi), (0.9, 0.0, 1.2))
    return replace(PersonSpec("hand", "hand", where), **changes)


def test_a_hand_follows_a_function_of_time(arm_spec):
    with SimulatedWorld(WorldSpec(arm_spec, people=(hand(),))) as world:
        world.follow("hand", lambda t: np.array([0.9, 0.3 * np.sin(t), 1.2]))
        world.advance(1.0)
        wrist_to_palm = world._people[0].joints
        assert np.allclose(world._people[0].position, [0.9, 0.3 * np.sin(1.0), 1.2], atol=2e-3)
        assert np.isfinite(wrist_to_palm).all()


def test_the_hand_pushes_nobody_and_a_standing_arm_is_not_to_blame(arm_spec):
    with SimulatedWorld(WorldSpec(arm_spec, people=(hand(max_hand_speed=1.0),))) as world:
        tip = world.truth.tip_position()
        world.drag("hand", tip)
        world.advance(2.0)
        assert world.truth.contacts
        assert not world.truth.moving_contacts
        assert {c.kind for c in world.truth.contacts} == {"person"}
        assert np.allclose(world._data.qpos[:6], arm_spec.home, atol=2e-3)
        assert world.truth.min_distance <= 0.0


def test_a_hand_deep_in_a_standing_arm_does_not_turn_it():
    """Fifteen contacts of next to no stiffness had turned a shoulder at 1.5 m/s in two of 500
    episodes of `approach`: the arm stood, and counted as one that moved into somebody."""
    rng, home = np.random.default_rng(2), (0.0, -1.48, 1.55, -1.64, -1.57, 0.0)
    arm = ArmSpec(load_robot("ur5"), make_pose(None, (0, 0, 0.75)), home)
    with SimulatedWorld(WorldSpec(arm, people=(hand(max_hand_speed=1.6),))) as world:
        for turn in range(1, 26):
            link = int(rng.integers(1, 4))
            world.drag("hand", world.truth.link_poses()[link, :3, 3] + rng.uniform(-0.15, 0.15, 3))
            world.advance(0.3 * turn)
            assert np.allclose(world._data.qpos[:6], home, atol=1e-4)
        assert max(contact.depth for contact in world.truth.contacts) > 0.03
        assert not world.truth.moving_contacts
        assert all(np.isnan(contact.force) for contact in world.truth.contacts)


def test_a_moving_arm_that_hits_is_to_blame(arm_spec):
    """The arm turns its base into a hand held in its way: when, where and how fast, by hand."""
    with SimulatedWorld(WorldSpec(arm_spec)) as world:
        tip = world.truth.tip_position()
    radius, angle = np.hypot(tip[0], tip[1]), np.arctan2(tip[1], tip[0]) + 0.8
    at = np.array([radius * np.cos(angle), radius * np.sin(angle), tip[2]])
    inward = from_rpy((0, 0, np.pi + angle), at)  # the forearm points to the base
    with SimulatedWorld(WorldSpec(arm_spec, people=(hand(T_world_person=inward),))) as world:
        while world.clock.now() < 3.0:
            world.arm.command_velocity(np.array([0.5, 0, 0, 0, 0, 0]))
            world.advance(world.clock.now() + 0.02)
        hits = world.truth.moving_contacts
        assert hits
        first = hits[0]
        assert first.owner == "hand"
        assert first.part == "right_hand"
        assert first.link >= 5
        assert first.arm_speed == pytest.approx(0.5 * np.hypot(*first.position[:2]), rel=0.1)
        # delay, ramp, and the way less the half widths of flange (4 cm) and hand (4-7 cm)
        centers_meet = 0.06 + 0.5 / (2 * 4.8) + 0.8 / 0.5
        half_widths = np.array([0.07, 0.13]) / radius / 0.5
        assert centers_meet - half_widths[1] < first.start < centers_meet - half_widths[0]
        assert np.linalg.norm(first.position - at) < 0.1
        assert first.end > first.start + 0.1


def test_distances_agree_with_geometry(arm_spec):
    """A hand far out on the x axis: the nearest pair is the flange's capsule and the fingers."""
    with SimulatedWorld(WorldSpec(arm_spec, people=(hand(),))) as world:
        world.advance(0.5)
        last = world.truth.separations[-1]
        assert last.owner == "hand"
        assert last.part == "right_hand"
        capsules = arm_spec.robot.capsules
        poses = world.truth.link_poses()
        t = np.linspace(0, 1, 60)[:, None]
        gaps = []
        for link, a, b, r in zip(capsules.link, capsules.start, capsules.end, capsules.radius):
            T = poses[link]
            axis = ((1 - t) * a + t * b) @ T[:3, :3].T + T[:3, 3]
            for state in world.movers():
                gaps.append(_gap(state, axis) - r)
        # movers() draws fingers as cylinders with spheres: the same surface
        assert last.distance == pytest.approx(min(gaps), abs=0.006)
        assert last.tip_speed == pytest.approx(0.0, abs=1e-3)


def _gap(state, points):
    placed = replace(state.solid, T_frame_solid=state.T_world_solid)
    return placed.distance(points).min()


def test_far_people_are_infinitely_far(arm_spec):
    away = person(T_world_person=make_pose(None, (20.0, 0, 0)))
    with SimulatedWorld(WorldSpec(arm_spec, people=(away,))) as world:
        world.advance(0.1)
        assert world.truth.min_distance == np.inf
        assert world.truth.separations
    with SimulatedWorld(WorldSpec(arm_spec)) as world:
        world.advance(0.1)
        assert not world.truth.separations


def test_only_the_newest_distances_are_kept_and_the_least_of_all(arm_spec, monkeypatch):
    monkeypatch.setattr(truth, "KEPT", 40)
    with SimulatedWorld(WorldSpec(arm_spec, people=(hand(),))) as world:
        least = np.inf
        for until in np.arange(0.1, 1.01, 0.1):
            world.advance(until)
            least = min(least, *(s.distance for s in world.truth.separations))
            assert len(world.truth.separations) <= 40
        assert world.truth.separations[0].time > 0.1  # the first ones are gone
        assert world.truth.min_distance == least
        assert world.truth.min_moving_distance == np.inf  # the arm stands
        world.reset()
        assert world.truth.min_distance == np.inf


def test_movers_show_every_part(arm_spec):
    with SimulatedWorld(WorldSpec(arm_spec, people=(person(),), objects=(thing(),))) as world:
        world.advance(0.1)
        states = world.movers()
        names = [s.name for s in states]
        assert len(set(names)) == len(names)
        for part in ("torso", "head", "left_hand", "right_shin"):
            assert any(f"anna/{part}" in name for name in names)
        heights = [s.T_world_solid[2, 3] for s in states if s.name.startswith("anna")]
        assert min(heights) >= 0.0
        assert 1.5 < max(heights) < 1.8
