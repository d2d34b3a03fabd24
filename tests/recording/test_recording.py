"""Recording a session: everything once, nothing lost, and a full disk ends only the recording."""

from __future__ import annotations

import errno
import re
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_cells import (
    FakeSession,
    camera_info,
    empty_view,
    make_cell,
    make_frame,
    make_joints,
    make_movers,
    make_status,
)
from rosbags.highlevel import AnyReader

from armsight.devices.data import JointState, RgbdFrame
from armsight.devices.depth_model import DepthModel
from armsight.devices.world import MovingSolid, MovingSurfaces
from armsight.errors import RecordingError
from armsight.geometry.pose import exp
from armsight.geometry.shapes import Surface
from armsight.recording.mcap_file import McapWriter
from armsight.recording.messages import TRANSFORMS
from armsight.recording.recorder import Recorder
from armsight.recording.replay import open_recording
from armsight.workcell import parse_workcell, robot_in
from armsight.workcell.calibration_file.reading import calibrated_robot
from armsight.workcell.calibration_file.schema import CalibratedCell, CellCalibration
from armsight.workcell.calibration_file.writing import arm_entry, board_entry

SEED = 3


def record(
    path: Path, rounds: int = 20
) -> tuple[list[RgbdFrame], list[JointState], list[MovingSolid]]:
    """A made-up session of 20 rounds at 20 Hz."""
    rng = np.random.default_rng(SEED)
    cell = make_cell()
    recorder = Recorder(path, cell)
    session = FakeSession(cell)
    recorder.attach(session)
    frames, states, movers = [], [], []
    for i in range(rounds):
        now = i * 0.05
        state = make_joints(now - 0.002, 6, rng)
        states.append(state)
        for _ in range(3):
            recorder.on_reading(state, now)  # sensing looks more often than the arm speaks
        for camera in cell.cameras:
            frames.append(make_frame(camera.info, i, now - 0.03, rng))
            recorder.on_reading(frames[-1], now)
        movers.append(make_movers(rng))
        session.shown = empty_view(
            now, joints=state, guard=make_status(now, 6, rng), movers=movers[-1]
        )
        recorder.update(now)
    assert recorder.close() == path
    assert recorder.problem == ""
    assert recorder.close() == path  # again
    return frames, states, movers


def play(
    path: Path, rounds: int = 20
) -> tuple[list[RgbdFrame], list[JointState], list[MovingSolid]]:
    frames, states, movers = [], [], []
    with open_recording(path) as cell:
        assert cell.world is not None
        for i in range(rounds):
            cell.world.advance(i * 0.05)
            states.append(cell.arm.read())
            movers.append(cell.world.movers())
            frames += [f for camera in cell.cameras if (f := camera.read()) is not None]
            assert all(camera.read() is None for camera in cell.cameras)
        assert cell.world.finished
    return frames, states, movers


def test_what_is_recorded_is_replayed_bit_for_bit(tmp_path: Path) -> None:
    frames, states, movers = record(tmp_path / "a.mcap")
    again_frames, again_states, again_movers = play(tmp_path / "a.mcap")
    assert len(again_frames) == len(frames)
    for a, b in zip(frames, again_frames):
        assert (a.camera, a.sequence) == (b.camera, b.sequence)
        assert a.depth.tobytes() == b.depth.tobytes()
        assert (a.color is None) == (b.color is None)
        if a.color is not None:
            assert a.color.tobytes() == b.color.tobytes()
        assert abs(a.stamp - b.stamp) <= 0.5e-9
        assert b.T_base_camera is None
    for a, b in zip(states, again_states):
        assert a.position.tobytes() == b.position.tobytes()
        assert a.velocity.tobytes() == b.velocity.tobytes()
        assert a.effort is not None
        assert b.effort is not None
        assert a.effort.tobytes() == b.effort.tobytes()
    assert [[m.name for m in now] for now in again_movers] == [
        [m.name for m in now] for now in movers
    ]


