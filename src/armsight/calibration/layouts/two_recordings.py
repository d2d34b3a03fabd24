"""Two cameras, or two recordings, in one folder: each half fits by itself, both together do not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.arrays import Floats, Mask, Poses
from armsight.calibration import se3
from armsight.calibration.findings import Finding
from armsight.calibration.hand_eye_fit import HandEyeFit, SeenBoards, fit

LEAST = 5
"""Views of a part, at least: fewer fit by chance."""
TOGETHER = 0.85
"""Share of the views that both parts explain."""


def two_parts(
    readings: Sequence[Poses], boards: SeenBoards, limit: float, draws: int = 16
) -> tuple[Mask, int] | None:
    """Views that belong together and those that belong together otherwise.

    Args:
        readings: (n, 4, 4) each, the arm's poses as they may be read, likely ones first.
        boards: of the same views.
        limit: a view fits within this [px].
        draws: random samples of each reading.

    Returns:
        (n,) which views belong to the larger part, and the reading; None when there are no two.
    """
    rng = np.random.default_rng(0)
    n = len(boards.options)
    if n < 2 * LEAST:
        return None
    best: tuple[int, Mask, int] | None = None
    for number, A in enumerate(readings):
        first = _consensus(A, boards, np.ones(n, bool), limit, draws, rng)
        if first is None or first.sum() < LEAST:
            continue
        second = _consensus(A, boards, ~first, limit, draws, rng)
        if second is None or second.sum() < LEAST:
            continue
        count = int(first.sum() + second.sum())
        if count >= TOGETHER * n and (best is None or count > best[0]):
            best = (count, first, number)
    return None if best is None else (best[1], best[2])


def _consensus(
    A: Poses, boards: SeenBoards, among: Mask, limit: float, draws: int, rng: np.random.Generator
) -> Mask | None:
    """The largest set of views that one camera explains."""
    index = np.flatnonzero(among)
    if len(index) < LEAST:
        return None
    best: Mask | None = None
    for _ in range(draws):
        pick = rng.choice(index, LEAST, replace=False)
        found = fit(A[pick], boards.only(pick))
        if found.median_px > limit:
            continue
        good = among & (residual_px(A, boards, found) < limit)
        if best is None or good.sum() > best.sum():
            best = good
    if best is not None and best.sum() > LEAST:
        pick = np.flatnonzero(best)
        again = among & (residual_px(A, boards, fit(A[pick], boards.only(pick))) < limit)
        best = again if again.sum() >= best.sum() else best
    return best


def residual_px(A: Poses, boards: SeenBoards, found: HandEyeFit) -> Floats:
    """(n,) rough distance of each view's corners from where a fit of others puts them [px]."""
    scaled = A.copy()
    scaled[:, :3, 3] *= found.scale
    C = se3.inverses(found.X[None]) @ scaled @ found.Z
    gap = se3.inverses(C)[:, None] @ boards.options
    turn = np.linalg.norm(se3.logs(gap.reshape(-1, 4, 4))[:, 3:], axis=1)
    middle = C[:, :3, :3] @ boards.middle + C[:, :3, 3]
    seen = boards.options[..., :3, :3] @ boards.middle + boards.options[..., :3, 3]
    d = seen - middle[:, None]
    z = np.maximum(seen[..., 2], 1e-6)
    r, f = boards.radius, boards.focal
    px = (f / z) * np.sqrt(
        (turn.reshape(z.shape) * r) ** 2
        + d[..., 0] ** 2
        + d[..., 1] ** 2
        + (d[..., 2] * r / z) ** 2
    )
    return np.asarray(px.min(1), np.float64)


def two_findings(part: Mask, names: Sequence[str]) -> list[Finding]:
    """The name of what was found: moved once in the middle, or two recordings mixed."""
    changes = np.flatnonzero(part[1:] != part[:-1])
    if len(changes) == 1:
        k = int(changes[0])
        return [
            Finding(
                "slip",
                "error",
                f"board or camera moved between {names[k]} and {names[k + 1]}: apart, the two "
                "parts fit, together they do not",
                f"calibrate the views up to {names[k]} and those from {names[k + 1]} on apart",
            )
        ]
    some = [n for n, p in zip(names, part) if not p]
    return [
        Finding(
            "two_cameras",
            "error",
            f"pictures of two cameras (or of two places of one) are mixed: {int(part.sum())} fit "
            f"together, and {len(some)} others do, such as {', '.join(some[:3])}",
            "put each camera's pictures into a folder of its own",
        )
    ]
