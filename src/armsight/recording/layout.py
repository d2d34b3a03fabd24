"""Where in a recording the things are that a replay needs: ours by name, others' by looking."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, TypeVar

import numpy as np

from armsight.arrays import Pose
from armsight.devices.data import DepthNoise, RgbdCameraInfo
from armsight.errors import RecordingError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse
from armsight.recording import messages
from armsight.recording.description import CellDescription, from_metadata
from armsight.recording.mcap_file import McapReader
from armsight.recording.no_robot import NAME as NO_ROBOT
from armsight.recording.topics import (
    color_topic,
    depth_frame,
    depth_topic,
    small,
    stereo_topic,
)

V = TypeVar("V")
LOOK = 400
"""Transforms of a foreign recording that are looked at to learn where its cameras are."""


class FrameTree:
    """The newest transform of every frame to its parent."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Pose]] = {}

    def set(self, parent: str, child: str, T_parent_child: Pose) -> None:
        """Learn where a frame is."""
        self._parents[child] = (parent, T_parent_child)

    def knows(self, frame: str) -> bool:
        """Whether the frame has a parent."""
        return frame in self._parents

    def root(self, frame: str) -> str:
        """The frame at the top of another's chain."""
        return self._chain(frame)[-1][0]

    def pose(self, base: str, frame: str) -> Pose | None:
        """``T_base_frame``, or None where the tree does not connect them."""
        up_base, up_frame = dict(self._chain(base)), dict(self._chain(frame))
        for name, T_frame in up_frame.items():
            if name in up_base:
                return inverse(up_base[name]) @ T_frame
        return None

    def _chain(self, frame: str) -> list[tuple[str, Pose]]:
        """(ancestor, ``T_ancestor_frame``) from the frame itself up to its root."""
        chain = [(frame, np.eye(4))]
        while chain[-1][0] in self._parents and len(chain) < 100:
            parent, T = self._parents[chain[-1][0]]
            chain.append((parent, T @ chain[-1][1]))
        return chain


@dataclass(frozen=True)
class Layout:
    """What a recording holds and where.

    Attributes:
        description: of the cell.
        depth, color: topic to camera name.
        joints: topic of the arm's joints, or empty.
        posed: camera name to the frame of its depth lens, for cameras that say where they are.
        base: the frame that poses are wanted in.
        moving: every pose comes from the transforms, not only those that are recorded directly.
        tree: the transforms known at the start.
        stereo: topic to the name of the pair, and ``left`` or ``right``.
    """

    description: CellDescription
    depth: Mapping[str, str]
    color: Mapping[str, str]
    joints: str
    posed: Mapping[str, str]
    base: str = "base"
    moving: bool = False
    tree: FrameTree = field(default_factory=FrameTree)
    stereo: Mapping[str, tuple[str, str]] = field(default_factory=dict)


NO_DEPTH = {"ir", "infra", "infra1", "infra2", "infrared", "amplitude", "intensity", "confidence"}
"""Words of topics whose images are no depth, though they may be encoded as if they were."""


def layout_of(reader: McapReader) -> Layout:
    """The layout of a recording, ours or another program's.

    Raises:
        RecordingError: there is no depth image in it, or a camera's lens or place is not known.
    """
    description = from_metadata(reader.contents.metadata)
    if description is None:
        return _foreign(reader)
    cameras = description.cameras
    return Layout(
        description,
        _either({depth_topic(info): info.name for info in cameras}),
        _either({color_topic(info.name): info.name for info in cameras}),
        "/joint_states",
        {info.name: depth_frame(info.name) for info in cameras},
        stereo=_either(
            {
                stereo_topic(pair.name, side): (pair.name, side)
                for pair in description.stereo
                for side in ("left", "right")
            }
        ),
    )


def _either(topics: Mapping[str, V]) -> dict[str, V]:
    """Topics of pictures, and where the same lie compressed."""
    return {**topics, **{small(topic): value for topic, value in topics.items()}}


def _listed(topics: Iterable[str], most: int = 12) -> str:
    """Names in a line that can be read."""
    names = sorted(topics)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(names[:most]) or "none") + more


