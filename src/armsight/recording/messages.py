"""ROS 2 messages from our data and back: CDR encoding by rosbags, no ROS needed.

Only standard types are written, so Foxglove, ``ros2 bag`` and rosbags read what we record. Arrays
keep their bits: depth is ``32FC1`` (REP-118: metres, NaN is no return), joints are float64.
Times are rounded to the nanosecond, which is all that a ROS stamp can carry.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from armsight.arrays import ColorImage, DepthImage, Floats32, JointPath, Points, Pose
from armsight.devices.data import JointState
from armsight.errors import RecordingError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_quaternion, to_quaternion

IMAGE = "sensor_msgs/msg/Image"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
JOINT_STATE = "sensor_msgs/msg/JointState"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
STRING = "std_msgs/msg/String"
FLOAT = "std_msgs/msg/Float64"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
PATH = "nav_msgs/msg/Path"
WRENCH = "geometry_msgs/msg/WrenchStamped"
MARKERS = "visualization_msgs/msg/MarkerArray"
COMPRESSED = "sensor_msgs/msg/CompressedImage"

NANOSECONDS = 1_000_000_000
MOST_PIXELS = 16384
"""Of a lens, across or down: what says more asks for memory that nobody has."""


def to_ns(seconds: float) -> int:
    """Nanoseconds of a time in [s]; 0 of a time that is not known (infinite)."""
    return round(seconds * NANOSECONDS) if math.isfinite(seconds) else 0


def to_seconds(ns: int) -> float:
    """Seconds of a time in [ns]."""
    return ns / NANOSECONDS


@cache
def typestore() -> Any:
    """The message types of ROS 2 Humble, the oldest release still in wide use."""
    return get_typestore(Stores.ROS2_HUMBLE)


def definition(type_name: str) -> str:
    """The ``.msg`` text of a type with everything that it contains, for a file's schema."""
    return str(typestore().generate_msgdef(type_name, ros_version=2)[0])


def make(type_name: str, **fields: Any) -> Any:
    """A message object of a type given as ``package/msg/Name``."""
    return typestore().types[type_name](**fields)


def encode(message: Any) -> bytes:
    """CDR bytes of a message object."""
    return bytes(typestore().serialize_cdr(message, message.__msgtype__))


def decode(data: bytes, type_name: str) -> Any:
    """Message object of CDR bytes.

    Raises:
        RecordingError: the bytes are not such a message.
    """
    try:
        return typestore().deserialize_cdr(data, type_name)
    except KeyError:
        raise RecordingError(
            f"message type {type_name} is not one of ROS 2's standard types"
        ) from None
    except Exception as error:  # rosbags raises struct, value and its own errors alike
        raise RecordingError(f"a {type_name} message cannot be decoded: {error}") from error


def time_message(seconds: float) -> Any:
    """builtin_interfaces/Time of a time [s]."""
    sec, nanosec = divmod(to_ns(seconds), NANOSECONDS)
    return make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)


def stamp_of(message: Any) -> float:
    """Time [s] in a message's header."""
    stamp = message.header.stamp
    return to_seconds(stamp.sec * NANOSECONDS + stamp.nanosec)


def header(seconds: float, frame: str = "") -> Any:
    """std_msgs/Header."""
    return make("std_msgs/msg/Header", stamp=time_message(seconds), frame_id=frame)


# --- cameras ---------------------------------------------------------------------------------


def encode_depth(depth: DepthImage, stamp: float, frame: str) -> bytes:
    """Image of (h, w) float32 depth [m], bit for bit."""
    return _image(np.ascontiguousarray(depth, np.float32), "32FC1", stamp, frame)


def encode_color(color: ColorImage, stamp: float, frame: str) -> bytes:
    """Image of (h, w, 3) uint8 RGB."""
    return _image(np.ascontiguousarray(color, np.uint8), "rgb8", stamp, frame)


def _image(pixels: Any, encoding: str, stamp: float, frame: str) -> bytes:
    height, width = pixels.shape[:2]
    return encode(
        make(
            IMAGE,
            header=header(stamp, frame),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=pixels.nbytes // height if height else 0,
            data=pixels.reshape(-1).view(np.uint8),
        )
    )


