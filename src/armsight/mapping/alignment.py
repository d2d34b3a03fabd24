"""Fine alignment: a camera's pose and depth scale refined against what is known to be there.

T2 merges clouds by calibration and then aligns them by ICP once, and again when something moved.
Here the target is the model: the declared solids and the arm at its joints, as exact distance
functions. Each point is drawn to the nearest known surface (point-to-surface ICP with Tukey
weights); a prior holds what the view does not determine. One frame of 5000 points is enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Points, Pose, Poses
from armsight.geometry.pose import exp, log, make_pose, skews
from armsight.mapping.kernels.align import normal_equations
from armsight.mapping.self_filter import CELL, BodyFields
from armsight.mapping.static_geometry import StaticGeometry

GATES = (0.05, 0.05, 0.05, 0.05, 0.04, 0.03, 0.03, 0.03, 0.03, 0.03)
"""How far from a known surface a point may be and still count, iteration by iteration [m]."""
STARTS = (0.0, -0.02, 0.02, -0.04, 0.04, -0.06, 0.06, -0.08, 0.08)
"""Offsets along the view that are tried first [m]: depth errors of some centimetres are common,
and thin tables and links have two faces to be drawn to."""
TURNS = np.deg2rad([-2.5, 2.5])
"""Turns about each axis of the camera that are tried as well [rad]: whoever walks into a stand
turns it by degrees, and its points are then drawn to other surfaces."""
FOLLOWED = 3
"""So many of these starts are followed, those that explain most."""
FIELD_GATE = 0.055
"""The arm's distance fields reach no farther [m]."""
DECLARED = np.array([0.03, 0.03, 0.03, 0.02, 0.02, 0.02, 0.006])
"""Standard deviations believed of a camera that somebody has put up: translation [m], rotation
[rad], depth scale."""
MODELLED_SCALE = 0.002
"""Of the depth scale of a camera whose depth was calibrated."""
SURFACE_ERROR = 0.005
"""Standard deviation of a point about a known surface, model errors included [m]."""
CORRELATED = 10.0
"""Points whose errors are alike count as one: neighbours share the sensor's systematic error. With
it the true displacements of seven simulated cameras (tuning seed 1000) are within 2 sigma."""
WEIGHT = 1.0 / (SURFACE_ERROR**2 * CORRELATED)
"""Of one point among the others and the prior [1/m^2]."""
LEAST_POINTS = 400
LEAST_APART = 40
"""Of the points of a look, an eighth of an alignment's, so many tell how far they lie apart. Of a
neighbour's picture 94 to 102 were known (seed 3, run 9 of ``faults``); with 100 asked for it was
believed for 1.7 s."""


@dataclass(frozen=True)
class AlignmentView:
    """What alignment needs of one frame.

    Attributes:
        points: (n, 3) in the camera frame, as measured [m].
        T_cells_base: (m, 4, 4) base in the grids of the body's parts at the exposure, lengths there
            in cells; or None to leave the arm out.
    """

    points: Points
    T_cells_base: Poses | None


@dataclass(frozen=True)
class Alignment:
    """The result of a fine alignment.

    Attributes:
        T_old_new: the corrected camera in the frame of the uncorrected one.
        gain: factor on measured depth.
        points: how many points lay on known surfaces in the end.
        before, after: median distance of those points to the surfaces [m].
        covariance: (7, 7) of what is left: translation [m], rotation [rad] of the corrected camera,
            depth scale.
        good: enough points, and nearer to the surfaces than before.
    """

    T_old_new: Pose
    gain: float
    points: int
    before: float
    after: float
    covariance: Floats
    good: bool

    @property
    def shift(self) -> float:
        """Length of the correction's translation [m]."""
        return float(np.linalg.norm(self.T_old_new[:3, 3]))

    @property
    def turn(self) -> float:
        """Angle of the correction's rotation [rad]."""
        return float(np.linalg.norm(log(self.T_old_new)[3:]))

    def error_at(self, points: Points) -> Floats:
        """(n,) standard deviations [m] of where (n, 3) points in the camera frame are seen.

        In the worst direction of each. Errors of translation, rotation and scale partly undo each
        other where the known surfaces are, so this is less than the sum of their sizes.
        """
        p = np.asarray(points, float)
        J = np.concatenate([np.tile(np.eye(3), (len(p), 1, 1)), -skews(p), p[:, :, None]], axis=2)
        spread = np.einsum("nia,ab,njb->nij", J, self.covariance, J)
        return np.asarray(np.sqrt(np.linalg.eigvalsh(spread)[:, -1]))


