"""Something moved in the middle of the set: the board on its mount, or the camera on its own.

A change point in the sequence of pose errors. How much errors differ between two parts of a set is
a matter of the arm: one that is off by a millimetre here and by another there looks as if something
had moved between. So the scale is the set's own: the gain of the best split is compared with that
of the same errors in shuffled order, the two parts must lie apart by several times their own
scatter, and the minimum must be sharp, because a bracket slips between two pictures and not slowly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Ints
from armsight.calibration.calibrate import Calibration
from armsight.calibration.findings import Finding
from armsight.calibration.pose_space import PoseErrors, pose_errors

LEAST = 8
"""Views below which no split is told from chance."""


@dataclass(frozen=True)
class SlipRule:
    """When a split counts.

    Attributes:
        chance: share of shuffled orders that may split as well [1]; shuffles: how many are drawn.
        apart: distance of the two parts in standard deviations of what is left [1].
        sharp: how much the gain must fall three places away [1].
    """

    chance: float = 0.002
    shuffles: int = 500
    apart: float = 4.0
    sharp: float = 12.0


@dataclass(frozen=True)
class Slip:
    """A split of a set.

    Attributes:
        after: position in the order of views of the first view after it.
        gain: log likelihood ratio of two parts against one.
        apart: their distance in standard deviations.
        carried: what the flange carries moved; otherwise what stands in the base.
        shift: (6,) by how much (translation [m], rotation [rad]).
    """

    after: int
    gain: float
    apart: float
    carried: bool
    shift: Floats


def find_slip(
    errors: PoseErrors, rng: np.random.Generator, rule: SlipRule | None = None
) -> Slip | None:
    """The split that explains the pose errors of views in their order, if chance does not."""
    rule = rule or SlipRule()
    n = len(errors.view)
    if n < LEAST:
        return None
    u, M, root = errors.whitened()
    carried = root
    standing = root @ errors.design[:, :, 6:]
    best: tuple[float, Slip] | None = None
    for is_carried, S in ((True, carried), (False, standing)):
        gains = _gains(u, M, S, np.arange(n)[None])[0]
        k = int(np.argmax(gains))
        # A slip leaves sides: the gain falls quickly away from it.
        near = [gains[j] for j in (k - 3, k + 3) if 0 <= j < n]
        if gains[k] - max(near, default=0.0) < rule.sharp:
            continue
        shuffled = np.array([rng.permutation(n) for _ in range(rule.shuffles)])
        by_chance = _gains(u, M, S, shuffled).max(1)
        if np.mean(by_chance >= gains[k]) > rule.chance or gains[k] < 1.3 * by_chance.max():
            continue
        shift, apart = _jump(u, M, S, k)
        if apart < rule.apart:
            continue
        slip = Slip(k, float(gains[k]), apart, is_carried, shift)
        if best is None or slip.gain > best[0]:
            best = (slip.gain, slip)
    return None if best is None else best[1]


def _gains(u: Floats, M: Floats, S: Floats, orders: Ints) -> Floats:
    """(p, n) log likelihood ratio of a jump before each place, for p orders."""
    n = len(u)
    # Orthonormal basis of what the regression explains already.
    Q, R = np.linalg.qr(M.reshape(6 * n, 12))
    Q = Q[:, np.abs(np.diagonal(R)) > 1e-9 * np.abs(np.diagonal(R)).max()].reshape(n, 6, -1)
    g = np.einsum("nij,ni->nj", S, u)  # (n, 6)
    N = np.swapaxes(S, 1, 2) @ S  # (n, 6, 6)
    C = np.swapaxes(S, 1, 2) @ Q  # (n, 6, q)

    def later(x: Floats) -> Floats:
        """Sums over the views from each place on, per order."""
        return np.cumsum(x[orders][:, ::-1], axis=1)[:, ::-1]

    g_k, N_k, C_k = later(g), later(N), later(C)
    info = N_k - C_k @ np.swapaxes(C_k, -1, -2)
    scale = np.maximum(np.diagonal(info, axis1=-2, axis2=-1), 1e-9)
    info = info + 1e-6 * scale[..., None] * np.eye(6)
    x = np.linalg.solve(info, g_k[..., None])[..., 0]
    # A likelihood ratio with the scatter told anew: a jump must not hide in its own scatter.
    whole = float(np.sum(u**2))
    left = np.maximum(whole - np.einsum("pnj,pnj->pn", g_k, x), 1e-3 * whole)
    out = 0.5 * max(6 * n - 18, 6) * np.log(whole / left)
    out[:, :3] = 0.0  # three views a side are the least
    out[:, n - 2 :] = 0.0
    return np.asarray(out)


def _jump(u: Floats, M: Floats, S: Floats, k: int) -> tuple[Floats, float]:
    """The jump before place k, and its size over the scatter that is left along it."""
    n = len(u)
    late = (np.arange(n) >= k)[:, None, None] * S
    X = np.concatenate([M, late], axis=2).reshape(6 * n, 18)
    x = np.linalg.lstsq(X, u.ravel(), rcond=1e-9)[0]
    left = (u.ravel() - X @ x).reshape(n, 6)
    spent = 6 * n / max(6 * n - 18, 6)
    along = np.einsum("nij,j->ni", S, x[12:])
    length = np.linalg.norm(along, axis=1)
    part = np.einsum("ni,ni->n", left, along / np.maximum(length, 1e-12)[:, None])
    scatter = float(np.sqrt(spent * np.mean(part**2)))
    return x[12:], float(np.median(length)) / max(scatter, 1e-9)


def slip_findings(
    answer: Calibration, rig: int, names: Sequence[str], seed: int = 0
) -> list[Finding]:
    """A board that slipped, or a camera that was bumped, between two views.

    Args:
        answer: the calibration; what it left out as contradictory is looked at as well.
        rig: the camera.
        names: of the problem's views, for the message.
        seed: of the shuffles.
    """
    solution = answer.solution
    errors = pose_errors(solution, rig, [s for s, _ in answer.rejected])
    if errors is None:
        return []
    slip = find_slip(errors, np.random.default_rng(seed))
    if slip is None:
        return []
    before, after = names[errors.view[slip.after - 1]], names[errors.view[slip.after]]
    board, camera = "the board", f"camera {solution.model.problem.rigs[rig].name}"
    on_flange = solution.model.problem.rigs[rig].mount == "flange"
    what = camera if slip.carried == on_flange else board
    return [
        Finding(
            "slip",
            "warning",
            f"{what} seems to have moved between {before} and {after}, by "
            f"{1e3 * np.linalg.norm(slip.shift[:3]):.1f} mm and "
            f"{np.rad2deg(np.linalg.norm(slip.shift[3:])):.2f} deg ({slip.apart:.0f} times what "
            "the views differ by otherwise)",
            f"calibrate the views before {after} and those from it on apart, or tighten board and "
            "camera and repeat",
        )
    ]