def decode_depth(message: Any) -> DepthImage:
    """(h, w) float32 depth [m], NaN where there is no return.

    ``32FC1`` holds metres; ``16UC1`` holds millimetres, 0 is no return (REP-118).

    Raises:
        RecordingError: another encoding, or data that does not fill the image.
    """
    if message.encoding in ("16UC1", "mono16"):
        raw = _pixels(message, np.dtype(np.uint16), 1)[..., 0]
        return np.asarray(np.where(raw == 0, np.nan, raw * np.float32(0.001)), np.float32)
    if message.encoding != "32FC1":
        raise RecordingError(
            f"depth image of {message.header.frame_id or 'a camera'} is encoded as "
            f"'{message.encoding}'; expected 32FC1 or 16UC1 (REP-118)"
        )
    return np.asarray(_pixels(message, np.dtype(np.float32), 1)[..., 0])


def decode_color(message: Any) -> ColorImage:
    """(h, w, 3) uint8 RGB of an rgb8, bgr8, rgba8, bgra8 or mono8 image.

    Raises:
        RecordingError: another encoding, or data that does not fill the image.
    """
    channels = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1}.get(message.encoding)
    if channels is None:
        raise RecordingError(
            f"colour image of {message.header.frame_id or 'a camera'} is encoded as "
            f"'{message.encoding}'; expected rgb8, bgr8, rgba8, bgra8 or mono8"
        )
    pixels = _pixels(message, np.dtype(np.uint8), channels)
    if channels == 1:
        return np.repeat(pixels, 3, axis=2)
    order = slice(2, None, -1) if message.encoding.startswith("bgr") else slice(0, 3)
    return np.ascontiguousarray(pixels[..., :3][..., order])


