"""What the pictures themselves tell: repeated, blurred, unreadable ones, boards in none."""

from __future__ import annotations

import numpy as np

from armsight.calibration.findings import Finding, names_of
from armsight.calibration.recorded_set import RecordedCamera, RecordedSet

BLURRED = 0.55
"""Edges less steep than this share of the usual [1]."""


def picture_findings(recorded: RecordedSet) -> list[Finding]:
    """What is odd about the pictures of a set."""
    out: list[Finding] = []
    for camera in recorded.cameras:
        out += _missed(camera)
        out += _blurred(camera)
        out += _repeated(camera, recorded)
    return out


def _missed(camera: RecordedCamera) -> list[Finding]:
    lost = [(n, m) for n, m in zip(camera.seen.names, camera.seen.misses) if m]
    if not lost:
        return []
    reasons: dict[str, list[str]] = {}
    for name, why in lost:
        reasons.setdefault(why, []).append(name)
    words = "; ".join(f"{why}: {names_of(names)}" for why, names in list(reasons.items())[:4])
    total = len(lost) + sum(d is not None for d in camera.seen.detections)
    return [
        Finding(
            "unseen",
            "warning" if len(lost) > 0.5 * total else "note",
            f"no board in {len(lost)} of {total} pictures of {camera.name} ({words})",
            "leave them out, or improve light and focus",
        )
    ]


def _blurred(camera: RecordedCamera) -> list[Finding]:
    sharp = camera.seen.sharpness
    known = np.isfinite(sharp)
    if known.sum() < 5:
        return []
    usual = float(np.median(sharp[known]))
    bad = [n for n, s in zip(camera.seen.names, sharp) if s < BLURRED * usual]
    if not bad or len(bad) > 0.3 * known.sum():
        return []
    return [
        Finding(
            "blurred",
            "warning",
            f"{names_of(bad)}: blurred (edges half as steep as usual)",
            "leave it out; let the arm rest for 0.3 s, and light the board",
        )
    ]


def _repeated(camera: RecordedCamera, recorded: RecordedSet) -> list[Finding]:
    """The same picture, or the same corners to the last digit, more than once."""
    pairs = [(first, again) for again, first in camera.seen.repeated().items()]
    if not pairs:
        return []
    names = [f"{camera.seen.names[b]} as {camera.seen.names[a]}" for a, b in pairs]
    other = 0
    if recorded.poses is not None:
        for a, b in pairs:
            va, vb = camera.view[a], camera.view[b]
            if va >= 0 and vb >= 0:
                gap = recorded.poses[va][:3, 3] - recorded.poses[vb][:3, 3]
                other += bool(np.linalg.norm(gap) > 1e-3)
    words = f", although the poses differ in {other}" if other else ""
    return [
        Finding(
            "repeated",
            "warning",
            f"{names_of(names)}: the same picture again{words}",
            "leave repeated pictures out: a camera that hangs gives its last picture again",
        )
    ]
