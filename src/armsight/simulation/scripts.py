"""Built-in things that a person does, each a smooth function of time made into samples.

A script's frame: the person starts at its origin on the floor, looking along x, left along y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Vector3
from armsight.errors import UsageError
from armsight.simulation.legs import add_legs
from armsight.simulation.motion import RATE, smooth_step
from armsight.simulation.skeleton import INDEX, Proportions, bend, standing

UPPER = [i for name, i in INDEX.items() if not name.endswith(("hip", "knee", "ankle", "toe"))]
"""Joints above the legs."""
MAX_LEAN = np.deg2rad(40.0)
"""How far a person bends forward to reach [rad]."""


@dataclass(frozen=True)
class ScriptOptions:
    """What a script may be told.

    Attributes:
        period: seconds of one round [s].
        target: (3,) where the hand goes, in the script's frame [m].
        distance: how far a walk goes [m].
        proportions: of the person.
    """

    period: float
    target: Vector3
    distance: float
    proportions: Proportions


Script = Callable[[Floats, ScriptOptions], Floats]
"""(k,) times within one round [s] to (k, 19, 3) joints in the script's frame [m], legs unset."""


def script_joints(name: str, options: ScriptOptions) -> Floats:
    """(k, 19, 3) joints of one round at :data:`motion.RATE`, in the script's frame [m].

    Raises:
        UsageError: there is no such script; names those that there are.
    """
    try:
        script = SCRIPTS[name]
    except KeyError:
        known = ", ".join(sorted(SCRIPTS))
        raise UsageError(f"no person's script '{name}'; choose one of {known}") from None
    times = np.arange(0.0, options.period + 0.5 / RATE, 1.0 / RATE)
    joints = script(times, options)
    add_legs(joints, options.proportions)
    return joints


def reach(joints: Floats, side: str, target: Floats, p: Proportions) -> None:
    """Bring a hand to (k, 3) ``target``: lean from the pelvis if needed, then bend the elbow.

    Changes (k, 19, 3) ``joints`` in place. What is out of reach is reached for.
    """
    sign = 1.0 if side == "left" else -1.0
    shoulder = joints[:, INDEX[f"{side}_shoulder"]]
    missing = np.linalg.norm(target - shoulder, axis=1) - 0.92 * (p.upper_arm + p.forearm + p.hand)
    pelvis = joints[:, INDEX["pelvis"]].copy()
    angle = np.clip(missing / (0.8 * p.trunk), 0.0, 1.0) * MAX_LEAN
    flat = (target - pelvis) * np.array([1.0, 1.0, 0.0])
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
    _lean(joints, pelvis, flat, angle)
    shoulder = joints[:, INDEX[f"{side}_shoulder"]]
    left = joints[:, INDEX["left_shoulder"]] - joints[:, INDEX["right_shoulder"]]
    outward = sign * 0.6 * left / np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-9)
    reach_axis = target - shoulder
    reach_axis /= np.maximum(np.linalg.norm(reach_axis, axis=1, keepdims=True), 1e-9)
    wrist = target - p.hand * reach_axis
    down = np.array([0.0, 0.0, -1.0])
    elbow, wrist = bend(shoulder, wrist, p.upper_arm, p.forearm, outward + down)
    joints[:, INDEX[f"{side}_elbow"]] = elbow
    joints[:, INDEX[f"{side}_wrist"]] = wrist
    joints[:, INDEX[f"{side}_hand"]] = wrist + p.hand * reach_axis


def _stand(times: Floats, o: ScriptOptions) -> Floats:
    """Upright, breathing and shifting weight a little."""
    joints = np.repeat(standing(o.proportions)[None], len(times), axis=0)
    phase = 2.0 * np.pi * times / o.period
    joints[:, UPPER, 1] += 0.012 * np.sin(phase)[:, None]
    joints[:, UPPER, 0] += 0.006 * np.sin(2.0 * phase)[:, None]
    return np.asarray(joints)


def _reach_in(times: Floats, o: ScriptOptions) -> Floats:
    """Reach to the target, stay there shortly, withdraw, wait."""
    return _reaching(times, o, reach_s=0.9, hold_s=1.0)


def _reach_and_hold(times: Floats, o: ScriptOptions) -> Floats:
    """Reach to the target and stay there for half the period."""
    return _reaching(times, o, reach_s=1.2, hold_s=0.5 * o.period)


def _wave(times: Floats, o: ScriptOptions) -> Floats:
    """Reach to the target and move the hand from side to side there."""
    joints = _stand(times, o)
    rest = joints[:, INDEX["right_hand"]].copy()
    w = _there_and_back(times, 1.0, o.period - 3.0)
    swing = np.zeros((len(times), 3))
    swing[:, 1] = 0.22 * w * np.sin(2.0 * np.pi * (times - 1.0) / 1.6)
    reach(joints, "right", rest + w[:, None] * (o.target - rest) + swing, o.proportions)
    return joints