def _pixels(message: Any, dtype: np.dtype[Any], channels: int) -> Any:
    """(h, w, channels) array of an image, its rows' padding removed."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * channels * dtype.itemsize
    data = np.frombuffer(message.data, np.uint8)
    if step < row or data.size < step * height:
        raise RecordingError(
            f"image of {width}x{height} {message.encoding} holds {data.size} bytes in rows of "
            f"{step}; expected {row * height}"
        )
    rows = np.ascontiguousarray(data[: step * height].reshape(height, step)[:, :row])
    order = dtype.newbyteorder(">" if message.is_bigendian else "<")
    return rows.view(order).astype(dtype, copy=False).reshape(height, width, channels)


def encode_camera_info(lens: PinholeCamera, stamp: float, frame: str) -> bytes:
    """CameraInfo of a lens: plumb_bob distortion, K, and P = [K | 0]."""
    P = np.zeros((3, 4))
    P[:, :3] = lens.K
    return encode(
        make(
            CAMERA_INFO,
            header=header(stamp, frame),
            height=lens.height,
            width=lens.width,
            distortion_model="plumb_bob",
            d=np.array(lens.distortion, np.float64),
            k=lens.K.reshape(9),
            r=np.eye(3).reshape(9),
            p=P.reshape(12),
            binning_x=0,
            binning_y=0,
            roi=make(
                "sensor_msgs/msg/RegionOfInterest",
                x_offset=0,
                y_offset=0,
                height=0,
                width=0,
                do_rectify=False,
            ),
        )
    )


def decode_camera_info(message: Any) -> PinholeCamera:
    """The lens that a CameraInfo describes.

    Raises:
        RecordingError: a distortion that is not plumb_bob, or no lens at all.
    """
    d = np.asarray(message.d, float)
    if np.any(d) and (message.distortion_model != "plumb_bob" or d.size != 5):
        raise RecordingError(
            f"camera info of {message.header.frame_id} uses distortion "
            f"'{message.distortion_model}' with {d.size} values; expected plumb_bob with 5"
        )
    d = d if d.size == 5 else np.zeros(5)
    fx, fy, cx, cy = (float(message.k[i]) for i in (0, 4, 2, 5))
    distortion = (float(d[0]), float(d[1]), float(d[2]), float(d[3]), float(d[4]))
    lens = PinholeCamera(int(message.width), int(message.height), fx, fy, cx, cy, distortion)
    if not possible(lens):
        raise RecordingError(
            f"camera info of {message.header.frame_id} says {lens.width}x{lens.height} pixels and "
            f"focal lengths {fx:g}, {fy:g}: no lens; was the camera not calibrated?"
        )
    return lens


def possible(lens: PinholeCamera) -> bool:
    """Whether a lens can be: finite, with focal lengths, and no larger than any picture."""
    numbers = (lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion)
    sizes = (lens.width, lens.height)
    return (
        all(math.isfinite(value) for value in numbers)
        and min(lens.fx, lens.fy) > 0.0
        and all(0 < size <= MOST_PIXELS for size in sizes)
    )


# --- arm -------------------------------------------------------------------------------------


def encode_joint_state(state: JointState, names: Sequence[str]) -> bytes:
    """JointState, float64 throughout."""
    empty = np.zeros(0)
    return encode(
        make(
            JOINT_STATE,
            header=header(state.stamp),
            name=list(names),
            position=np.asarray(state.position, np.float64),
            velocity=np.asarray(state.velocity, np.float64),
            effort=empty if state.effort is None else np.asarray(state.effort, np.float64),
        )
    )


def decode_joint_state(message: Any, names: Sequence[str]) -> JointState | None:
    """The joints called ``names`` in that order; None where the message lacks one of them."""
    where = {name: i for i, name in enumerate(message.name)}
    if not all(name in where for name in names):
        return None
    order = np.array([where[name] for name in names], np.int64)
    position = np.asarray(message.position, float)[order]
    velocity = np.asarray(message.velocity, float)
    effort = np.asarray(message.effort, float)
    return JointState(
        stamp_of(message),
        position,
        velocity[order] if velocity.size else np.zeros(len(order)),
        effort[order] if effort.size else None,
    )


def encode_trajectory(path: JointPath, names: Sequence[str], stamp: float) -> bytes:
    """JointTrajectory of (k, n) waypoints; their times are not known and stay zero."""
    zero = make("builtin_interfaces/msg/Duration", sec=0, nanosec=0)
    none = np.zeros(0)
    points = [
        make(
            "trajectory_msgs/msg/JointTrajectoryPoint",
            positions=np.asarray(q, np.float64),
            velocities=none,
            accelerations=none,
            effort=none,
            time_from_start=zero,
        )
        for q in path
    ]
    return encode(make(TRAJECTORY, header=header(stamp), joint_names=list(names), points=points))


def decode_trajectory(message: Any) -> JointPath:
    """(k, n) waypoints [rad]."""
    return np.array([point.positions for point in message.points], float).reshape(
        len(message.points), len(message.joint_names)
    )


# --- space -----------------------------------------------------------------------------------


def vector_message(v: Any) -> Any:
    """geometry_msgs/Vector3."""
    return make("geometry_msgs/msg/Vector3", x=float(v[0]), y=float(v[1]), z=float(v[2]))


def point_message(v: Any) -> Any:
    """geometry_msgs/Point."""
    return make("geometry_msgs/msg/Point", x=float(v[0]), y=float(v[1]), z=float(v[2]))


def quaternion_message(T: Pose) -> Any:
    """geometry_msgs/Quaternion of a pose's rotation."""
    x, y, z, w = (float(value) for value in to_quaternion(T))
    return make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def pose_message(T: Pose) -> Any:
    """geometry_msgs/Pose."""
    return make(
        "geometry_msgs/msg/Pose",
        position=point_message(T[:3, 3]),
        orientation=quaternion_message(T),
    )


def pose_of(message: Any) -> Pose:
    """Pose of a geometry_msgs/Pose or Transform."""
    place = message.position if hasattr(message, "position") else message.translation
    turn = message.orientation if hasattr(message, "orientation") else message.rotation
    return from_quaternion([turn.x, turn.y, turn.z, turn.w], [place.x, place.y, place.z])


def encode_transforms(transforms: Iterable[tuple[str, str, Pose]], stamp: float) -> bytes:
    """TFMessage of (parent, child, ``T_parent_child``)."""
    return encode(
        make(
            TRANSFORMS,
            transforms=[
                make(
                    "geometry_msgs/msg/TransformStamped",
                    header=header(stamp, parent),
                    child_frame_id=child,
                    transform=make(
                        "geometry_msgs/msg/Transform",
                        translation=vector_message(T[:3, 3]),
                        rotation=quaternion_message(T),
                    ),
                )
                for parent, child, T in transforms
            ],
        )
    )


