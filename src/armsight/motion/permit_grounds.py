"""What of a target's own course, and of the map, speaks for or against touching it."""

from __future__ import annotations

import math

import numpy as np

from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.mapping.tracked import SURE
from armsight.motion.permits import PermitRequest, region_refusal
from armsight.motion.permitted import outside_the_map, somebody_beside
from armsight.motion.regions import Region

JUMP = 0.03
"""A target cannot be farther than this [m], beyond what is unsure, from where it was expected."""


def followed(request: PermitRequest, now: float) -> Region | None:
    """The region of a well-formed request, if it may be touched at all."""
    refused = region_refusal(request.region, request.kind, now)
    return None if refused else request.region


def jump(before: Region, now: Region) -> float:
    """How far [m] a target is from where it was expected; 0 where that may be."""
    when = now.exposure
    away = float(np.linalg.norm(now.center(when) - before.center(when)))
    unsure = SURE * (before.deviation(when) + now.deviation(when))
    return away if away > JUMP + unsure else 0.0


def seen_against(snapshot: WorkspaceSnapshot, region: Region, kind: str) -> str:
    """What of the map speaks against touching something, in words; empty when nothing does."""
    if not math.isfinite(snapshot.stamp):
        return "no camera has sent a picture yet"
    if outside_the_map(snapshot, region):
        return "its region leaves the mapped box: nobody is looked for there"
    return somebody_beside(snapshot, region) if kind == "thing" else ""
