"""A task's face in a recording: standard messages, and the same face again in the replay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from recorded_cells import FakeSession, empty_view, make_cell, make_frame, make_joints
from rosbags.highlevel import AnyReader

from armsight.geometry.pose import from_rpy
from armsight.motion.face import (
    ArrowMark,
    Button,
    Curve,
    EllipsoidMark,
    Face,
    Figure,
    FrameMark,
    Picture,
    PointsMark,
    RegionMark,
    ShownFace,
    face_fault,
)
from armsight.recording import messages
from armsight.recording.face_messages import (
    decode_marks,
    decode_picture,
    encode_marks,
    encode_picture,
    topic_of,
)
from armsight.recording.recorder import Recorder
from armsight.recording.replay import open_recording
from armsight.recording.replay_parts import RecordedTask, recorded_task, replay_parts
from armsight.runtime.session import Session

MARKS = (
    PointsMark("corners of it", np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]), 0.02, (10, 20, 30)),
    ArrowMark("motion", np.array([0.1, 0.2, 0.3]), np.array([0.5, 0.2, 0.3])),
    FrameMark("target", from_rpy([0.1, 0.2, 0.3], [0.4, 0.5, 0.6]), 0.15),
    EllipsoidMark("doubt", from_rpy([0.3, 0.2, 0.1], [0.4, 0.5, 0.6]), np.array([0.1, 0.02, 0.3])),
    RegionMark("keep out", from_rpy([0, 0, 1], [0.1, 0.1, 0.1]), np.array([0.2, 0.3, 0.4])),
)


def face(i: int) -> Face:
    image = np.zeros((40, 60, 3), np.uint8)
    image[:, : 3 * i] = (200, 60, 20)
    return Face(
        "approach",
        'a reason with "quotes" & ümlauts',
        (Figure("distance", 1.5 + i, "mm"), Figure("unknown", np.nan)),
        (Curve("tilt", 0.1 * i, "deg"),),
        (Picture("what it sees", image),),
        MARKS if i % 2 else (),
        (Button("go", "Go on"), Button("skip", "Skip", enabled=False)),
    )


def record(path: Path, rounds: int = 20) -> list[ShownFace]:
    rng = np.random.default_rng(1)
    cell = make_cell()
    recorder = Recorder(path, cell)
    session = FakeSession(cell)
    recorder.attach(session)
    shown = []
    for i in range(rounds):
        now = i * 0.05
        state = make_joints(now, 6, rng)
        recorder.on_reading(state, now)
        for camera in cell.cameras:
            recorder.on_reading(make_frame(camera.info, i, now, rng), now)
        shown.append(ShownFace("keep_above", now, face(i)))
        session.shown = replace(empty_view(now, joints=state), face=shown[-1])
        recorder.update(now)
    recorder.close()
    return shown


def test_marks_come_back_as_they_were():
    message = messages.decode(encode_marks(MARKS, 1.0), messages.MARKERS)
    found = decode_marks(message)
    assert [type(mark) for mark in found] == [type(mark) for mark in MARKS]
    for mark, wanted in zip(found, MARKS, strict=True):
        assert mark.name == wanted.name
        for key, value in vars(wanted).items():
            if not isinstance(value, str):
                np.testing.assert_allclose(getattr(mark, key), value, atol=1e-6)


def test_a_picture_is_nearly_what_it_was():
    rng = np.random.default_rng(2)
    smooth = np.repeat(np.repeat(rng.integers(0, 255, (4, 5, 3)), 16, 0), 16, 1).astype(np.uint8)
    picture = Picture("view", smooth)
    message = messages.decode(encode_picture(picture, 1.0), messages.COMPRESSED)
    assert message.format == "jpeg"
    image = decode_picture(message)
    assert image.shape == smooth.shape
    assert np.abs(image.astype(int) - smooth).mean() < 6.0


def test_topics_have_only_what_ros_allows():
    assert topic_of("/task/curve/", "tilt [°] a/b") == "/task/curve/tilt_____a_b"


def test_others_read_what_was_shown(tmp_path: Path):
    """rosbags, which knows nothing of us."""
    path = tmp_path / "face.mcap"
    record(path)
    with AnyReader([path]) as reader:
        kinds = {c.topic: (c.msgtype, c.msgcount) for c in reader.connections}
        assert kinds["/task/face"] == ("diagnostic_msgs/msg/DiagnosticArray", 20)
        assert kinds["/task/curve/tilt"] == ("std_msgs/msg/Float64", 20)
        # Marks of every second face; in between the message that clears them.
        assert kinds["/task/marks"] == ("visualization_msgs/msg/MarkerArray", 19)
        assert kinds["/task/picture/what_it_sees"][0] == "sensor_msgs/msg/CompressedImage"
        for connection, _, data in reader.messages():
            if connection.topic == "/task/marks":
                message = reader.deserialize(data, connection.msgtype)
                kinds_drawn = {m.type for m in message.markers if m.action == 0}
                assert kinds_drawn <= {0, 1, 2, 5, 7}
                assert {m.header.frame_id for m in message.markers} == {"base"}


def test_the_replay_shows_the_same_face(tmp_path: Path):
    path = tmp_path / "face.mcap"
    shown = record(path)
    with open_recording(path) as cell:
        task = recorded_task(cell)
        assert isinstance(task, RecordedTask)
        playback = cell.world
        for i in (3, 4, 11):
            playback.advance(shown[i].stamp + 0.001)
            again, wanted = task.face(), shown[i].face
            assert task.name == "keep_above"
            assert face_fault(again) == ""
            assert (again.state, again.reason) == (wanted.state, wanted.reason)
            assert [(f.name, f.unit) for f in again.figures] == [
                ("distance", "mm"),
                ("unknown", ""),
            ]
            assert again.figures[0].value == wanted.figures[0].value
            assert np.isnan(again.figures[1].value)
            assert again.curves == wanted.curves
            assert [m.name for m in again.marks] == [m.name for m in wanted.marks]
            assert [p.name for p in again.pictures] == ["what it sees"]
            # What is recorded cannot be pressed.
            assert [(b.name, b.label, b.enabled) for b in again.buttons] == [
                ("go", "Go on", False),
                ("skip", "Skip", False),
            ]
        playback.reset()
        assert task.face() is None


def test_a_session_on_the_recording_has_the_face_in_its_view(tmp_path: Path):
    path = tmp_path / "face.mcap"
    record(path)
    with open_recording(path) as cell:
        session = Session(cell, recorded_task(cell), make=replay_parts)
        session.run(0.9)
        shown = session.view().face
        assert shown is not None
        assert shown.face.state == "approach"
        assert shown.traces[0].name == "tilt"
        assert len(shown.traces[0].values) > 10
        assert session.view().guard is not None


def test_a_recording_without_a_face_has_no_task(tmp_path: Path):
    path = tmp_path / "bare.mcap"
    cell = make_cell()
    recorder = Recorder(path, cell)
    session = FakeSession(cell)
    recorder.attach(session)
    rng = np.random.default_rng(3)
    for camera in cell.cameras:
        recorder.on_reading(make_frame(camera.info, 0, 0.0, rng), 0.0)
    recorder.update(0.0)
    recorder.close()
    with open_recording(path) as recorded:
        assert recorded_task(recorded) is None


def test_a_damaged_picture_is_passed_over():
    assert decode_picture(type("M", (), {"data": np.zeros(10, np.uint8)})()) is None
