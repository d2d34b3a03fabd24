"""Recordings of ROS (``.bag``, ``.mcap``, ``.db3``; ours, too) as a folder of pictures and poses.

A recording is unpacked into the plainest layout that there is, once, and read like any other set:
pictures where the arm rests, one a rest, the pose of the arm at each, and the lenses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats, Poses
from armsight.calibration.layouts.kinds import BAGS
from armsight.calibration.layouts.tf_tree import TfTree, between
from armsight.errors import CalibrationError
from armsight.geometry.pose import from_quaternion
from armsight.pictures import decode_picture
from armsight.writing import write_text

MOST = 80
"""Pictures of a camera that are taken out of a recording."""
REST = (0.25, 0.0007)
"""The arm rests where its flange has not moved by more than the second [m] for the first [s]."""
IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
JOINTS, LENS = "sensor_msgs/msg/JointState", "sensor_msgs/msg/CameraInfo"
TREES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_ENCODINGS = {"mono8": 1, "8UC1": 1, "rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4}


@dataclass
class _Content:
    """What a recording holds, but for its pictures."""

    pictures: dict[str, list[float]] = field(default_factory=dict)
    tracks: dict[str, list[tuple[float, Floats]]] = field(default_factory=dict)
    joints: list[tuple[float, Floats]] = field(default_factory=list)
    lenses: dict[str, Any] = field(default_factory=dict)
    tree: TfTree = field(default_factory=TfTree)


def is_bag(path: Path) -> bool:
    """Whether a file or folder is a recording of ROS."""
    if path.is_file():
        return path.suffix.lower() in BAGS
    return (path / "metadata.yaml").is_file() and any(path.glob("*.mcap")) | any(path.glob("*.db3"))


def bag_in(folder: Path, others: Sequence[Path]) -> Path | None:
    """The recording that a folder without pictures holds, or None."""
    if is_bag(folder):
        return folder
    bags = [f for f in others if f.suffix.lower() in BAGS]
    if len(bags) > 1:
        raise CalibrationError(
            f"{folder}: {len(bags)} recordings in it, such as {bags[0].name}; give one of them"
        )
    return bags[0] if bags else None


def unpack(bag: Path, place: Path) -> None:
    """Write pictures at rest, ``poses_*.csv``, ``joints.csv`` and lenses of a recording.

    Args:
        bag: a file, or a folder of rosbag2.
        place: an empty folder.

    Raises:
        CalibrationError: it cannot be read, or holds no pictures, or no poses.
    """
    try:
        content = _survey(bag)
        if not content.pictures:
            raise CalibrationError(f"{bag}: no pictures in it (sensor_msgs/Image)")
        tracks = _tracks(content)
        if not tracks and not content.joints:
            raise CalibrationError(
                f"{bag}: no poses of an arm in it (tf, PoseStamped, TransformStamped, JointState)"
            )
        wanted = {t: _chosen(stamps, tracks) for t, stamps in content.pictures.items()}
        _write_pictures(bag, place, wanted)
    except CalibrationError:
        raise
    except KeyError as error:
        raise CalibrationError(
            f"{bag}: its definition of a message is not whole: {error} is missing"
        ) from None
    except Exception as error:  # rosbags raises whatever a broken file makes it stumble over
        raise CalibrationError(f"{bag}: cannot be read as a recording of ROS: {error}") from None
    _write_poses(place, wanted, tracks, content.joints)
    for topic, info in content.lenses.items():
        write_text(place / f"{_word(topic)}.yaml", info)


def _messages(bag: Path, kinds: tuple[str, ...] | None) -> Iterator[tuple[str, str, float, Any]]:
    """Topic, type, time [s] and message, of some types or of all but pictures' bytes."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        use = [c for c in reader.connections if kinds is None or c.msgtype in kinds]
        if kinds is None:
            use = [c for c in use if c.msgtype in (*IMAGES, *_READ)]
        for connection, stamp, raw in reader.messages(connections=use):
            message = reader.deserialize(raw, connection.msgtype)
            yield connection.topic, connection.msgtype, _stamp(message, 1e-9 * stamp), message


