"""Puts what was found into the text of a calibration file; what else stands there is kept.

Entries of cameras that were not calibrated now stay as they are, and so do comments.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import AoT, Table

from armsight.arrays import Floats, Pose
from armsight.devices.depth_model import DepthModel
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import to_quaternion
from armsight.workcell.calibration_file.reading import mount_pose, parse_calibration
from armsight.workcell.calibration_file.schema import (
    CalibratedArm,
    CalibratedBoard,
    CalibratedCamera,
    CalibratedCell,
    CalibratedPlug,
    CalibratedStereo,
    CellCalibration,
)
from armsight.workcell.schema import Workcell
from armsight.workcell.schema_devices import CameraSection, PlugSection, StereoSection
from armsight.workcell.schema_things import BoardSection

HEADER = (
    "What this cell believes of its cameras, written by `armsight calibrate`.",
    "Poses are in the robot's base (or flange), metres; docs/calibration.md explains every key.",
)
FIRST = ("name", "model", "mount", "calibrated", "source", "target_error")
"""A camera's keys begin with these."""


def camera_entry(
    workcell: Workcell,
    section: CameraSection,
    T_mount_camera: Pose,
    covariance: Floats,
    depth_lens: PinholeCamera,
    color_lens: PinholeCamera | None,
    T_depth_color: Pose,
    depth_model: DepthModel | None,
    *,
    source: str,
    target_error: float | None = None,
    now: datetime | None = None,
    model: str | None = None,
) -> CalibratedCamera:
    """A camera's entry from what was found.

    Args:
        workcell: the cell.
        section: the camera's own.
        T_mount_camera: depth lens in base or flange.
        covariance: (6, 6) of it, in its own axes.
        depth_lens: at the depth image's resolution.
        color_lens: the colour lens, or None.
        T_depth_color: colour lens in the depth lens's frame.
        depth_model: of its depth, or None.
        source: from what, for people.
        target_error: expected error of a point 1.0-1.5 m away [m].
        now: when; this moment if None.
        model: of the camera, where the workcell file names none.

    Raises:
        ValueError: it is no calibration that could be (pydantic's error names the key).
    """
    depths: dict[str, Any] | None = None
    if depth_model is not None:
        depths = {
            "offset": float(depth_model.offset),
            "scale": float(depth_model.scale) if depth_model.scale_known else 0.0,
            "middle": float(depth_model.middle),
            "knots": tuple(float(v) for v in depth_model.knots),
            "values": tuple(float(v) for v in depth_model.values),
            "surface": tuple(float(v) for v in depth_model.surface),
            "range": tuple(float(v) for v in depth_model.range),
            "rms": float(depth_model.rms),
        }
    color = None if color_lens is None else {**_lens(color_lens), **_placed(T_depth_color)}
    return CalibratedCamera.model_validate(
        {
            "name": section.name,
            "model": section.model or model,
            "mount": "base" if section.mounted_on == "world" else "flange",
            "calibrated": _moment(now),
            "source": source,
            "target_error": target_error,
            **_placed(T_mount_camera),
            **_measured(covariance, mount_pose(workcell, section)),
            "depth_lens": _lens(depth_lens),
            "color_lens": color,
            "depth_model": depths,
        }
    )


def stereo_entry(
    workcell: Workcell,
    section: StereoSection,
    T_mount_camera: Pose,
    covariance: Floats,
    *,
    model: str,
    source: str,
    now: datetime | None = None,
) -> CalibratedStereo:
    """A stereo pair's entry: its left lens in base or flange, (6, 6) covariance in its own axes."""
    return CalibratedStereo.model_validate(
        {
            "name": section.name,
            "model": section.model or model,
            "mount": "base" if section.mounted_on == "world" else "flange",
            "calibrated": _moment(now),
            "source": source,
            **_placed(T_mount_camera),
            **_measured(covariance, mount_pose(workcell, section)),
        }
    )


def plug_entry(
    section: PlugSection,
    T_flange_plug: Pose,
    covariance: Floats,
    T_flange_declared: Pose,
    *,
    source: str,
    tip_error: float | None = None,
    now: datetime | None = None,
) -> CalibratedPlug:
    """The plug's entry.

    Args:
        section: of the cell.
        T_flange_plug: where its mount holds it.
        covariance: (6, 6) of that, in the plug's axes.
        T_flange_declared: where its tool has the tip.
        source: from what, for people.
        tip_error: expected error of the tip against what the pair sees [m].
        now: when; this moment if None.
    """
    return CalibratedPlug.model_validate(
        {
            "kind": section.kind,
            "calibrated": _moment(now),
            "source": source,
            "tip_error": tip_error,
            **_placed(T_flange_plug),
            **_measured(covariance, T_flange_declared),
        }
    )


def arm_entry(
    joint_offset: Floats, origin_shift: Floats, *, source: str, now: datetime | None = None
) -> CalibratedArm:
    """The arm's entry: (n,) offsets [rad] and (n, 3) shifts of the joints' origins [m]."""
    return CalibratedArm.model_validate(
        {
            "calibrated": _moment(now),
            "source": source,
            "joint_offset_deg": tuple(float(v) for v in np.rad2deg(joint_offset)),
            "origin_shift": tuple(tuple(float(v) for v in row) for row in origin_shift),
        }
    )


