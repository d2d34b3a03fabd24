"""ROS 2 messages: bit for bit there and back, and laid out as the standard says."""

from __future__ import annotations

import struct
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from recorded_cells import camera_info, make_joints, make_movers, make_status

from armsight.devices.data import JointState
from armsight.errors import RecordingError
from armsight.geometry.pose import from_rpy
from armsight.motion.regions import Region
from armsight.recording import messages
from armsight.recording.markers import decode_movers, encode_movers, encode_solids
from armsight.recording.status_messages import GUARD, guard_from_status, guard_to_status


class Cdr:
    """Little-endian CDR read by hand, after OMG's rules: shares no code with what wrote it."""

    def __init__(self, data: bytes) -> None:
        assert data[:4] == b"\x00\x01\x00\x00"  # plain CDR, little endian
        self.data, self.at = data[4:], 0

    def number(self, code: str) -> float:
        size = struct.calcsize(code)
        self.at += -self.at % size
        (value,) = struct.unpack_from("<" + code, self.data, self.at)
        self.at += size
        return value

    def text(self) -> str:
        length = int(self.number("I"))
        raw = self.data[self.at : self.at + length]
        self.at += length
        assert raw.endswith(b"\x00")
        return raw[:-1].decode()

    def doubles(self) -> np.ndarray:
        count = int(self.number("I"))
        return np.array([self.number("d") for _ in range(count)])


def test_a_depth_image_is_laid_out_as_ros_wants() -> None:
    depth = np.array([[1.0, np.nan], [0.5, 4.25], [2.0, 3.0]], np.float32)
    cdr = Cdr(messages.encode_depth(depth, 12.000000345, "left_depth_optical_frame"))
    assert (cdr.number("i"), cdr.number("I")) == (12, 345)
    assert cdr.text() == "left_depth_optical_frame"
    assert (cdr.number("I"), cdr.number("I")) == (3, 2)
    assert cdr.text() == "32FC1"
    assert (cdr.number("B"), cdr.number("I"), cdr.number("I")) == (0, 8, 24)
    assert cdr.data[cdr.at : cdr.at + 24] == depth.tobytes()


def test_joint_states_are_laid_out_as_ros_wants() -> None:
    state = JointState(0.25, np.array([0.1, -2.0]), np.array([3.0, 4.0]))
    cdr = Cdr(messages.encode_joint_state(state, ("a", "joint_b")))
    assert (cdr.number("i"), cdr.number("I")) == (0, 250_000_000)
    assert cdr.text() == ""
    assert cdr.number("I") == 2
    assert [cdr.text(), cdr.text()] == ["a", "joint_b"]
    np.testing.assert_array_equal(cdr.doubles(), state.position)
    np.testing.assert_array_equal(cdr.doubles(), state.velocity)
    assert cdr.doubles().size == 0


@given(
    hnp.arrays(
        np.float32,
        hnp.array_shapes(min_dims=2, max_dims=2, max_side=12),
        elements=st.floats(width=32, allow_nan=True, allow_infinity=True),
    )
)
def test_depth_keeps_every_bit(depth: np.ndarray) -> None:
    back = messages.decode_depth(_again(messages.encode_depth(depth, 1.0, "c"), messages.IMAGE))
    assert back.dtype == np.float32
    assert back.tobytes() == depth.tobytes()


@given(hnp.arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9), st.just(3))))
def test_color_keeps_every_bit(color: np.ndarray) -> None:
    back = messages.decode_color(_again(messages.encode_color(color, 1.0, "c"), messages.IMAGE))
    np.testing.assert_array_equal(back, color)


def test_millimetre_depth_of_other_recorders_is_read() -> None:
    raw = np.array([[0, 1500, 65535]], np.uint16)
    message = messages.make(
        messages.IMAGE,
        header=messages.header(0.0, "x"),
        height=1,
        width=3,
        encoding="16UC1",
        is_bigendian=0,
        step=8,  # rows may be padded
        data=np.frombuffer(raw.tobytes() + b"\x00\x00", np.uint8),
    )
    np.testing.assert_allclose(messages.decode_depth(message), [[np.nan, 1.5, 65.535]], rtol=1e-6)


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("encoding", "bayer_rggb8", "expected 32FC1 or 16UC1"),
        ("step", 3, "holds 16 bytes in rows of 3"),
        ("height", 99, "expected 792"),
    ],
)
def test_images_that_cannot_be_are_refused(field: str, value: object, told: str) -> None:
    message = _again(messages.encode_depth(np.ones((2, 2), np.float32), 0.0, "x"), messages.IMAGE)
    setattr(message, field, value)
    with pytest.raises(RecordingError, match=told):
        messages.decode_depth(message)