def _stamp(message: Any, otherwise: float) -> float:
    header = getattr(message, "header", None)
    if header is None:
        return otherwise
    said = float(header.stamp.sec) + 1e-9 * float(header.stamp.nanosec)
    return said if said > 0 else otherwise


def _pose(p: Any, q: Any) -> Floats:
    return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w], float)


_READ = (
    *TREES,
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TransformStamped",
    JOINTS,
    LENS,
    "nav_msgs/msg/Odometry",
)


def _survey(bag: Path) -> _Content:
    content = _Content()
    for topic, kind, stamp, m in _messages(bag, None):
        if kind in IMAGES:
            if kind == IMAGES[0] and m.encoding not in _ENCODINGS:
                continue  # depth, Bayer
            if "depth" not in topic.lower():
                content.pictures.setdefault(topic, []).append(stamp)
        elif kind in TREES:
            for t in m.transforms:
                at = float(t.header.stamp.sec) + 1e-9 * float(t.header.stamp.nanosec)
                value = _pose(t.transform.translation, t.transform.rotation)
                content.tree.add(t.header.frame_id, t.child_frame_id, at or stamp, value)
        elif kind == JOINTS:
            content.joints.append((stamp, np.asarray(m.position, float)))
        elif kind == LENS:
            content.lenses[topic] = _camera_info(topic, m)
        else:
            inner = getattr(m, "pose", getattr(m, "transform", None))
            inner = getattr(inner, "pose", inner)
            place = getattr(inner, "position", getattr(inner, "translation", None))
            turn = getattr(inner, "orientation", getattr(inner, "rotation", None))
            content.tracks.setdefault(topic, []).append((stamp, _pose(place, turn)))
    return content


def _camera_info(topic: str, m: Any) -> str:
    k = m.k if hasattr(m, "k") else m.K  # ROS 1 writes them large
    d = m.d if hasattr(m, "d") else m.D
    numbers = ", ".join(f"{v!r}" for v in np.asarray(k, float).tolist())
    bent = ", ".join(f"{v!r}" for v in np.asarray(d, float).tolist())
    return (
        f"camera_name: {_word(topic)}\nimage_width: {m.width}\nimage_height: {m.height}\n"
        f"distortion_model: {m.distortion_model}\n"
        f"camera_matrix: {{rows: 3, cols: 3, data: [{numbers}]}}\n"
        f"distortion_coefficients: {{rows: 1, cols: {len(d)}, data: [{bent}]}}\n"
    )


def _tracks(content: _Content) -> dict[str, tuple[Floats, Poses]]:
    """Times [s] and poses of everything that may be the arm's flange, by name."""
    out: dict[str, tuple[Floats, Poses]] = {}
    for topic, rows in content.tracks.items():
        rows.sort(key=lambda r: r[0])
        T = np.array([from_quaternion(v[3:], v[:3]) for _, v in rows])
        out[_word(topic)] = np.array([t for t, _ in rows]), T
    out.update(content.tree.tracks())
    return {name: track for name, track in out.items() if len(track[0]) >= 2}


