"""A task's face as ROS 2 messages and back: Foxglove draws them, a replay shows the same face.

=========================== ============================================ =========================
topic                       type                                         holds
=========================== ============================================ =========================
``/task/face``              ``diagnostic_msgs/msg/DiagnosticArray``      state, reason, figures,
                                                                         curves' values, buttons
``/task/curve/NAME``        ``std_msgs/msg/Float64``                     a curve, to be plotted
``/task/marks``             ``visualization_msgs/msg/MarkerArray``       marks in ``base``
``/task/picture/NAME``      ``sensor_msgs/msg/CompressedImage``          a picture, JPEG
=========================== ============================================ =========================

Marks and pictures are written before the face that shows them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from armsight import pictures
from armsight.arrays import ColorImage
from armsight.errors import RecordingError
from armsight.motion.face import (
    ArrowMark,
    Button,
    Color,
    Curve,
    EllipsoidMark,
    Face,
    Figure,
    FrameMark,
    Mark,
    Picture,
    PointsMark,
    RegionMark,
    ShownFace,
)
from armsight.recording import messages
from armsight.recording.markers import DELETE_ALL, marker
from armsight.recording.messages import (
    MARKERS,
    encode,
    header,
    make,
    point_message,
    pose_message,
    pose_of,
    stamp_of,
)

FACE_TOPIC = "/task/face"
MARKS_TOPIC = "/task/marks"
CURVES = "/task/curve/"
PICTURES = "/task/picture/"
QUALITY = 90
"""Of recorded pictures, as JPEG has it."""

_CUBE, _BALL, _ARROW, _LINES, _BALLS = 1, 2, 0, 5, 7
_KINDS = {
    PointsMark: _BALLS,
    ArrowMark: _ARROW,
    FrameMark: _LINES,
    EllipsoidMark: _BALL,
    RegionMark: _CUBE,
}
_AXES = ((1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0), (0.2, 0.4, 1.0, 1.0))


def topic_of(prefix: str, name: str) -> str:
    """A topic for a part of a face; ROS allows letters, digits and underscores."""
    return prefix + (re.sub(r"[^A-Za-z0-9_]", "_", name) or "_")


def encode_face(shown: ShownFace) -> bytes:
    """DiagnosticArray of the words of a face, one entry a figure, curve and button."""
    face = shown.face
    values = {"task": shown.task, "state": face.state}
    values |= {f"figure/{f.name}": f"{float(f.value)!r} {f.unit}" for f in face.figures}
    values |= {f"curve/{c.name}": f"{float(c.value)!r} {c.unit}" for c in face.curves}
    values |= {
        f"button/{b.name}": f"{'on' if b.enabled else 'off'} {b.label}" for b in face.buttons
    }
    values |= {f"picture/{p.name}": topic_of(PICTURES, p.name) for p in face.pictures}
    return messages.encode_diagnostics([(0, "task", face.reason, values)], shown.stamp)


def encode_marks(marks: Sequence[Mark], stamp: float) -> bytes:
    """MarkerArray of the marks, each with its name as text; those of before are cleared."""
    cleared = marker(0, stamp, "base", action=DELETE_ALL)
    drawn = [_marker_of(i, mark, stamp) for i, mark in enumerate(marks)]
    return encode(make(MARKERS, markers=[cleared, *drawn]))


def encode_picture(picture: Picture, stamp: float) -> bytes:
    """CompressedImage of a picture; its frame is its name."""
    shown = cv2.cvtColor(np.ascontiguousarray(picture.image), cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise RecordingError(f"picture {picture.name} cannot be encoded")
    return encode(
        make(
            messages.COMPRESSED,
            header=header(stamp, picture.name),
            format="jpeg",
            data=np.asarray(data, np.uint8).reshape(-1),
        )
    )


class FaceReader:
    """Puts faces together again from the messages of a recording, in the order of time."""

    def __init__(self, shift: float) -> None:
        self._shift = shift
        self._marks: tuple[Mark, ...] = ()
        self._images: dict[str, ColorImage] = {}

    @staticmethod
    def wants(topic: str) -> bool:
        """Whether a topic belongs to a face."""
        return topic in (FACE_TOPIC, MARKS_TOPIC) or topic.startswith(PICTURES)

    def take(self, topic: str, message: Any) -> ShownFace | None:
        """The face that a message completes, if any."""
        if topic == MARKS_TOPIC:
            self._marks = decode_marks(message)
        elif topic.startswith(PICTURES):
            image = decode_picture(message)
            if image is not None:
                self._images[message.header.frame_id] = image
        else:
            return self._face(message)
        return None

    def _face(self, message: Any) -> ShownFace | None:
        _, reason, values = messages.decode_diagnostics(message).get("task", (0, "", {}))
        if "task" not in values:
            return None
        pictures = [
            Picture(name, self._images[name])
            for name in _named(values, "picture/")
            if name in self._images
        ]
        face = Face(
            values.get("state", ""),
            reason,
            tuple(Figure(n, *_quantity(v)) for n, v in _named(values, "figure/").items()),
            tuple(Curve(n, *_quantity(v)) for n, v in _named(values, "curve/").items()),
            tuple(pictures),
            self._marks,
            tuple(
                Button(n, v.partition(" ")[2], v.startswith("on "))
                for n, v in _named(values, "button/").items()
            ),
        )
        return ShownFace(values["task"], stamp_of(message) - self._shift, face)


def decode_marks(message: Any) -> tuple[Mark, ...]:
    """The marks of a MarkerArray; markers of other kinds are passed over."""
    found = []
    for one in message.markers:
        make_mark = _READERS.get(int(one.type))
        if int(one.action) == DELETE_ALL or make_mark is None:
            continue
        found.append(make_mark(one))
    return tuple(found)


def decode_picture(message: Any) -> ColorImage | None:
    """(h, w, 3) RGB of a CompressedImage; None where it is damaged."""
    image = pictures.decode_picture(message.data, cv2.IMREAD_COLOR)
    return None if image is None else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def _marker_of(number: int, mark: Mark, stamp: float) -> Any:
    kind: dict[str, Any] = {"kind": _KINDS[type(mark)], "text": mark.name}
    if isinstance(mark, PointsMark):
        kind |= {
            "scale": (2.0 * mark.radius,) * 3,
            "color": _rgba(mark.color),
            "points": [point_message(p) for p in np.asarray(mark.points, float)],
        }
    elif isinstance(mark, ArrowMark):
        kind |= {
            "scale": (0.012, 0.03, 0.035),  # shaft, head, length of the head [m]
            "color": _rgba(mark.color),
            "points": [point_message(mark.start), point_message(mark.end)],
        }
    elif isinstance(mark, FrameMark):
        ends = [corner for axis in np.eye(3) * mark.length for corner in (np.zeros(3), axis)]
        kind |= {
            "pose": pose_message(mark.T_base_mark),
            "scale": (0.04 * mark.length, 0.0, 0.0),
            "color": (1.0, 1.0, 1.0, 1.0),
            "points": [point_message(p) for p in ends],
            "colors": [color for color in _AXES for _ in range(2)],
        }
    elif isinstance(mark, EllipsoidMark):
        a, b, c = (2.0 * np.asarray(mark.radii, float)).tolist()
        kind |= {
            "pose": pose_message(mark.T_base_mark),
            "scale": (a, b, c),
            "color": _rgba(mark.color, 0.4),
        }
    else:
        a, b, c = np.asarray(mark.size, float).tolist()
        kind |= {
            "pose": pose_message(mark.T_base_mark),
            "scale": (a, b, c),
            "color": _rgba(mark.color, 0.22),
        }
    return marker(number, stamp, "base", **kind)


def _read_points(one: Any) -> Mark:
    return PointsMark(one.text, _points(one), 0.5 * float(one.scale.x), _color(one))


def _read_arrow(one: Any) -> Mark:
    start, end = _points(one)[:2]
    return ArrowMark(one.text, start, end, _color(one))


def _read_frame(one: Any) -> Mark:
    return FrameMark(one.text, pose_of(one.pose), float(np.abs(_points(one)).max()))


def _read_ellipsoid(one: Any) -> Mark:
    return EllipsoidMark(one.text, pose_of(one.pose), 0.5 * _scale(one), _color(one))


def _read_region(one: Any) -> Mark:
    return RegionMark(one.text, pose_of(one.pose), _scale(one), _color(one))


_READERS: Mapping[int, Callable[[Any], Mark]] = {
    _BALLS: _read_points,
    _ARROW: _read_arrow,
    _LINES: _read_frame,
    _BALL: _read_ellipsoid,
    _CUBE: _read_region,
}


def _points(one: Any) -> Any:
    return np.array([[p.x, p.y, p.z] for p in one.points], float).reshape(-1, 3)


def _scale(one: Any) -> Any:
    return np.array([one.scale.x, one.scale.y, one.scale.z], float)


def _rgba(color: Color, alpha: float = 1.0) -> tuple[float, float, float, float]:
    red, green, blue = (value / 255.0 for value in color)
    return (red, green, blue, alpha)


def _color(one: Any) -> Color:
    return (round(255 * one.color.r), round(255 * one.color.g), round(255 * one.color.b))


def _named(values: Mapping[str, str], prefix: str) -> dict[str, str]:
    return {k.removeprefix(prefix): v for k, v in values.items() if k.startswith(prefix)}


def _quantity(text: str) -> tuple[float, str]:
    number, _, unit = text.partition(" ")
    try:
        return float(number), unit
    except ValueError:
        return float("nan"), unit