def board_entry(
    section: BoardSection, T_mount_middle: Pose, *, source: str, now: datetime | None = None
) -> CalibratedBoard:
    """The board's entry: where the middle of its corners hangs, in flange or world."""
    return CalibratedBoard.model_validate(
        {
            "mounted_on": section.mounted_on,
            "calibrated": _moment(now),
            "source": source,
            **_placed(T_mount_middle),
            "declared": _placed(section.pose),
        }
    )


def updated(
    text: str,
    workcell: Workcell,
    cameras: Sequence[CalibratedCamera],
    arm: CalibratedArm | None = None,
    file: str = "cell.calibration.toml",
    board: CalibratedBoard | None = None,
    stereo: Sequence[CalibratedStereo] = (),
    plug: CalibratedPlug | None = None,
) -> str:
    """The text of a calibration file with new entries in it.

    Args:
        text: of the file as it is; empty for a new one. One of another cell is begun anew.
        workcell: whose calibration it is.
        cameras: those that were found.
        arm: its errors, where they were found.
        file: how errors name it.
        board: where it hangs, where that was found.
        stereo: pairs that were found.
        plug: where it sits, where that was found.

    Raises:
        WorkcellError: ``text`` is broken; nothing of it can be kept, so nothing is written.
    """
    document = tomlkit.document()
    if text.strip():
        old = parse_calibration(text, file)
        if (old.cell.name, old.cell.robot) == (workcell.name, workcell.robot.model):
            document = tomlkit.parse(text)
    if "cell" not in document:
        for line in HEADER:
            document.add(tomlkit.comment(line))
        document.add(tomlkit.nl())
        cell = CalibratedCell(name=workcell.name, robot=workcell.robot.model)
        document["cell"] = _table(cell.model_dump(exclude_none=True))
    if arm is not None:
        _put(document, "arm", arm.model_dump(exclude_none=True))
    if board is not None:
        _put(document, "board", board.model_dump(exclude_none=True))
    if plug is not None:
        _put(document, "plug", plug.model_dump(exclude_none=True))
    _entries(document, "camera", cameras, {c.name for c in workcell.camera})
    _entries(document, "stereo", stereo, {c.name for c in workcell.stereo})
    out = re.sub(r"(?<!\n)\n(?=\[)", "\n\n", tomlkit.dumps(document))
    CellCalibration.model_validate(tomlkit.parse(out).unwrap())  # never write what we would refuse
    return out


def _entries(
    document: tomlkit.TOMLDocument,
    name: str,
    found: Sequence[CalibratedCamera] | Sequence[CalibratedStereo],
    known: set[str],
) -> None:
    """What was found by name; entries of what the cell no longer has go."""
    if name not in document:
        if not found:
            return
        document[name] = tomlkit.aot()
    entries = document[name]
    assert isinstance(entries, AoT)
    for i in range(len(entries) - 1, -1, -1):
        if entries[i].get("name") not in known:
            del entries[i]
    for one in found:
        values = one.model_dump(exclude_none=True)
        values = {k: values[k] for k in (*FIRST, *values) if k in values}
        entry = next((e for e in entries if e.get("name") == one.name), None)
        if entry is None:
            entries.append(_table(values))
        else:
            _renew(entry, values)


def _renew(table: Any, values: dict[str, Any]) -> None:
    """Every value anew, one by one, so that comments beside them stay."""
    for name in [k for k in table if k not in values]:
        del table[name]
    for name, value in values.items():
        _put(table, name, value)


def _put(table: Any, name: str, value: Any) -> None:
    if isinstance(value, dict) and isinstance(table.get(name), Table):
        _renew(table[name], value)
    elif isinstance(value, dict):
        table[name] = _table(value)
    else:
        table[name] = _item(value)


def _table(values: dict[str, Any]) -> Table:
    table = tomlkit.table()
    for name, value in values.items():
        table[name] = _table(value) if isinstance(value, dict) else _item(value)
    return table


def _item(value: Any) -> Any:
    """Numbers to a precision far below any sensor's; a matrix with a row a line."""
    if isinstance(value, tuple) and value and isinstance(value[0], tuple):
        rows = tomlkit.array()
        for row in value:
            rows.append(_item(row))
        return rows.multiline(True)
    if isinstance(value, tuple):
        array = tomlkit.array()
        for v in value:
            array.append(_number(v))
        return array
    return _number(value)


def _number(value: Any) -> Any:
    return float(f"{value:.12g}") if isinstance(value, float) else value


def _placed(T: Pose) -> dict[str, Any]:
    return {
        "position": tuple(float(v) for v in T[:3, 3]),
        "quaternion_xyzw": tuple(float(v) for v in to_quaternion(T)),
    }


def _measured(covariance: Floats, T_declared: Pose) -> dict[str, Any]:
    C = 0.5 * (covariance + covariance.T)
    return {
        "covariance": tuple(tuple(float(v) for v in row) for row in C),
        "declared": _placed(T_declared),
    }


def _lens(lens: PinholeCamera) -> dict[str, Any]:
    return {
        "width": int(lens.width),
        "height": int(lens.height),
        "fx": float(lens.fx),
        "fy": float(lens.fy),
        "cx": float(lens.cx),
        "cy": float(lens.cy),
        "distortion": tuple(float(v) for v in lens.distortion),
    }


def _moment(now: datetime | None) -> datetime:
    return (now if now is not None else datetime.now(UTC)).replace(microsecond=0)
