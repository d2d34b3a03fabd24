"""When frames are exposed, what they say and when they arrive; faults; mounting errors."""

from dataclasses import replace

import numpy as np
import pytest
from simulation_cells import TABLE, camera, person

from armsight.devices.camera_models import CAMERA_MODELS, camera_info, camera_model
from armsight.devices.data import StereoFrame
from armsight.errors import DeviceError, UsageError
from armsight.geometry.pose import angle_between, inverse, look_at
from armsight.simulation.camera_faults import Fault
from armsight.simulation.spec import WorldSpec
from armsight.simulation.units import misplaced
from armsight.simulation.world import SimulatedWorld

pytestmark = pytest.mark.usefixtures("gl")


def small(**changes):
    """A fast camera of few pixels."""
    spec = camera(**changes)
    return replace(spec, info=replace(spec.info, depth=spec.info.depth.scaled(0.125)))


def collect(world, until, step=0.005):
    frames = []
    while world.clock.now() < until:
        world.advance(world.clock.now() + step)
        frame = world.cameras[0].read()
        if frame is not None:
            assert frame.arrival <= world.clock.now() + 1e-9
            frames.append((world.clock.now(), frame))
    return frames


def test_rate_phase_and_latency(arm_spec):
    spec = small(phase=0.013)
    with SimulatedWorld(WorldSpec(arm_spec, cameras=(spec,))) as world:
        frames = collect(world, 1.0)
        assert [f.sequence for _, f in frames] == list(range(len(frames)))
        assert len(frames) in (14, 15)
        for now, frame in frames:
            due = 0.013 + frame.sequence / 15.0
            assert due - 1e-9 <= frame.stamp < due + 0.002 + 1e-9
            assert frame.arrival == pytest.approx(frame.stamp + 0.04)
            assert now - frame.arrival < 0.005 + 1e-9
            assert frame.depth.shape == (53, 64)
            assert frame.depth.dtype == np.float32
            assert frame.color is None
        assert not frames[0][1].depth.flags.writeable


def test_read_gives_the_newest_only(arm_spec):
    with SimulatedWorld(WorldSpec(arm_spec, cameras=(small(),))) as world:
        assert world.cameras[0].read() is None
        world.advance(1.0)
        assert world.cameras[0].read().sequence == 14
        assert world.cameras[0].read() is None


def test_stamp_jitter(arm_spec):
    spec = small(stamp_jitter=0.02)
    with SimulatedWorld(WorldSpec(arm_spec, cameras=(spec,))) as world:
        off = [f.stamp - f.sequence / 15.0 for _, f in collect(world, 3.0)]
        assert np.abs(off).max() <= 0.02 + 0.002
        assert np.std(off) == pytest.approx(0.02 / np.sqrt(3), rel=0.35)


def test_color_on_demand(arm_spec):
    spec = small()
    info = replace(spec.info, color=spec.info.color.scaled(0.1))
    spec = replace(spec, info=info)
    with SimulatedWorld(WorldSpec(arm_spec, cameras=(spec,))) as world:
        world.advance(0.2)
        assert world.cameras[0].read().color is None
        world.cameras[0].want_color(30.0)
        world.advance(0.5)
        color = world.cameras[0].read().color
        assert color.shape == (108, 192, 3)
        assert color.std() > 5
        world.cameras[0].want_color(0.0)
        world.advance(0.8)
        assert world.cameras[0].read().color is None


FAULTY = 0.4, 0.8


