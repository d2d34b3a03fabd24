"""Simulated targets of visual servoing (V): ball, also in a hand, bulls-eye, smiley, gloved hand.

Each is a rigid thing of simple solids that moves on a path of its own or is led by the page. Its
frame is that of what is aimed at: the ball's centre (who holds it is along x); for the others the
middle of rings, mouth or palm with z out of the surface, towards who aims.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from armsight.arrays import Pose, Vector3
from armsight.geometry.pose import from_rpy, make_pose
from armsight.geometry.shapes import ShapeKind, Solid
from armsight.simulation.spec import MovingObjectSpec

TargetKind = Literal["ball", "held_ball", "bullseye", "smiley", "hand"]
RED, WHITE, BLACK = (0.80, 0.06, 0.07), (0.93, 0.93, 0.92), (0.06, 0.06, 0.07)
YELLOW, CARTON = (0.95, 0.80, 0.10), (0.62, 0.52, 0.40)
PINK, BLUE = (0.95, 0.30, 0.62), (0.08, 0.20, 0.75)
BALL_RADIUS = 0.04
"""Of the red ball [m]: V gives none; about a tennis ball."""
RINGS = (0.060, 0.045, 0.030, 0.015)
"""Radii of the bulls-eye's discs, red and white in turn, red outside [m]."""
FACE_RADIUS = 0.10
"""The smiley measures 20 cm (V)."""
MOUTH = (0.0, -0.045)
"""Middle of the mouth in the face, right and up of its centre [m]."""
PALM_RADIUS = 0.022
"""Of the blue disc on the palm [m]."""
_SHEET = 0.0004
"""How far each printed layer stands before the one behind it [m]."""


@dataclass(frozen=True)
class TargetSpec:
    """A target in the cell.

    Attributes:
        name: unique among what moves.
        kind: see the module.
        T_world_target: its pose at the start.
        path: ``free`` (the page leads it), ``circle`` or ``line`` as a moving object's, or
            ``wander``: smooth, seeded, within ``room`` of the start.
        center: of the circle or far end of the line [m]; period: of one round [s].
        speed: greatest speed of a wandering target [m/s]; room: (3,) half extent of its box [m].
        max_speed: when it is led [m/s].
        glossy: a shiny ball, which reflects lamps and little infrared.
        mass: [kg]; surface: stiffness of its surface [N/m], where contact pushes.
    """

    name: str
    kind: TargetKind
    T_world_target: Pose
    path: Literal["circle", "line", "free", "wander"] = "free"
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    period: float = 10.0
    speed: float = 0.2
    room: tuple[float, float, float] = (0.15, 0.25, 0.15)
    max_speed: float = 0.6
    glossy: bool = False
    mass: float = 0.2
    surface: float = 20e3


def target_object(spec: TargetSpec) -> MovingObjectSpec:
    """The moving object that a target is."""
    make = {
        "ball": _ball, "held_ball": _held_ball, "bullseye": _bullseye, "smiley": _smiley,
        "hand": _hand,
    }  # fmt: skip
    first, *others = make[spec.kind](spec)
    follow = None
    if spec.path == "wander":
        follow = partial(wander, spec.T_world_target[:3, 3], spec.room, spec.speed)
    return MovingObjectSpec(
        solid=first,
        path="free" if spec.path == "wander" else spec.path,
        center=spec.center,
        period=spec.period,
        max_speed=spec.max_speed,
        parts=tuple(others),
        follow=follow,
        mass=spec.mass,
        surface=spec.surface,
    )


def wander(
    start: Vector3, room: tuple[float, float, float], speed: float, rng: np.random.Generator
) -> Callable[[float], Vector3]:
    """A smooth seeded path about a point: sums of three sines an axis, at rest at time 0.

    Args:
        start: (3,) where it is at time 0 and goes round [m].
        room: half extents of the box that it keeps [m].
        speed: greatest speed [m/s].
        rng: draws the sines.

    Returns:
        (3,) position [m] at a time [s].
    """
    start = np.asarray(start, float)
    half = np.asarray(room, float)
    hertz = rng.uniform(0.07, 0.30, (3, 3))
    share = rng.dirichlet(np.ones(3), 3)
    phase = rng.uniform(0.0, 2.0 * np.pi, (3, 3))
    turn = 2.0 * np.pi * hertz
    amplitude = 0.5 * share * half[:, None]
    fastest = float(np.linalg.norm((amplitude * turn).sum(axis=1)))
    scale = min(1.0, speed / max(fastest, 1e-9))

    def position(time: float) -> Vector3:
        # Time itself begins slowly, so that nobody sees the target jump into motion.
        t = scale * (time - 2.0 * np.tanh(0.5 * time))
        waves = amplitude * (np.sin(turn * t + phase) - np.sin(phase))
        return np.asarray(start + np.clip(waves.sum(axis=1), -half, half))

    return position


def _ball(spec: TargetSpec) -> list[Solid]:
    return [
        Solid(
            spec.name,
            "sphere",
            (BALL_RADIUS, 0.0, 0.0),
            spec.T_world_target,
            RED,
            "shiny" if spec.glossy else "plain",
        )
    ]


