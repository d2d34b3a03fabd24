"""Every row of the table of streams: there and back, in our file and in a whole cell's replay."""

from types import SimpleNamespace

import numpy as np
import pytest
from recorded_cells import FakeSession, make_cell

from armsight.devices.data import (
    ArmStatus,
    DeclaredSolids,
    EmptyCell,
    GripperState,
    JointState,
    RgbdFrame,
    StereoFrame,
    StereoInfo,
    Wrench,
)
from armsight.devices.recorded import RecordedGripper, RecordedStereo, RecordedWrench
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import make_pose
from armsight.recording import messages
from armsight.recording.codec import Decoding, Known
from armsight.recording.layout import FrameTree
from armsight.recording.mcap_file import McapReader
from armsight.recording.picture_streams import decode_pair, encode_pair
from armsight.recording.recorder import Recorder
from armsight.recording.replay import open_recording
from armsight.recording.streams import BY_READING, STREAMS

LENS = PinholeCamera(20, 10, 30.0, 31.0, 9.5, 4.5, (0.1, 0.0, 0.001, 0.0, 0.0))
PAIR = StereoInfo(
    "wrist",
    "double",
    LENS,
    LENS,
    make_pose(None, (0.06, 0.0, 0.0)),
    "flange",
    np.eye(4),
    10.0,
    0.02,
)


def readings(rng):
    """Some of every kind, by the time at which they came in."""
    picture = rng.integers(0, 256, (10, 20, 3), dtype=np.uint8)
    return {
        0.10: ArmStatus(0.09, "running", 1.0),
        0.11: Wrench(0.105, rng.normal(size=3), rng.normal(size=3)),
        0.12: GripperState(0.115, 0.0423, True, None),
        0.13: StereoFrame("wrist", 4, 0.08, 0.13, picture, picture[::-1].copy()),
        0.20: ArmStatus(0.19, "protective_stop", 0.3, 'joint 3: "hit" something'),
        0.21: Wrench(0.205, np.array([1e-300, -0.0, 123456.789]), np.zeros(3)),
        0.22: GripperState(0.215, 0.0, False, True),
        0.23: StereoFrame("wrist", 6, 0.18, 0.23, picture + 1, picture + 2),
    }


def recorded(tmp_path):
    cell = make_cell()
    cell.stereo = (RecordedStereo(PAIR),)
    cell.wrench, cell.gripper = RecordedWrench(), RecordedGripper(0.085)
    recorder = Recorder(tmp_path / "hand.mcap", cell)
    recorder.attach(FakeSession(cell))
    made = readings(np.random.default_rng(3))
    home = JointState(0.0, np.zeros(6), np.zeros(6))
    recorder.on_reading(home, 0.0)
    for at, reading in made.items():
        recorder.on_reading(reading, at)
    return recorder.close(), made


def test_what_was_recorded_is_replayed_bit_for_bit_at_its_time(tmp_path):
    path, made = recorded(tmp_path)
    with open_recording(path) as cell:
        assert cell.stereo[0].info.left == PAIR.left
        assert cell.stereo[0].info.T_left_right == pytest.approx(PAIR.T_left_right)
        assert cell.stereo[0].info.mounted_on == "flange"
        assert cell.gripper.opening == 0.085
        sources = {
            Wrench: cell.wrench.read,
            GripperState: cell.gripper.read,
            StereoFrame: cell.stereo[0].read,
            ArmStatus: lambda: cell.arm.status,
        }
        for at, reading in made.items():
            cell.world.advance(at + 1e-6)
            got = sources[type(reading)]()
            assert type(got) is type(reading)
            for name, value in vars(reading).items():
                told = getattr(got, name)
                if isinstance(value, np.ndarray):
                    assert told.tobytes() == value.tobytes(), name
                else:
                    assert (
                        told == pytest.approx(value, abs=1e-9)
                        if isinstance(value, float)
                        else told == value
                    )
            if type(reading) is not ArmStatus:
                assert sources[type(reading)]() is None  # once
        cell.world.reset()
        assert cell.arm.status is None
        assert cell.wrench.read() is None


def test_others_read_standard_types(tmp_path):
    path, made = recorded(tmp_path)
    reader = McapReader(path)
    kinds = dict(reader.topics)
    assert kinds["/wrench"] == "geometry_msgs/msg/WrenchStamped"
    assert kinds["/arm/status"] == kinds["/gripper/status"] == "diagnostic_msgs/msg/DiagnosticArray"
    assert kinds["/wrist/left/image_raw"] == kinds["/wrist/right/image_raw"] == messages.IMAGE
    assert kinds["/wrist/left/camera_info"] == messages.CAMERA_INFO
    found = [
        messages.decode(record.data, kind)
        for _, kind, record in reader.messages(["/wrench", "/arm/status"])
    ]
    first = next(m for m in found if hasattr(m, "wrench"))
    assert first.header.frame_id == "flange"
    assert first.wrench.force.x == made[0.11].force[0]
    stopped = next(m for m in found if hasattr(m, "status") and m.status[0].message)
    assert int(stopped.status[0].level) == 2
    reader.close()


def test_the_table_knows_every_reading_once():
    assert set(BY_READING) == {
        JointState,
        RgbdFrame,
        StereoFrame,
        ArmStatus,
        Wrench,
        GripperState,
        EmptyCell,
        DeclaredSolids,
    }
    assert len(STREAMS) == len(BY_READING)


def test_a_pair_of_which_one_picture_is_lost_is_no_pair():
    """The right picture of one exposure never meets the left one of another."""
    picture = np.zeros((10, 20, 3), np.uint8)
    known = Known((), {}, {"wrist": PAIR})
    topics = {f"/wrist/{side}/image_raw": ("wrist", side) for side in ("left", "right")}
    memory = Decoding(SimpleNamespace(stereo=topics), (), 0.0, FrameTree())
    got = []
    for i in (1, 2, 3):
        for part in encode_pair(StereoFrame("wrist", i, 0.1 * i, 0.1 * i, picture, picture), known):
            if part.kind != messages.IMAGE or (i == 2 and "left" in part.topic):
                continue
            record = SimpleNamespace(sequence=part.sequence, log_time=0)
            message = messages.decode(part.data, part.kind)
            got.append(decode_pair(part.topic, message, record, memory))
    assert [frame.sequence for frame in got if frame is not None] == [1, 3]