def test_the_cell_comes_back(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap", 2)
    cell = make_cell()
    with open_recording(tmp_path / "a.mcap") as again:
        assert again.robot.name == cell.robot.name
        assert again.T_world_base.tobytes() == cell.T_world_base.tobytes()
        assert again.arm.joint_names == cell.robot.joint_names
        for a, b in zip(cell.cameras, again.cameras, strict=True):
            assert a.info.depth == b.info.depth
            assert a.info.color == b.info.color
            assert a.info.T_mount_camera.tobytes() == b.info.T_mount_camera.tobytes()
            assert (a.info.noise, a.info.range, a.info.rate) == (
                b.info.noise,
                b.info.range,
                b.info.rate,
            )
        [solid] = again.static
        assert solid.T_frame_solid.tobytes() == cell.static[0].T_frame_solid.tobytes()
        assert solid.coarse == cell.static[0].coarse == 0.03


def test_what_was_believed_comes_back(tmp_path: Path) -> None:
    """Of the cameras exactly; of the arm and its board as the calibration file keeps it."""
    rng = np.random.default_rng(2)
    A = rng.normal(size=(6, 6))
    model = DepthModel(
        0.016, -0.003, np.array([0.8, 0.95]), np.array([1e-3, -1e-3]), rng.normal(size=3),
        1.1, (0.7, 1.5), 5e-4, True,
    )  # fmt: skip
    infos = (
        replace(camera_info("left"), covariance=A @ A.T, depth_model=model, infrared_scale=2),
        camera_info("right"),
    )
    cell = make_cell(infos)
    cell.workcell = parse_workcell(
        '[cell]\nname = "tiny"\n[robot]\nmodel = "ur5"\ntool = "calibration_board"\n[board]\n'
    )
    off = exp(np.array([0.01, -0.005, 0.004, 0.02, 0.01, -0.03]))
    cell.calibration = CellCalibration(
        cell=CalibratedCell(name="tiny", robot="ur5"),
        arm=arm_entry(np.full(6, 2e-3), rng.normal(0, 1e-3, (6, 3)), source="a test"),
        board=board_entry(cell.workcell.board, off @ cell.workcell.board.pose, source="a test"),
    )
    cell.robot = calibrated_robot(robot_in(cell.workcell), cell.calibration)
    Recorder(tmp_path / "a.mcap", cell).close()
    with open_recording(tmp_path / "a.mcap") as again:
        left, right = (camera.info for camera in again.cameras)
        np.testing.assert_array_equal(left.covariance, A @ A.T)
        assert left.infrared_scale == 2
        assert left.depth_model is not None
        for name, value in vars(model).items():
            np.testing.assert_array_equal(getattr(left.depth_model, name), value, err_msg=name)
        assert (right.covariance, right.depth_model, right.infrared_scale) == (None, None, 0)
        for a, b in (
            (again.robot.T_link_joint, cell.robot.T_link_joint),
            (again.robot.spheres.center, cell.robot.spheres.center),
        ):
            np.testing.assert_allclose(a, b, atol=1e-9)
        assert (
            np.abs(again.robot.spheres.center - robot_in(cell.workcell).spheres.center).max() > 0.01
        )


def test_a_recorded_arm_takes_commands_and_sends_none(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap", 2)
    with open_recording(tmp_path / "a.mcap") as cell:
        np.testing.assert_array_equal(cell.arm.command_velocity(np.ones(6)), np.zeros(6))
        cell.arm.stop()


def test_a_reset_replays_the_same(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap", 5)
    with open_recording(tmp_path / "a.mcap") as cell:
        assert cell.world is not None
        runs = []
        for _ in range(2):
            cell.world.advance(0.12)
            runs.append((cell.cameras[0].read().depth.tobytes(), cell.arm.read().stamp))
            cell.world.reset()
            assert cell.clock.now() == 0.0
            assert cell.arm.read() is None
            assert cell.cameras[0].read() is None
        assert runs[0] == runs[1]


def test_another_reader_finds_standard_types(tmp_path: Path) -> None:
    frames, _, _ = record(tmp_path / "a.mcap")
    kinds = {
        "/left/depth/image_raw": ("sensor_msgs/msg/Image", 20),  # it has distortion
        "/right/depth/image_rect_raw": ("sensor_msgs/msg/Image", 20),
        "/left/depth/camera_info": ("sensor_msgs/msg/CameraInfo", 20),
        "/left/color/image_raw": ("sensor_msgs/msg/Image", 20),
        "/joint_states": ("sensor_msgs/msg/JointState", 20),
        "/tf": ("tf2_msgs/msg/TFMessage", 20),
        "/tf_static": ("tf2_msgs/msg/TFMessage", 1),
        "/robot_description": ("std_msgs/msg/String", 1),
        "/guard/status": ("diagnostic_msgs/msg/DiagnosticArray", 20),
        "/guard/distance": ("std_msgs/msg/Float64", 20),
        "/guard/path": ("trajectory_msgs/msg/JointTrajectory", 5),  # every fifth of a second
        "/movers": ("visualization_msgs/msg/MarkerArray", 10),  # every tenth of a second
        "/workcell/solids": ("visualization_msgs/msg/MarkerArray", 1),
    }
    with AnyReader([tmp_path / "a.mcap"]) as bag:
        for topic, (kind, count) in kinds.items():
            assert (bag.topics[topic].msgtype, bag.topics[topic].msgcount) == (kind, count), topic
        images = [
            (at, bag.deserialize(raw, connection.msgtype))
            for connection, at, raw in bag.messages()
            if connection.topic == "/right/depth/image_rect_raw"
        ]
        latched = next(c for c in bag.connections if c.topic == "/tf_static")
    mine = [frame for frame in frames if frame.camera == "right"]
    for frame, (at, image) in zip(mine, images, strict=True):
        assert image.encoding == "32FC1"
        assert bytes(image.data) == frame.depth.tobytes()
        assert at == round((frame.stamp + 0.03) * 1e9)
        assert image.header.frame_id == "right_depth_optical_frame"
    assert "transient_local" in str(latched.ext.offered_qos_profiles[0].durability).lower()


def test_frames_connect_from_world_to_every_lens(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap", 2)
    parents: dict[str, str] = {}
    with AnyReader([tmp_path / "a.mcap"]) as bag:
        for connection, _, raw in bag.messages():
            if connection.msgtype == TRANSFORMS:
                for t in bag.deserialize(raw, connection.msgtype).transforms:
                    parents[t.child_frame_id] = t.header.frame_id
    for leaf in ("left_color_optical_frame", "right_depth_optical_frame", "flange"):
        while leaf in parents:
            leaf = parents[leaf]
        assert leaf == "world"


def test_a_posed_frame_keeps_its_pose(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cell = make_cell((camera_info("hand"),))
    recorder = Recorder(tmp_path / "a.mcap", cell)
    pose = cell.cameras[0].info.T_mount_camera @ make_movers(rng)[0].T_world_solid
    frame = make_frame(cell.cameras[0].info, 0, 0.0, rng)
    recorder.on_reading(RgbdFrame(**(vars(frame) | {"T_base_camera": pose})), 0.0)
    recorder.close()
    with open_recording(tmp_path / "a.mcap") as again:
        assert again.world is not None
        again.world.advance(0.0)
        back = again.cameras[0].read()
    assert back is not None
    np.testing.assert_allclose(back.T_base_camera, pose, atol=1e-12)


def test_a_late_clock_is_moved_to_zero(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cell = make_cell((camera_info("c"),))
    epoch = 1_790_000_000.0
    cell.clock.set(epoch)  # type: ignore[attr-defined]
    recorder = Recorder(tmp_path / "a.mcap", cell)
    recorder.on_reading(make_joints(epoch + 1.0, 6, rng), epoch + 1.0)
    recorder.on_reading(make_frame(cell.cameras[0].info, 0, epoch + 1.0, rng), epoch + 1.05)
    recorder.close()
    with open_recording(tmp_path / "a.mcap") as again:
        assert again.world is not None
        assert again.clock.now() == 0.0
        again.world.advance(2.0)
        frame, state = again.cameras[0].read(), again.arm.read()
    assert frame is not None
    assert state is not None
    assert abs(frame.stamp - 1.0) < 1e-6
    assert abs(state.stamp - 1.0) < 1e-6


def test_a_full_disk_ends_the_recording_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(0)
    cell = make_cell()
    recorder = Recorder(tmp_path / "a.mcap", cell)
    session = FakeSession(cell)
    recorder.attach(session)
    raw = recorder._writer._file
    room = 300_000

    class Disk:
        """Takes ``room`` bytes in all."""

        def write(self, data: memoryview) -> int:
            if raw.tell() >= room:
                raise OSError(errno.ENOSPC, "No space left on device")
            return raw.write(data[: room - raw.tell()])

        def __getattr__(self, name: str) -> object:
            return getattr(raw, name)

    recorder._writer._stream._file = Disk()
    monkeypatch.setattr(McapWriter, "flush", lambda self: self._writer.flush())
    for i in range(200):
        now = 0.05 * i
        recorder.on_reading(make_frame(cell.cameras[0].info, i, now, rng), now)
        session.shown = empty_view(now)
        recorder.update(now)
        if i % 10 == 9:
            recorder._put(0, recorder._writer.flush, now)
    with pytest.raises(RecordingError, match=r"the disk is full; .*a\.mcap is complete up to") as e:
        recorder.close()
    assert "Free some space" in str(e.value)
    assert recorder.problem == str(e.value)
    assert not list(tmp_path.glob("*.partial"))
    with open_recording(tmp_path / "a.mcap") as again:
        assert again.world is not None
        assert again.world.note == ""
        assert 0.0 < again.world.duration < 9.0
        told = float(re.search(r"complete up to ([0-9.]+) s", str(e.value))[1])
        assert told == pytest.approx(again.world.source.span[1], abs=0.051)
        again.world.advance(10.0)
        assert again.cameras[0].read() is not None


def test_what_a_failed_recording_is_said_to_hold_is_in_it(tmp_path: Path) -> None:
    """It told of all that had been handed to the writer; half of that never reached the disk."""
    cell, rng = make_cell(), np.random.default_rng(0)
    recorder = Recorder(tmp_path / "a.mcap", cell)
    raw = recorder._writer._file
    failing = threading.Event()

    class Disk:
        def write(self, data: memoryview) -> int:
            if failing.is_set():
                raise OSError(errno.ENOSPC, "No space left on device")
            return raw.write(data)

        def __getattr__(self, name: str) -> object:
            return getattr(raw, name)

    recorder._writer._stream._file = Disk()
    for i in range(40):
        now = 0.05 * i
        recorder.on_reading(make_frame(cell.cameras[0].info, i, now, rng), now)
        if i == 19:
            recorder._put(0, recorder._writer.flush, now)
            recorder._put(0, failing.set, now)
    with pytest.raises(RecordingError, match=r"complete up to (0\.9|1\.0) s"):
        recorder.close()


def test_a_slow_disk_drops_and_counts_in_real_time(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cell = make_cell()
    recorder = Recorder(tmp_path / "a.mcap", cell, waiting_bytes=200_000, wait=False)
    gate = threading.Event()
    recorder._put(0, lambda: bool(gate.wait(10.0)), 0.0)
    frames = [make_frame(cell.cameras[1].info, i, 0.1 * i, rng) for i in range(40)]
    for frame in frames:
        recorder.on_reading(frame, frame.stamp)
    dropped = recorder.dropped
    assert 0 < dropped < 40
    assert f"{dropped} readings not recorded" in recorder.problem
    gate.set()
    recorder.close()
    with open_recording(tmp_path / "a.mcap") as again:
        kept = sum(isinstance(d.item, RgbdFrame) for d in again.world.source.deliveries())
    assert kept == 40 - dropped


def test_a_slow_disk_is_waited_for_under_the_simulated_clock(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cell = make_cell()
    recorder = Recorder(tmp_path / "a.mcap", cell, waiting_bytes=50_000, wait=True)
    for i in range(100):
        recorder.on_reading(make_frame(cell.cameras[1].info, i, 0.1 * i, rng), 0.1 * i)
    recorder.close()
    assert recorder.dropped == 0
    with open_recording(tmp_path / "a.mcap") as again:
        frames = [d.item for d in again.world.source.deliveries() if isinstance(d.item, RgbdFrame)]
    assert [f.sequence for f in frames] == list(range(100))


def test_a_bug_in_recording_closes_the_file(tmp_path: Path) -> None:
    cell = make_cell()
    recorder = Recorder(tmp_path / "a.mcap", cell)
    rng = np.random.default_rng(0)
    recorder.on_reading(make_frame(cell.cameras[0].info, 0, 0.0, rng), 0.0)
    recorder._put(0, lambda: 1 // 0, 0.0)
    with pytest.raises(RecordingError, match="recording stopped"):
        recorder.close()
    with open_recording(tmp_path / "a.mcap") as again:
        assert not again.world.note


def test_two_recorders_do_not_share_a_file(tmp_path: Path) -> None:
    cell = make_cell()
    first = Recorder(tmp_path / "a.mcap", cell)
    with pytest.raises(RecordingError, match="exists already"):
        Recorder(tmp_path / "a.mcap", cell)
    first.close()


def test_people_come_back_as_they_looked(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cell = make_cell()
    looks = (
        Surface("palm", *_tetrahedron(rng), (0.9, 0.7, 0.6)),
        Surface("sleeve", *_tetrahedron(rng), (0.2, 0.3, 0.8)),
    )
    recorder = Recorder(tmp_path / "a.mcap", cell)
    session = FakeSession(cell)
    recorder.attach(session)
    poses = [m.T_world_solid for m in make_movers(rng)]
    rough = tuple(
        MovingSolid(name, m.solid, m.T_world_solid)
        for name, m in zip(("helper/hand/0", "helper/hand/1", "ball"), make_movers(rng))
    )
    for i, pose in enumerate(poses):
        session.shown = empty_view(
            0.2 * i, movers=rough, bodies=(MovingSurfaces("helper/hand", looks, pose),)
        )
        recorder.update(0.2 * i)
    recorder.close()
    with open_recording(tmp_path / "a.mcap") as again:
        surfaces = []
        for i, pose in enumerate(poses):
            again.world.advance(0.2 * i)
            [body] = again.world.bodies()
            np.testing.assert_allclose(body.T_world_body, pose, atol=1e-12)
            surfaces.append(body.surfaces)
        assert surfaces[0] is surfaces[-1]  # so the page draws them once
        assert [m.name for m in again.world.movers()] == ["ball"]
    for a, b in zip(looks, surfaces[0], strict=True):
        assert a.name == b.name
        np.testing.assert_allclose(a.color, b.color, atol=1e-6)
        assert a.vertices[a.faces].tobytes() == b.vertices[b.faces].tobytes()


def _tetrahedron(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    return rng.normal(size=(4, 3)).astype(np.float32), faces


def test_a_reset_in_the_first_second_ends_it_as_well(tmp_path: Path) -> None:
    """It went on, with two pasts on top of each other."""
    cell, rng = make_cell(), np.random.default_rng(0)
    recorder = Recorder(tmp_path / "a.mcap", cell)
    recorder.attach(FakeSession(cell))
    recorder.attach(FakeSession(cell))  # the session is built anew with every observer
    for now in (0.0, 0.5):
        recorder.on_reading(make_frame(cell.cameras[0].info, 1, now, rng), now)
    recorder.attach(FakeSession(cell))
    assert "the session was reset" in recorder.problem
    recorder.on_reading(make_frame(cell.cameras[0].info, 9, 0.1, rng), 0.1)
    with open_recording(recorder.close()) as again:
        again.world.advance(2.0)
        assert again.cameras[0].read().sequence == 1


def test_a_reset_ends_the_recording_in_order(tmp_path: Path) -> None:
    """Time never runs backwards in a file; what was before the reset is whole."""
    rng = np.random.default_rng(0)
    cell = make_cell()
    recorder = Recorder(tmp_path / "a.mcap", cell)
    for i in range(30):
        recorder.on_reading(make_joints(0.1 * i, 6, rng), 0.1 * i)
    recorder.on_reading(make_joints(0.0, 6, rng), 0.0)
    recorder.on_reading(make_frame(cell.cameras[0].info, 0, 0.05, rng), 0.05)
    assert recorder.problem == "recording ended at 2.9 s: the session was reset"
    assert recorder.close() == tmp_path / "a.mcap"
    with open_recording(tmp_path / "a.mcap") as again:
        assert again.world.note == ""
        assert again.world.duration == pytest.approx(2.9)