@pytest.mark.parametrize("kind", ["fail", "lost", "drop"])
def test_missing_frames(arm_spec, kind):
    with SimulatedWorld(WorldSpec(arm_spec, cameras=(small(),))) as world:
        cam = world.cameras[0]
        cam.faults.add(Fault(kind, *FAULTY, amount=1.0))
        seen = []
        while world.clock.now() < 1.2:
            world.advance(world.clock.now() + 0.005)
            now = world.clock.now()
            if kind == "lost" and 0.4 <= now < 0.8:
                with pytest.raises(DeviceError, match="'cam' is lost"):
                    cam.read()
                continue
            frame = cam.read()
            if frame is not None:
                seen.append(frame)
        stamps = np.array([f.stamp for f in seen])
        assert not np.any((stamps >= 0.4) & (stamps < 0.8))
        assert np.any(stamps > 0.8)
        gaps = np.diff([f.sequence for f in seen])
        assert gaps.max() >= 6  # a lost frame is a gap in the numbers
        cam.faults.clear()
        assert cam.faults.find("fail", 0.5) is None


def test_frozen_late_and_empty_frames(arm_spec):
    spec = WorldSpec(arm_spec, cameras=(small(errors=True),), people=(person(script="work"),))
    with SimulatedWorld(spec) as world:
        cam = world.cameras[0]
        cam.faults.add(Fault("freeze", 0.3, 0.6))
        cam.faults.add(Fault("delay", 0.7, 1.0, amount=0.1))
        cam.faults.add(Fault("empty", 1.1, 1.3))
        frames = [f for _, f in collect(world, 1.6)]
        frozen = [f for f in frames if 0.3 <= f.stamp < 0.6]
        assert len(frozen) >= 4
        assert all(np.array_equal(f.depth, frozen[0].depth, equal_nan=True) for f in frozen)
        assert len({f.stamp for f in frozen}) == len(frozen)
        late = [f for f in frames if 0.7 <= f.stamp < 0.9]
        assert late
        assert all(f.arrival - f.stamp == pytest.approx(0.14) for f in late)
        empty = [f for f in frames if 1.1 <= f.stamp < 1.3]
        assert empty
        assert all(np.isnan(f.depth).all() for f in empty)
        numbers = [f.sequence for f in frames]
        assert numbers == sorted(set(numbers))


def test_half_the_frames_drop(arm_spec):
    with SimulatedWorld(WorldSpec(arm_spec, cameras=(small(),))) as world:
        world.cameras[0].faults.add(Fault("drop", amount=0.5))
        assert 30 < len(collect(world, 6.0)) < 60


def test_pose_error_has_its_size_and_only_the_simulator_knows():
    spec = camera(pose_error=(0.005, np.deg2rad(0.5)))
    meters, radians = [], []
    for seed in range(300):
        T = misplaced(spec, np.random.default_rng(seed))
        off = inverse(spec.T_mount_camera_declared) @ T
        meters.append(np.linalg.norm(off[:3, 3]) / np.sqrt(3))
        radians.append(angle_between(T, spec.T_mount_camera_declared) / np.sqrt(3))
    assert np.sqrt(np.mean(np.square(meters))) == pytest.approx(0.005, rel=0.1)
    assert np.sqrt(np.mean(np.square(radians))) == pytest.approx(np.deg2rad(0.5), rel=0.1)
    exact = misplaced(camera(), np.random.default_rng(0))
    assert np.allclose(exact, camera().T_mount_camera_declared)


def test_the_wrist_pair_takes_pictures_once_asked(arm_spec):
    T = look_at((0.9, 0.0, 1.1), (0.5, 0.0, 0.8))
    info = camera_info("pair", "wrist_stereo", T_mount_camera=T)
    info = replace(info, depth=info.depth.scaled(0.25), color=info.color.scaled(0.25))
    spec = replace(camera(), info=info, T_mount_camera_declared=T)
    with SimulatedWorld(WorldSpec(arm_spec, stereo=(spec,), static=(TABLE,))) as world:
        pair = world.stereo_cameras[0]
        world.advance(0.15)
        assert pair.read() is None
        pair.want_pictures(True)
        world.advance(0.35)
        frame = pair.read()
        assert isinstance(frame, StereoFrame)
        assert frame.sequence == 3  # exposed at 0.3 s, arrives at 0.35 s
        assert frame.left.shape == frame.right.shape == (120, 180, 3)
        assert not np.array_equal(frame.left, frame.right)
        assert pair.info.left == info.depth
        assert pair.info.T_left_right[0, 3] == pytest.approx(0.06)
        pair.want_pictures(False)
        world.advance(0.6)
        pair.read()
        world.advance(1.0)
        assert pair.read() is None


