"""What the poses themselves tell: rounded numbers, rows that stand still while the board moves."""

from __future__ import annotations

import numpy as np

from armsight.calibration.findings import Finding, names_of
from armsight.calibration.recorded_set import RecordedCamera, RecordedSet


def pose_findings(recorded: RecordedSet) -> list[Finding]:
    """What is odd about the poses of a set."""
    out: list[Finding] = []
    for camera in recorded.cameras[:1]:
        out += _rounded(camera)
        out += _stale(camera, recorded)
    return out


def _rounded(camera: RecordedCamera) -> list[Finding]:
    """Rotations written with so few digits that the rounding is the largest error."""
    if camera.choice is None:
        return []
    reading = camera.choice.best.reading
    step = 10.0**-reading.table.decimals
    size = np.deg2rad(step) if reading.degrees else step
    if size < 5e-3:  # 0.3 degrees from step to step
        return []
    return [
        Finding(
            "rounded",
            "warning",
            f"{reading.table.source}: rotations are written with {reading.table.decimals} digits "
            f"after the point: off by up to {np.rad2deg(size):.1f} deg",
            "write six digits",
        )
    ]


def _stale(camera: RecordedCamera, recorded: RecordedSet) -> list[Finding]:
    """The same pose again although the board is elsewhere in the picture."""
    if recorded.poses is None:
        return []
    first: dict[bytes, int] = {}
    late: list[int] = []
    for k in np.argsort(camera.view, kind="stable"):
        d, view = camera.seen.detections[k], camera.view[k]
        if d is None or view < 0:
            continue
        key = recorded.poses[view].tobytes()
        before = first.setdefault(key, int(k))
        other = camera.seen.detections[before]
        if before == k or other is None or camera.view[before] == view:
            continue
        both, a, b = np.intersect1d(d.corner, other.corner, return_indices=True)
        if len(both) and np.median(np.linalg.norm(d.pixel[a] - other.pixel[b], axis=1)) > 5.0:
            late.append(int(k))
    if not late:
        return []
    return [
        Finding(
            "stale_pose",
            "warning",
            f"{names_of([camera.seen.names[k] for k in late])}: the same pose as before, to the "
            "last digit, although the board has moved in the picture",
            "read the pose after the arm has come to rest; take these views out",
        )
    ]