def decode_transforms(message: Any) -> list[tuple[float, str, str, Pose]]:
    """(stamp [s], parent, child, ``T_parent_child``) of each transform that is one.

    Frames that nobody has placed yet are found in bags with a rotation of zeros.
    """
    return [
        (
            stamp_of(t),
            t.header.frame_id.lstrip("/"),
            t.child_frame_id.lstrip("/"),
            pose_of(t.transform),
        )
        for t in message.transforms
        if _is_pose(t.transform)
    ]


def _is_pose(message: Any) -> bool:
    place, turn = message.translation, message.rotation
    length = math.hypot(turn.x, turn.y, turn.z, turn.w)
    return math.isfinite(length + place.x + place.y + place.z) and length > 1e-6


def encode_cloud(points: Floats32, stamp: float, frame: str) -> bytes:
    """PointCloud2 of (n, 3) float32 points [m]."""
    field = "sensor_msgs/msg/PointField"
    data = np.ascontiguousarray(points, np.float32)
    return encode(
        make(
            POINT_CLOUD,
            header=header(stamp, frame),
            height=1,
            width=len(data),
            fields=[
                make(field, name=name, offset=4 * i, datatype=7, count=1)
                for i, name in enumerate("xyz")
            ],
            is_bigendian=False,
            point_step=12,
            row_step=12 * len(data),
            data=data.reshape(-1).view(np.uint8),
            is_dense=True,
        )
    )


def decode_cloud(message: Any) -> Floats32:
    """(n, 3) float32 points [m] of a cloud whose x, y, z are little-endian float32."""
    offsets = {f.name: int(f.offset) for f in message.fields if f.datatype == 7}
    if message.is_bigendian or not {"x", "y", "z"} <= offsets.keys():
        raise RecordingError("a point cloud lacks little-endian float32 fields x, y, z")
    step, count = int(message.point_step), int(message.width) * int(message.height)
    rows = np.frombuffer(message.data, np.uint8)[: step * count].reshape(count, step)
    columns = [
        np.ascontiguousarray(rows[:, offsets[n] : offsets[n] + 4]).view("<f4") for n in "xyz"
    ]
    return np.hstack(columns).astype(np.float32)


def encode_path(points: Points, stamp: float, frame: str) -> bytes:
    """nav_msgs/Path through (k, 3) points [m]."""
    upright = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    where = header(stamp, frame)
    return encode(
        make(
            PATH,
            header=where,
            poses=[
                make(
                    "geometry_msgs/msg/PoseStamped",
                    header=where,
                    pose=make(
                        "geometry_msgs/msg/Pose",
                        position=point_message(p),
                        orientation=upright,
                    ),
                )
                for p in points
            ],
        )
    )


# --- words -----------------------------------------------------------------------------------


def encode_string(text: str) -> bytes:
    """std_msgs/String."""
    return encode(make(STRING, data=text))


def encode_float(value: float) -> bytes:
    """std_msgs/Float64."""
    return encode(make(FLOAT, data=float(value)))


def encode_diagnostics(
    statuses: Iterable[tuple[int, str, str, Mapping[str, str]]], stamp: float
) -> bytes:
    """DiagnosticArray of (level, name, message, values); level 0 ok, 1 warn, 2 error, 3 stale."""
    return encode(
        make(
            DIAGNOSTICS,
            header=header(stamp),
            status=[
                make(
                    "diagnostic_msgs/msg/DiagnosticStatus",
                    level=level,
                    name=name,
                    message=message,
                    hardware_id="",
                    values=[
                        make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
                        for key, value in values.items()
                    ],
                )
                for level, name, message, values in statuses
            ],
        )
    )


def decode_diagnostics(message: Any) -> dict[str, tuple[int, str, dict[str, str]]]:
    """Name to (level, message, values) of each status."""
    return {
        status.name: (
            int(status.level),
            status.message,
            {entry.key: entry.value for entry in status.values},
        )
        for status in message.status
    }
