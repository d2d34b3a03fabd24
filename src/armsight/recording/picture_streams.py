"""Rows of pictures: an exposure is several messages, and whole when the last of them is there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from armsight.arrays import ColorImage, DepthImage
from armsight.devices.data import RgbdFrame, StereoFrame
from armsight.geometry.camera import PinholeCamera
from armsight.recording import messages, small_pictures
from armsight.recording.codec import Decoding, Known, Message, Stream
from armsight.recording.messages import to_seconds
from armsight.recording.topics import (
    color_frame,
    color_topic,
    depth_frame,
    depth_topic,
    small,
    stereo_frame,
    stereo_topic,
)


def _lens(topic: str, lens: PinholeCamera, stamp: float, frame: str) -> Message:
    """The intrinsics beside an image topic."""
    data = messages.encode_camera_info(lens, stamp, frame)
    place = topic.rsplit("/", 1)[0]
    return Message(f"{place}/camera_info", messages.CAMERA_INFO, data, stamp)


def encode_frame(frame: RgbdFrame, known: Known) -> Iterator[Message]:
    """An exposure: pose if it has one, lenses, colour, depth."""
    info = known.cameras[frame.camera]
    place, stamp = depth_frame(info.name), frame.stamp
    if frame.T_base_camera is not None:
        data = messages.encode_transforms([("base", place, frame.T_base_camera)], stamp)
        yield Message("/tf", messages.TRANSFORMS, data, stamp)
    topic = depth_topic(info)
    yield _lens(topic, info.depth, stamp, place)
    if frame.color is not None and info.color is not None:
        where, to = color_frame(info.name), color_topic(info.name)
        yield _lens(to, info.color, stamp, where)
        yield _picture(to, frame.color, stamp, where, frame.sequence, known)
    # Depth comes last: when a reader meets it, everything else of the exposure is there.
    if known.small:
        data = small_pictures.encode_depth(frame.depth, stamp, place)
        yield Message(small(topic), messages.COMPRESSED, data, stamp, frame.sequence)
        return
    data = messages.encode_depth(frame.depth, stamp, place)
    yield Message(topic, messages.IMAGE, data, stamp, frame.sequence)


def _picture(
    topic: str, color: ColorImage, stamp: float, frame: str, sequence: int, known: Known
) -> Message:
    """A colour picture, whole or compressed."""
    if known.small:
        data = small_pictures.encode_color(color, stamp, frame)
        return Message(small(topic), messages.COMPRESSED, data, stamp, sequence)
    data = messages.encode_color(color, stamp, frame)
    return Message(topic, messages.IMAGE, data, stamp, sequence)


def _color(message: Any) -> ColorImage:
    """(h, w, 3) uint8 RGB of either."""
    decode = small_pictures if hasattr(message, "format") else messages
    return decode.decode_color(message)


def _depth(message: Any) -> DepthImage:
    """(h, w) float32 depth [m] of either."""
    decode = small_pictures if hasattr(message, "format") else messages
    return decode.decode_depth(message)


def decode_frame(topic: str, message: Any, record: Any, memory: Decoding) -> RgbdFrame | None:
    """The exposure whose depth this is; colour waits for it."""
    layout, stamp = memory.layout, messages.stamp_of(message)
    if topic in layout.color:
        memory.pictures[layout.color[topic]] = (stamp, _color(message))
        return None
    camera = layout.depth[topic]
    color_stamp, color = memory.pictures.pop(camera, (np.nan, None))
    place = layout.posed.get(camera)
    pose = None
    if place is not None and (layout.moving or place in memory.moved):
        pose = memory.tree.pose(layout.base, place)
    return RgbdFrame(
        camera,
        memory.count(camera, record.sequence),
        stamp - memory.shift,
        to_seconds(record.log_time) - memory.shift,
        _depth(message),
        color if color_stamp == stamp else None,
        pose,
    )


def encode_pair(frame: StereoFrame, known: Known) -> Iterator[Message]:
    """Both pictures with their lenses, the left one first."""
    info, stamp = known.stereo[frame.camera], frame.stamp
    for side, lens, picture in (
        ("left", info.left, frame.left),
        ("right", info.right, frame.right),
    ):
        place, topic = stereo_frame(info.name, side), stereo_topic(info.name, side)
        yield _lens(topic, lens, stamp, place)
        yield _picture(topic, picture, stamp, place, frame.sequence, known)


def decode_pair(topic: str, message: Any, record: Any, memory: Decoding) -> StereoFrame | None:
    """The pair whose right picture this is; the left one waits for it."""
    camera, side = memory.layout.stereo[topic]
    stamp, picture = messages.stamp_of(message), _color(message)
    if side == "left":
        memory.pictures[f"{camera}/left"] = (stamp, picture)
        return None
    left_stamp, left = memory.pictures.pop(f"{camera}/left", (np.nan, picture))
    if left_stamp != stamp:
        return None
    return StereoFrame(
        camera,
        memory.count(camera, record.sequence),
        stamp - memory.shift,
        to_seconds(record.log_time) - memory.shift,
        left,
        picture,
    )


RGBD = Stream(
    RgbdFrame,
    lambda layout: (*layout.depth, *layout.color),
    encode_frame,
    decode_frame,
    lambda frame: frame.depth.nbytes + (0 if frame.color is None else frame.color.nbytes),
)
STEREO = Stream(
    StereoFrame,
    lambda layout: tuple(layout.stereo),
    encode_pair,
    decode_pair,
    lambda frame: frame.left.nbytes + frame.right.nbytes,
)