def test_two_structured_light_cameras_disturb_each_other(arm_spec):
    eyes = ((1.5, -0.8, 1.9), (1.5, 0.8, 1.9))

    def lost(models):
        specs = tuple(
            camera(m, eye, name=f"c{i}", errors=True)
            for i, (m, eye) in enumerate(zip(models, eyes))
        )
        with SimulatedWorld(WorldSpec(arm_spec, cameras=specs, static=(TABLE,))) as world:
            world.advance(0.5)
            depth = world.cameras[0].read().depth
            ideal = camera("kinect_v1", eyes[0]).info
            assert depth.shape == (ideal.depth.height, ideal.depth.width)
            return np.isnan(depth).mean()

    alone = lost(("kinect_v1",))
    together = lost(("kinect_v1", "kinect_v1"))
    mixed = lost(("kinect_v1", "kinect_v2"))
    assert together > alone + 0.05
    assert mixed == pytest.approx(alone, abs=0.01)


def test_catalogue_is_the_table():
    rows = {
        "kinect_v1": ((320, 240), (640, 480), (57, 43), (0.4, 4.5), 30),
        "kinect_v2": ((512, 424), (1920, 1080), (70, 60), (0.5, 4.5), 30),
        "r200": ((480, 360), (1920, 1080), (59, 46), (0.5, 3.5), 60),
        "f200": ((640, 480), (1920, 1080), (73, 59), (0.2, 1.2), 30),
        "d435": ((848, 480), (1920, 1080), (87, 58), (0.3, 3.0), 90),
        "d455": ((848, 480), (1280, 800), (87, 58), (0.6, 6.0), 90),
        "azure_kinect": ((640, 576), (1920, 1080), (75, 65), (0.5, 3.86), 30),
        "femto_bolt": ((640, 576), (1920, 1080), (75, 65), (0.5, 3.86), 30),
        "femto_mega": ((640, 576), (1920, 1080), (75, 65), (0.5, 3.86), 30),
        "wrist_stereo": ((720, 480), (720, 480), (45, None), (0.2, 0.4), 10),
        "converging_pair": ((1280, 960), (1280, 960), (56.144974, None), (0.25, 3.0), 15),
        "flange_pair": ((800, 600), (800, 600), (55.517081, None), (0.15, 0.8), 15),
    }
    assert set(rows) == set(CAMERA_MODELS)
    for name, (depth, color, fov, reach, rate) in rows.items():
        model = CAMERA_MODELS[name]
        assert (model.depth.width, model.depth.height) == depth
        assert (model.color.width, model.color.height) == color
        assert model.range == reach
        assert model.max_rate == rate
        wide = 2 * np.rad2deg(np.arctan(0.5 * model.depth.width / model.depth.fx))
        assert wide == pytest.approx(fov[0])
        if fov[1] is not None:
            high = 2 * np.rad2deg(np.arctan(0.5 * model.depth.height / model.depth.fy))
            assert high == pytest.approx(fov[1])
        assert 0.02 <= model.latency <= 0.06


def test_bad_cameras_are_refused_with_what_to_do():
    with pytest.raises(UsageError, match="choose one of azure_kinect, converging_pair"):
        camera_model("kinect_v3")
    with pytest.raises(UsageError, match="up to 30 Hz, not at 60 Hz"):
        camera_info("c", "kinect_v2", rate=60.0)
    with pytest.raises(UsageError, match="'base' or 'flange'"):
        camera_info("c", "kinect_v2", "ceiling")
    ideal = camera_info("c", "kinect_v2", ideal_lens=True, color_scale=0.5)
    assert ideal.depth.is_ideal
    assert ideal.color.width == 960