def _chosen(stamps: Sequence[float], tracks: dict[str, tuple[Floats, Poses]]) -> list[float]:
    """Times of pictures to take: one of each rest of the arm; evenly spread where it has none."""
    at = np.array(sorted(stamps))
    resting: Floats = np.zeros(0)
    for times, T in tracks.values():
        still = at[_rests(at, times, T)]
        ends = np.flatnonzero(np.diff(still) > 1.5 * REST[0])
        groups = np.split(still, ends + 1)
        middles = np.array([g[len(g) // 2] for g in groups if len(g)])
        if len(middles) > len(resting):
            resting = middles
    use = resting if len(resting) >= 5 else at
    pick = np.unique(np.linspace(0, len(use) - 1, min(len(use), MOST)).astype(int))
    return [float(t) for t in use[pick]]


def _rests(at: Floats, times: Floats, T: Poses) -> Any:
    """(n,) whether the arm rests at some times."""
    place = T[:, :3, 3] + 0.1 * T[:, :3, 0]
    before = np.stack([np.interp(at - REST[0], times, place[:, k]) for k in range(3)], 1)
    after = np.stack([np.interp(at + REST[0], times, place[:, k]) for k in range(3)], 1)
    inside = (at >= times[0]) & (at <= times[-1])
    return inside & (np.linalg.norm(after - before, axis=1) < REST[1])


def _write_pictures(bag: Path, place: Path, wanted: dict[str, list[float]]) -> None:
    rest = {topic: set(times) for topic, times in wanted.items()}
    for topic, kind, stamp, m in _messages(bag, IMAGES):
        if stamp not in rest.get(topic, ()):
            continue
        gray = _gray(m, kind)
        if gray is not None:
            folder = place / _word(topic)
            folder.mkdir(exist_ok=True)
            cv2.imwrite(str(folder / f"{_name(stamp)}.png"), gray)


def _gray(m: Any, kind: str) -> Bytes | None:
    if kind == IMAGES[1]:
        found = decode_picture(m.data, cv2.IMREAD_GRAYSCALE)
        return None if found is None else np.asarray(found, np.uint8)
    channels = _ENCODINGS[m.encoding]
    if m.step < m.width * channels or len(m.data) < m.step * m.height:
        return None
    rows = np.frombuffer(m.data, np.uint8)[: m.step * m.height].reshape(m.height, m.step)
    image = rows[:, : m.width * channels].reshape(m.height, m.width, channels)
    if channels == 1:
        return np.ascontiguousarray(image[..., 0])
    red = 0 if m.encoding.startswith("rgb") else 2
    weights = np.array([0.299, 0.587, 0.114])[[red, 1, 2 - red]]
    return np.asarray(np.rint(image[..., :3] @ weights), np.uint8)


def _write_poses(
    place: Path,
    wanted: dict[str, list[float]],
    tracks: dict[str, tuple[Floats, Poses]],
    joints: Sequence[tuple[float, Floats]],
) -> None:
    stamps = sorted({t for times in wanted.values() for t in times})
    for name, (times, T) in tracks.items():
        lines = ["image,x,y,z,r00,r01,r02,r10,r11,r12,r20,r21,r22"]
        for t in stamps:
            if times[0] - REST[0] <= t <= times[-1] + REST[0]:
                k = int(np.clip(np.searchsorted(times, t), 1, len(times) - 1))
                share = (t - times[k - 1]) / max(times[k] - times[k - 1], 1e-9)
                P = between(T[k - 1], T[k], float(np.clip(share, 0, 1)))
                row = [*P[:3, 3], *P[:3, :3].ravel()]
                lines.append(f"{_name(t)}.png," + ",".join(f"{v:.9f}" for v in row))
        write_text(place / f"poses_{name}.csv", "\n".join(lines) + "\n")
    usual = max((len(q) for _, q in joints), key=[len(q) for _, q in joints].count, default=0)
    rows = [(t, q) for t, q in joints if len(q) == usual]
    if 5 <= usual <= 8 and len(rows) > 1:
        times = np.array([t for t, _ in rows])
        Q = np.array([q for _, q in rows])
        lines = ["image," + ",".join(f"q{k + 1}" for k in range(usual))]
        for t in stamps:
            q = [np.interp(t, times, Q[:, k]) for k in range(usual)]
            lines.append(f"{_name(t)}.png," + ",".join(f"{v:.9f}" for v in q))
        write_text(place / "joints.csv", "\n".join(lines) + "\n")


def _name(stamp: float) -> str:
    return f"{round(stamp * 1e6):d}"


def _word(topic: str) -> str:
    """A topic as a file's name."""
    return "_".join(p for p in topic.strip("/").replace("-", "_").split("/") if p) or "topic"
