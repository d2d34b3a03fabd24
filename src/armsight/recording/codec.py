"""What a row of the table of streams is: a kind of reading, its topics, and the way there and back.

The table itself is :data:`armsight.recording.streams.STREAMS`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from armsight.arrays import ColorImage
from armsight.devices.data import RgbdCameraInfo, StereoInfo
from armsight.recording.layout import FrameTree, Layout


@dataclass(frozen=True)
class Message:
    """One message to be written.

    Attributes:
        topic: where; kind: ROS 2 type; data: CDR bytes.
        stamp: time of the reading [s].
        sequence: the reading's number, or 0.
    """

    topic: str
    kind: str
    data: bytes
    stamp: float
    sequence: int = 0


@dataclass(frozen=True)
class Known:
    """What codecs need to know.

    Attributes:
        joint_names: of the arm.
        cameras, stereo: of the cell, by name.
        small: pictures are compressed.
    """

    joint_names: tuple[str, ...]
    cameras: Mapping[str, RgbdCameraInfo]
    stereo: Mapping[str, StereoInfo]
    small: bool = False


@dataclass
class Decoding:
    """What has to be remembered between messages while a recording is read.

    Attributes:
        layout: which topics are what.
        joint_names: of the arm, in the order of joint vectors.
        shift: subtracted from every time [s].
        tree: newest transforms.
        moved: frames whose transforms were recorded while it ran.
        pictures: newest (stamp, picture) of a camera that waits for its fellow.
        counts: readings of a camera so far.
    """

    layout: Layout
    joint_names: tuple[str, ...]
    shift: float
    tree: FrameTree
    moved: set[str] = field(default_factory=set)
    pictures: dict[str, tuple[float, ColorImage]] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    def count(self, camera: str, given: int) -> int:
        """The number of a camera's next reading: the recorded one, or one more than the last."""
        self.counts[camera] = self.counts.get(camera, -1) + 1
        return given or self.counts[camera]


@dataclass(frozen=True)
class Stream:
    """One row of the table.

    Attributes:
        reading: type of the reading.
        topics: those of a recording that :attr:`decode` wants.
        encode: a reading becomes messages.
        decode: (topic, message, record, memory) becomes a reading, or None where more is to come.
        size: about how many bytes it takes while it waits for the disk.
    """

    reading: type
    topics: Callable[[Layout], Collection[str]]
    encode: Callable[[Any, Known], Iterable[Message]]
    decode: Callable[[str, Any, Any, Decoding], Any]
    size: Callable[[Any], int] = lambda reading: 256