def _foreign(reader: McapReader) -> Layout:
    kinds = reader.topics
    first = {topic: _first(reader, topic) for topic in kinds if kinds[topic] == messages.IMAGE}
    depth = {
        topic: message.header.frame_id.lstrip("/")
        for topic, message in first.items()
        if message is not None and _is_depth(topic, message.encoding)
    }
    if not depth:
        raise RecordingError(
            f"{reader.path}: no depth images (sensor_msgs/Image, 32FC1 or 16UC1; mono16 where the "
            f'topic says "depth") among its ROS 2 topics ({_listed(kinds)})'
            + (f"; it was cut short ({reader.contents.cut})" if reader.contents.cut else "")
        )
    tree, moving = _tree(reader)
    base = _base(tree, next(iter(depth.values())))
    names = {topic: _name(topic) for topic in depth}
    if len(depth) == 1:
        names = {topic: topic.strip("/").split("/")[0] for topic in depth}
    elif len(set(names.values())) < len(names):  # a camera's raw and its rectified depth
        names = {topic: topic.strip("/").replace("/", "_") for topic in depth}
    cameras = []
    for topic, frame in depth.items():
        lens = _first(reader, topic.rsplit("/", 1)[0] + "/camera_info")
        if lens is None:
            raise RecordingError(
                f"{reader.path}: {topic} has no camera_info beside it, so its lens is not known"
            )
        pose = tree.pose(base, frame)
        if pose is None:
            raise RecordingError(
                f"{reader.path}: /tf and /tf_static do not say where {frame} ({topic}) is in {base}"
            )
        cameras.append(_camera(names[topic], messages.decode_camera_info(lens), pose))
    description = CellDescription(NO_ROBOT, "none", np.eye(4), (), tuple(cameras), ())
    posed = {names[t]: f for t, f in depth.items() if moving}
    return Layout(description, names, {}, "", posed, base, moving, tree)


def _is_depth(topic: str, encoding: str) -> bool:
    """Whether images are depth: infrared and the like come in 16 bits as well, grey."""
    words = set(re.split(r"[/_]", topic.lower()))
    if encoding in ("32FC1", "16UC1"):
        return not words & NO_DEPTH or "depth" in words
    return encoding == "mono16" and "depth" in topic.lower()


def _first(reader: McapReader, topic: str) -> Any:
    """The first message of a topic, or None; chunks that do not hold it are passed over."""
    for _, kind, record in reader.messages([topic]):
        return _decoded(reader, topic, kind, record)
    return None


def _decoded(reader: McapReader, topic: str, kind: str, record: Any) -> Any:
    """A message of somebody else's recording.

    Raises:
        RecordingError: names the recording and the topic whose message is none.
    """
    try:
        return messages.decode(record.data, kind)
    except RecordingError as error:
        raise RecordingError(f"{reader.path}: {topic}: {error}") from error


def _tree(reader: McapReader) -> tuple[FrameTree, bool]:
    """First transform of each frame, and whether any transform moves."""
    tree, moving = FrameTree(), False
    kinds = reader.topics
    for topic in (topic for topic in kinds if kinds[topic] == messages.TRANSFORMS):
        for _, kind, record in islice(reader.messages([topic]), LOOK):
            moving = moving or not topic.endswith("tf_static")
            said = messages.decode_transforms(_decoded(reader, topic, kind, record))
            for _, parent, child, T in said:
                if not tree.knows(child):
                    tree.set(parent, child, T)
    return tree, moving


def _base(tree: FrameTree, frame: str) -> str:
    for name in ("base", "base_link"):
        if tree.pose(name, frame) is not None:
            return name
    return tree.root(frame)


def _name(topic: str) -> str:
    """A camera's name from its image topic: the part that tells it from the others."""
    parts = topic.strip("/").split("/")
    return "_".join(part for part in parts[:-1] if part != "depth") or parts[0]


def _camera(name: str, lens: PinholeCamera, pose: Pose) -> RgbdCameraInfo:
    """What may be assumed of a camera that nobody described."""
    return RgbdCameraInfo(
        name=name,
        model="unknown",
        depth=lens,
        color=None,
        T_depth_color=np.eye(4),
        mounted_on="base",
        T_mount_camera=pose,
        rate=30.0,
        latency=0.0,
        range=(0.2, 6.0),
        noise=DepthNoise(0.001, 0.0, 0.002),
    )