def _held_ball(spec: TargetSpec) -> list[Solid]:
    """The ball on the fingertips of a pink glove whose sleeve goes on along x."""
    glove = make_pose(None, (BALL_RADIUS + 0.06, 0.0, 0.0))
    sleeve = from_rpy((0.0, 0.5 * np.pi, 0.0), (BALL_RADIUS + 0.25, 0.0, 0.0))
    return [
        *_ball(spec),
        _box(f"{spec.name}/glove", (0.12, 0.085, 0.05), glove, PINK),
        Solid(f"{spec.name}/sleeve", "cylinder", (0.035, 0.26, 0.0), sleeve, PINK),
    ]


def _bullseye(spec: TargetSpec) -> list[Solid]:
    """Rings on a plate whose front is the target's plane."""
    thick = 0.010
    layers = len(RINGS)
    back = make_pose(None, (0.0, 0.0, -layers * _SHEET - 0.5 * thick))
    solids = [
        Solid(
            spec.name,
            "box",
            (0.16, 0.16, thick),
            np.asarray(spec.T_world_target @ back),
            WHITE,
        )
    ]
    from_plate = np.linalg.inv(back)
    for i, radius in enumerate(RINGS):
        z = -(layers - 1 - i) * _SHEET - 0.5 * _SHEET
        color = RED if i % 2 == 0 else WHITE
        solids.append(
            _disc(f"{spec.name}/ring{i}", radius, from_plate @ make_pose(None, (0, 0, z)), color)
        )
    return solids


def _smiley(spec: TargetSpec) -> list[Solid]:
    """A face on a box of 24 x 24 x 12 cm; the target's frame lies in the mouth's middle."""
    depth = 0.12
    T_mouth_box = make_pose(None, (-MOUTH[0], -MOUTH[1], -2 * _SHEET - 0.5 * depth))
    solids = [
        Solid(
            spec.name,
            "box",
            (0.24, 0.24, depth),
            np.asarray(spec.T_world_target @ T_mouth_box),
            CARTON,
        )
    ]
    front = 0.5 * depth
    face = make_pose(None, (0.0, 0.0, front + 0.5 * _SHEET))
    solids.append(_disc(f"{spec.name}/face", FACE_RADIUS, face, YELLOW))
    above = front + 1.5 * _SHEET
    for side in (-1, 1):
        eye = make_pose(None, (side * 0.033, 0.030, above))
        solids.append(_disc(f"{spec.name}/eye{(side + 1) // 2}", 0.011, eye, BLACK))
    # The mouth: an arc of short bars, of which the lowest is the middle.
    for i, angle in enumerate(np.deg2rad(np.linspace(-58.0, 58.0, 13))):
        x, y = 0.062 * np.sin(angle), MOUTH[1] + 0.062 * (1.0 - np.cos(angle))
        bar = from_rpy((0.0, 0.0, angle), (x, y, above))
        size = (0.0135, 0.012, _SHEET)
        solids.append(Solid(f"{spec.name}/mouth{i}", "box", size, bar, BLACK))
    return solids


def _hand(spec: TargetSpec) -> list[Solid]:
    """A pink glove, palm along z, fingers along x, with a blue disc on the palm."""
    thick = 0.028
    T_palm_hand = make_pose(None, (0.0, 0.0, -_SHEET - 0.5 * thick))
    solids = [
        Solid(
            spec.name,
            "box",
            (0.095, 0.085, thick),
            np.asarray(spec.T_world_target @ T_palm_hand),
            PINK,
        )
    ]
    for i, y in enumerate((-0.033, -0.011, 0.011, 0.033)):
        finger = make_pose(None, (0.047 + 0.038, y, 0.0))
        solids.append(_box(f"{spec.name}/finger{i}", (0.076, 0.018, 0.018), finger, PINK))
    thumb = from_rpy((0.0, 0.0, np.deg2rad(50.0)), (0.030, 0.062, 0.0))
    solids.append(_box(f"{spec.name}/thumb", (0.070, 0.020, 0.020), thumb, PINK))
    wrist = make_pose(None, (-0.047 - 0.11, 0.0, 0.0))
    solids.append(_box(f"{spec.name}/forearm", (0.22, 0.062, 0.045), wrist, PINK))
    disc = make_pose(None, (0.0, 0.0, 0.5 * thick + 0.5 * _SHEET))
    solids.append(_disc(f"{spec.name}/palm", PALM_RADIUS, disc, BLUE))
    return solids


def _disc(name: str, radius: float, T: Pose, color: tuple[float, float, float]) -> Solid:
    return Solid(name, "cylinder", (radius, _SHEET, 0.0), np.asarray(T), color)


def _box(
    name: str, size: tuple[float, float, float], T: Pose, color: tuple[float, float, float]
) -> Solid:
    kind: ShapeKind = "box"
    return Solid(name, kind, size, np.asarray(T), color)