def align_camera(
    views: Sequence[AlignmentView],
    T_base_camera: Sequence[Pose],
    fields: BodyFields,
    solids: StaticGeometry,
    gain: float = 1.0,
    believed: Floats | None = None,
) -> Alignment:
    """Refine one camera's mounting and depth scale from one or more frames.

    Args:
        views: the frames.
        T_base_camera: where the camera is believed to have been at each; all are corrected by the
            same transform on the camera's side.
        fields: the arm's distance fields.
        solids: the declared solids.
        gain: depth scale believed before.
        believed: (7, 7) covariance of what is believed; :data:`DECLARED` if absent.
    """
    prior: Floats = np.diag(DECLARED**-2.0)
    if believed is not None:
        prior = np.asarray(np.linalg.inv(believed), float)
    first = [make_pose(translation=[0.0, 0.0, z]) for z in STARTS]
    first += [exp(turn * axis) for axis in np.eye(6)[3:] for turn in TURNS]
    scored = [_sums(views, T_base_camera, T, gain, fields, solids, GATES[-1])[2] for T in first]
    best = np.argsort([-_support(r, GATES[-1]) for r in scored], kind="stable")[:FOLLOWED]
    # What a start explains does not tell what it leads to: a wrong one may slide along a table. So
    # the believed pose is always followed as well, and the end that explains more is taken.
    ends = []
    for k in sorted({0, *best.tolist()}):
        delta, scale = _refined(views, T_base_camera, first[k], gain, fields, solids, prior)
        A, _, residuals = _sums(views, T_base_camera, delta, scale, fields, solids, GATES[-1])
        ends.append((_support(residuals, GATES[-1]), delta, scale, A, residuals))
    _, delta, scale, A, residuals = max(ends, key=lambda end: end[0])
    count = int(np.isfinite(residuals).sum())
    covariance = np.asarray(np.linalg.inv(WEIGHT * A + prior), float)
    before, after = _median(scored[0]), _median(residuals)
    good = count >= LEAST_POINTS and after <= max(before, SURFACE_ERROR)
    return Alignment(delta, scale, count, before, after, covariance, good)


def _refined(
    views: Sequence[AlignmentView],
    T_base_camera: Sequence[Pose],
    delta: Pose,
    gain: float,
    fields: BodyFields,
    solids: StaticGeometry,
    prior: Floats,
) -> tuple[Pose, float]:
    """The correction and the depth scale to which a start leads."""
    start = gain
    for gate in GATES:
        A, b, _ = _sums(views, T_base_camera, delta, gain, fields, solids, gate)
        believed = np.concatenate([log(delta), [gain - start]])
        step = np.linalg.solve(WEIGHT * A + prior, WEIGHT * b - prior @ believed)
        delta = delta @ exp(step[:6])
        gain += float(step[6])
    return delta, gain


def _sums(
    views: Sequence[AlignmentView],
    T_base_camera: Sequence[Pose],
    delta: Pose,
    gain: float,
    fields: BodyFields,
    solids: StaticGeometry,
    gate: float,
) -> tuple[Floats, Floats, Floats]:
    A, b = np.zeros((7, 7)), np.zeros(7)
    residuals = []
    declared = (solids.kinds, solids.sizes, solids.T_solid_base)
    for view, T in zip(views, T_base_camera):
        parts = (fields.values, fields.offset, fields.shape)
        if view.T_cells_base is None:
            parts = (fields.values, fields.offset[:0], fields.shape[:0])
            placed = np.zeros((0, 4, 4))
        else:
            placed = view.T_cells_base
        out = np.empty(len(view.points))
        normal_equations(
            np.ascontiguousarray(view.points, float),
            gain,
            np.ascontiguousarray(T @ delta),
            parts,
            placed,
            CELL,
            declared,
            gate,
            min(gate, FIELD_GATE),
            A,
            b,
            out,
        )
        residuals.append(out)
    return A, b, np.concatenate(residuals) if residuals else np.empty(0)


def _support(residuals: Floats, gate: float) -> float:
    """Sum of Tukey weights: how much of the view known surfaces explain."""
    known = residuals[np.isfinite(residuals)] / gate
    return float(((1.0 - known**2) ** 2).sum())


def _median(residuals: Floats) -> float:
    known = np.abs(residuals[np.isfinite(residuals)])
    return float(np.median(known)) if len(known) else np.inf


def mismatch(
    view: AlignmentView,
    T_base_camera: Pose,
    fields: BodyFields,
    solids: StaticGeometry,
    gain: float,
) -> tuple[float, float]:
    """How far known surfaces seem displaced in one frame: at arm's length, and point by point [m].

    The first is what one Gauss-Newton step from the believed pose moves a point 1.5 m ahead; the
    step is not taken. A camera that has turned far draws its points to other surfaces, and that
    step is short; then they still lie apart from whatever they are drawn to, which is the second,
    a median. 0 where too little of what is known is in view: fewer points than a step needs still
    have a median.
    """
    A, b, residuals = _sums([view], [T_base_camera], np.eye(4), gain, fields, solids, 0.05)
    known = int(np.isfinite(residuals).sum())
    if known < LEAST_APART:
        return 0.0, 0.0
    if known < LEAST_POINTS // 4:
        return 0.0, _median(residuals)
    step = np.linalg.solve(WEIGHT * A + np.diag(DECLARED**-2.0), WEIGHT * b)
    lever = step[:3] + np.cross(step[3:6], [0.0, 0.0, 1.5]) + step[6] * np.array([0.0, 0.0, 1.5])
    return float(np.linalg.norm(lever)), _median(residuals)