def _work(times: Floats, o: ScriptOptions) -> Floats:
    """Both hands busy about the target, as at a bench."""
    joints = _stand(times, o)
    turn = 2.0 * np.pi * times / o.period
    for side, sign in (("left", 1.0), ("right", -1.0)):
        offset = np.stack(
            [
                0.10 * np.sin(3.0 * turn + sign),
                sign * 0.16 + 0.10 * np.sin(5.0 * turn + 2.0 * sign),
                0.05 * (1.0 + np.sin(7.0 * turn)),
            ],
            axis=1,
        )
        reach(joints, side, o.target + offset, o.proportions)
    return joints


def _walk_by(times: Floats, o: ScriptOptions) -> Floats:
    """Walk straight ahead for the distance, turn round, walk back."""
    half = 0.5 * o.period
    out = smooth_step(times / (0.8 * half))
    back = smooth_step((times - half) / (0.8 * half))
    turning = smooth_step((times - 0.8 * half) / (0.2 * half))
    turning_back = smooth_step((times - 1.8 * half) / (0.2 * half))
    return _walking(times, o, o.distance * (out - back), np.pi * (turning + turning_back))


def _walk_in(times: Floats, o: ScriptOptions) -> Floats:
    """Walk up, reach to the target, withdraw, walk backwards to the start."""
    leg = 0.25 * o.period
    away = smooth_step(times / leg) - smooth_step((times - 2.6 * leg) / leg)
    joints = _walking(times, o, o.distance * away, np.zeros_like(times))
    rest = joints[:, INDEX["right_hand"]].copy()
    w = _there_and_back(times - leg, 0.9, 1.6 * leg - 1.8)
    ahead = o.target + np.array([o.distance, 0.0, 0.0])
    reach(joints, "right", rest + w[:, None] * (ahead - rest), o.proportions)
    return joints


SCRIPTS: dict[str, Script] = {
    "stand": _stand,
    "reach_in": _reach_in,
    "reach_and_hold": _reach_and_hold,
    "wave": _wave,
    "work": _work,
    "walk_by": _walk_by,
    "walk_in": _walk_in,
}
"""All scripts by name."""


def _reaching(times: Floats, o: ScriptOptions, reach_s: float, hold_s: float) -> Floats:
    joints = _stand(times, o)
    rest = joints[:, INDEX["right_hand"]].copy()
    w = _there_and_back(times, reach_s, hold_s)[:, None]
    path = rest + w * (o.target - rest)
    path[:, 2] += 0.10 * (4.0 * w * (1.0 - w))[:, 0]  # over an edge, not through it
    reach(joints, "right", path, o.proportions)
    return joints


def _there_and_back(times: Floats, reach_s: float, hold_s: float) -> Floats:
    there = smooth_step(times / reach_s)
    return np.asarray(there - smooth_step((times - reach_s - hold_s) / reach_s))


def _walking(times: Floats, o: ScriptOptions, ahead: Floats, yaw: Floats) -> Floats:
    p = o.proportions
    joints = np.repeat(standing(p)[None], len(times), axis=0)
    pace = np.gradient(ahead, times)
    joints[:, :, 2] -= 0.035 * np.minimum(np.abs(pace), 1.2)[:, None]
    swing = 0.16 * np.tanh(pace) * np.sin(2.0 * np.pi * ahead / 1.3)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for joint, share in (("elbow", 0.5), ("wrist", 1.0), ("hand", 1.15)):
            joints[:, INDEX[f"{side}_{joint}"], 0] += sign * share * swing
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, y = joints[..., 0].copy(), joints[..., 1].copy()
    joints[..., 0], joints[..., 1] = c * x - s * y, s * x + c * y
    joints[..., 0] += ahead[:, None]
    return np.asarray(joints)


def _lean(joints: Floats, pelvis: Floats, direction: Floats, angle: Floats) -> None:
    """Turn the upper body about the pelvis towards (k, 3) flat directions by (k,) angles [rad]."""
    axis = np.stack([-direction[:, 1], direction[:, 0], np.zeros(len(angle))], axis=1)[:, None, :]
    v = joints[:, UPPER] - pelvis[:, None, :]
    c, s = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    along = np.sum(v * axis, axis=2, keepdims=True)
    turned = v * c + np.cross(np.broadcast_to(axis, v.shape), v) * s + axis * along * (1.0 - c)
    joints[:, UPPER] = pelvis[:, None, :] + turned