def test_torn_messages_are_refused() -> None:
    data = messages.encode_depth(np.ones((2, 2), np.float32), 0.0, "x")
    with pytest.raises(RecordingError, match="cannot be decoded"):
        messages.decode(data[:20], messages.IMAGE)
    with pytest.raises(RecordingError, match="not one of ROS 2's"):
        messages.decode(data, "our_msgs/msg/Secret")


def test_lens_comes_back() -> None:
    lens = camera_info("c", 0.05).depth
    data = messages.encode_camera_info(lens, 0.0, "c")
    assert messages.decode_camera_info(_again(data, messages.CAMERA_INFO)) == lens


def test_joints_come_back_by_name() -> None:
    state = make_joints(0.5, 3, np.random.default_rng(0))
    message = _again(messages.encode_joint_state(state, ("a", "b", "c")), messages.JOINT_STATE)
    back = messages.decode_joint_state(message, ("c", "a"))
    assert back is not None
    np.testing.assert_array_equal(back.position, state.position[[2, 0]])
    np.testing.assert_array_equal(back.velocity, state.velocity[[2, 0]])
    assert messages.decode_joint_state(message, ("a", "other")) is None


def test_transforms_cloud_and_trajectory_come_back() -> None:
    rng = np.random.default_rng(1)
    T = from_rpy([0.1, -0.7, 2.0], [1.0, 2.0, -3.0])
    data = messages.encode_transforms([("base", "tool", T)], 4.5)
    [(stamp, parent, child, back)] = messages.decode_transforms(_again(data, messages.TRANSFORMS))
    assert (stamp, parent, child) == (4.5, "base", "tool")
    np.testing.assert_allclose(back, T, atol=1e-15)
    cloud = rng.normal(size=(17, 3)).astype(np.float32)
    data = messages.encode_cloud(cloud, 0.0, "base")
    np.testing.assert_array_equal(messages.decode_cloud(_again(data, messages.POINT_CLOUD)), cloud)
    path = rng.normal(size=(4, 6))
    data = messages.encode_trajectory(path, list("abcdef"), 0.0)
    np.testing.assert_array_equal(
        messages.decode_trajectory(_again(data, messages.TRAJECTORY)), path
    )


def test_movers_come_back() -> None:
    movers = make_movers(np.random.default_rng(2))
    back = decode_movers(_again(encode_movers(movers, 1.0, fresh=True), messages.MARKERS))
    assert [(m.name, m.solid.kind) for m in back] == [(m.name, m.solid.kind) for m in movers]
    for a, b in zip(movers, back):
        np.testing.assert_allclose(a.T_world_solid, b.T_world_solid, atol=1e-12)
        np.testing.assert_allclose(a.solid.size, b.solid.size)
    solids = encode_solids([m.solid for m in movers], 0.0, "base")
    assert len(_again(solids, messages.MARKERS).markers) == 3


@given(st.integers(0, 2**32 - 1))
def test_the_guards_word_comes_back_exactly(seed: int) -> None:
    status = make_status(1.25, 6, np.random.default_rng(seed))
    data = messages.encode_diagnostics([guard_to_status(status)], 1.25)
    level, reason, values = messages.decode_diagnostics(_again(data, messages.DIAGNOSTICS))[GUARD]
    back = guard_from_status(reason, values, status.path)
    assert back is not None
    assert level == 1
    for name in ("mode", "reason", "goal", "distance", "protective_distance", "timings"):
        assert getattr(back, name) == getattr(status, name)
    np.testing.assert_array_equal(back.command, status.command)
    np.testing.assert_array_equal(back.nearest_hazard, status.nearest_hazard)
    assert back.permit is not None
    assert status.permit is not None
    assert replace(back.permit, region=None) == replace(status.permit, region=None)
    for field in fields(Region):
        was, now = (getattr(s.permit.region, field.name) for s in (status, back))
        np.testing.assert_array_equal(was, now)


def test_no_permit_comes_back_as_none() -> None:
    status = replace(make_status(1.0, 6, np.random.default_rng(0)), permit=None)
    back = guard_from_status("", guard_to_status(status)[3])
    assert back is not None
    assert back.permit is None


def test_words_of_another_guard_are_not_ours() -> None:
    assert guard_from_status("fine", {"mode": "hovering"}) is None


def _again(data: bytes, kind: str) -> object:
    return messages.decode(data, kind)
