"""Recordings of ROS are read as sets: pictures at rest, poses from tf, lenses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from armsight.arrays import Bytes, Poses
from armsight.calibration.boards import Checkerboard
from armsight.calibration.layouts.bags import unpack
from armsight.calibration.recorded_set import load
from armsight.calibration.synthetic_picture import board_picture
from armsight.calibration.synthetic_set import ArmErrors, SyntheticSet, make_set
from armsight.errors import CalibrationError
from armsight.robots import load_robot

BOARD = Checkerboard(10, 7, 0.025, hollow=False)


@pytest.fixture(scope="module")
def one() -> SyntheticSet:
    errors = ArmErrors(1e-5, 0.0)
    return make_set(load_robot("ur5"), np.random.default_rng(7), 6, "base", errors)


@pytest.fixture(scope="module")
def pictures(one: SyntheticSet) -> list[Bytes]:
    rng = np.random.default_rng(1)
    views = np.linalg.inv(one.T_mount_camera) @ one.true @ one.T_mount_board
    return [board_picture(BOARD, one.camera, T, rng, samples=2) for T in views]


def _write(bag: Path, store: Stores, one: SyntheticSet, pictures: list[Bytes]) -> None:
    """Rests of a second at every view, transforms of two links at 20 Hz, a picture in each."""
    types = get_typestore(store)
    types.register(
        get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
    )
    T = types.types
    ros1 = store is Stores.ROS1_NOETIC
    writer = Writer1(bag) if ros1 else Writer2(bag, version=9, storage_plugin=StoragePlugin.MCAP)
    sequence = {"seq": 0} if ros1 else {}
    with writer:
        tf = writer.add_connection("/tf", "tf2_msgs/msg/TFMessage", typestore=types)
        image = writer.add_connection("/cam/image_raw", "sensor_msgs/msg/Image", typestore=types)

        def header(t: float, frame: str):  # type: ignore[no-untyped-def]
            stamp = T["builtin_interfaces/msg/Time"](sec=int(t), nanosec=round((t % 1) * 1e9))
            return T["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id=frame)

        def transform(t: float, parent: str, child: str, M: Poses):  # type: ignore[no-untyped-def]
            q = Rotation.from_matrix(M[:3, :3]).as_quat()
            return T["geometry_msgs/msg/TransformStamped"](
                header=header(t, parent),
                child_frame_id=child,
                transform=T["geometry_msgs/msg/Transform"](
                    translation=T["geometry_msgs/msg/Vector3"](*(float(v) for v in M[:3, 3])),
                    rotation=T["geometry_msgs/msg/Quaternion"](*(float(v) for v in q)),
                ),
            )

        def send(connection, t: float, message) -> None:  # type: ignore[no-untyped-def]
            turn = types.serialize_ros1 if ros1 else types.serialize_cdr
            writer.write(connection, round(t * 1e9), turn(message, connection.msgtype))

        for k, (M, picture) in enumerate(zip(one.told, pictures)):
            # The arm is a link that turns and one that carries the flange.
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec([0, 0, 0.3 * k]).as_matrix()
            for step in range(25):
                t = 100.0 + 2.0 * k + 0.05 * step
                links = [
                    transform(t, "base_link", "shoulder", turn),
                    transform(t, "shoulder", "tool0", np.linalg.inv(turn) @ M),
                ]
                send(tf, t, T["tf2_msgs/msg/TFMessage"](links))
            data = picture.ravel()
            h, w = picture.shape
            message = T["sensor_msgs/msg/Image"](
                header(100.6 + 2.0 * k, "camera"), h, w, "mono8", 0, w, data
            )
            send(image, 100.6 + 2.0 * k, message)


@pytest.mark.parametrize("store", [Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE])
def test_a_recording_is_a_set(
    store: Stores, one: SyntheticSet, pictures: list[Bytes], tmp_path: Path
) -> None:
    bag = tmp_path / ("calib.bag" if store is Stores.ROS1_NOETIC else "calib")
    _write(bag, store, one, pictures)
    found = load(bag if bag.is_file() else tmp_path / "calib", BOARD)
    assert found.poses is not None
    camera = found.cameras[0]
    assert camera.mount == "base"
    np.testing.assert_allclose(found.poses[camera.view], one.told, atol=1e-6)


def test_a_recording_without_a_message_definition_says_which(tmp_path: Path) -> None:
    file = tmp_path / "foreign.mcap"
    with file.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start("ros2", "somebody's recorder")
        alone = b"std_msgs/Header header\nuint32 height\nuint8[] data"  # and no Header
        schema = writer.register_schema("sensor_msgs/msg/Image", "ros2msg", alone)
        channel = writer.register_channel("/camera/image_raw", "cdr", schema)
        writer.add_message(channel, 0, bytes(64), 0)
        writer.finish()
    with pytest.raises(
        CalibrationError, match=r"mcap: its definition .*std_msgs/msg/Header' is missing"
    ):
        unpack(file, tmp_path / "out")


def test_a_broken_recording_is_named(tmp_path: Path) -> None:
    bag = tmp_path / "calib.bag"
    bag.write_bytes(b"#ROSBAG V2.0\n" + bytes(400))
    place = tmp_path / "out"
    place.mkdir()
    with pytest.raises(CalibrationError, match=r"calib\.bag: cannot be read as a recording"):
        unpack(bag, place)
