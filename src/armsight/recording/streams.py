"""The table of streams: every kind of reading, its topics, its ROS 2 types, the way there and back.

A new kind of reading is one row here; sensing, recorder and replay know no kind by name.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, cast

import numpy as np

from armsight.devices.data import (
    ArmMode,
    ArmStatus,
    DeclaredSolids,
    EmptyCell,
    GripperState,
    JointState,
    Wrench,
)
from armsight.geometry.shapes import Solid
from armsight.recording import messages
from armsight.recording.codec import Decoding, Known, Message, Stream
from armsight.recording.messages import encode, header, make, stamp_of, vector_message
from armsight.recording.picture_streams import RGBD, STEREO

JOINTS_TOPIC = "/joint_states"
ARM_TOPIC = "/arm/status"
WRENCH_TOPIC = "/wrench"
GRIPPER_TOPIC = "/gripper/status"
EMPTY_TOPIC = "/cell/empty"
SOLIDS_TOPIC = "/cell/solids"


def _one(
    reading: type,
    topic: str,
    kind: str,
    write: Callable[[Any], bytes],
    read: Callable[[Any], Any],
) -> Stream:
    """The row of a reading that is one message on one topic."""

    def encode_one(value: Any, known: Known) -> Iterable[Message]:
        return (Message(topic, kind, write(value), value.stamp),)

    def decode_one(_topic: str, message: Any, record: Any, memory: Decoding) -> Any:
        value = read(message)
        return None if value is None else replace(value, stamp=value.stamp - memory.shift)

    return Stream(reading, lambda layout: (topic,), encode_one, decode_one)


def _encode_joints(state: JointState, known: Known) -> Iterable[Message]:
    data = messages.encode_joint_state(state, known.joint_names)
    return (Message(JOINTS_TOPIC, messages.JOINT_STATE, data, state.stamp),)


def _decode_joints(topic: str, message: Any, record: Any, memory: Decoding) -> JointState | None:
    state = messages.decode_joint_state(message, memory.joint_names)
    return None if state is None else replace(state, stamp=state.stamp - memory.shift)


def _arm_to_bytes(status: ArmStatus) -> bytes:
    level = 0 if status.obeys else 2
    values = {"mode": status.mode, "speed": repr(float(status.speed))}
    return messages.encode_diagnostics([(level, "arm", status.message, values)], status.stamp)


def _arm_from_message(message: Any) -> ArmStatus | None:
    _, text, values = messages.decode_diagnostics(message).get("arm", (0, "", {}))
    try:
        return ArmStatus(
            stamp_of(message), cast(ArmMode, values["mode"]), float(values["speed"]), text
        )
    except (KeyError, ValueError):
        return None


def _wrench_to_bytes(wrench: Wrench) -> bytes:
    return encode(
        make(
            messages.WRENCH,
            header=header(wrench.stamp, "flange"),
            wrench=make(
                "geometry_msgs/msg/Wrench",
                force=vector_message(wrench.force),
                torque=vector_message(wrench.torque),
            ),
        )
    )


def _wrench_from_message(message: Any) -> Wrench:
    force, torque = message.wrench.force, message.wrench.torque
    return Wrench(
        stamp_of(message),
        np.array([force.x, force.y, force.z]),
        np.array([torque.x, torque.y, torque.z]),
    )


def _gripper_to_bytes(state: GripperState) -> bytes:
    values = {
        "width": repr(float(state.width)),
        "moving": str(state.moving),
        "holding": str(state.holding),
    }
    return messages.encode_diagnostics([(0, "gripper", "", values)], state.stamp)


def _gripper_from_message(message: Any) -> GripperState | None:
    _, _, values = messages.decode_diagnostics(message).get("gripper", (0, "", {}))
    try:
        holding = {"True": True, "False": False}.get(values["holding"])
        return GripperState(
            stamp_of(message), float(values["width"]), values["moving"] == "True", holding
        )
    except (KeyError, ValueError):
        return None


def _word_to_bytes(word: EmptyCell) -> bytes:
    return messages.encode_diagnostics([(0, "cell", "nobody is in the cell", {})], word.stamp)


def _word_from_message(message: Any) -> EmptyCell | None:
    said = "cell" in messages.decode_diagnostics(message)
    return EmptyCell(stamp_of(message)) if said else None


def _solids_to_bytes(word: DeclaredSolids) -> bytes:
    rows = {
        str(i): json.dumps(
            [s.name, s.kind, list(s.size), np.asarray(s.T_frame_solid).tolist(), *_look(s)]
        )
        for i, s in enumerate(word.solids)
    }
    return messages.encode_diagnostics([(0, "solids", word.name, rows)], word.stamp)


def _look(solid: Solid) -> tuple[list[float], str, float]:
    return list(solid.color), solid.material, solid.coarse


def _solids_from_message(message: Any) -> DeclaredSolids | None:
    _, name, rows = messages.decode_diagnostics(message).get("solids", (0, "", {}))
    try:
        solids = tuple(
            Solid(label, kind, (size[0], size[1], size[2]), np.array(T, float), tuple(color), *look)
            for label, kind, size, T, color, *look in (json.loads(rows[key]) for key in rows)
        )
    except (ValueError, TypeError, IndexError):
        return None
    return DeclaredSolids(stamp_of(message), name, solids) if name else None


STREAMS: tuple[Stream, ...] = (
    Stream(
        JointState,
        lambda layout: (layout.joints,) if layout.joints else (),
        _encode_joints,
        _decode_joints,
    ),
    RGBD,
    STEREO,
    _one(ArmStatus, ARM_TOPIC, messages.DIAGNOSTICS, _arm_to_bytes, _arm_from_message),
    _one(Wrench, WRENCH_TOPIC, messages.WRENCH, _wrench_to_bytes, _wrench_from_message),
    _one(
        GripperState,
        GRIPPER_TOPIC,
        messages.DIAGNOSTICS,
        _gripper_to_bytes,
        _gripper_from_message,
    ),
    _one(EmptyCell, EMPTY_TOPIC, messages.DIAGNOSTICS, _word_to_bytes, _word_from_message),
    _one(
        DeclaredSolids,
        SOLIDS_TOPIC,
        messages.DIAGNOSTICS,
        _solids_to_bytes,
        _solids_from_message,
    ),
)
"""Every row."""

BY_READING: dict[type, Stream] = {stream.reading: stream for stream in STREAMS}
"""The row of each kind of reading."""
