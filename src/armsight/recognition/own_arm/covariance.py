"""How sure a pose is whose residuals are not independent of each other.

Neighbouring pixels err alike, and thousands of them would promise micrometres; an arm whose elbow
is half a millimetre off errs alike in every picture. The first is read off the residuals (Liang and
Zeger 1986), the second can not be, since the pose gives way to it: what it does to the estimate
follows from its usual size (a "consider" analysis: Tapley, Schutz and Born 2004, section 6).
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats


def clustered_covariance(H: Floats, g: Floats) -> Floats:
    """(p, p) covariance of a least-squares estimate whose residuals are alike within clusters.

    The sandwich of Liang and Zeger 1986, beside the one for independent residuals.

    Args:
        H: (p, p) normal matrix.
        g: (c, p) gradient of each cluster at the estimate.
    """
    inverse_H = np.linalg.pinv(H)
    full = g[np.any(g != 0.0, axis=1)]
    c = max(len(full), 1)
    middle = full.T @ full * (c / max(c - 1, 1))
    return np.asarray(inverse_H + inverse_H @ middle @ inverse_H)


def considered(H: Floats, moved: Floats) -> Floats:
    """(p, p) covariance that is added by errors which move what the estimate compares with.

    Args:
        H: (p, p) normal matrix.
        moved: (p, m) gradient of one standard deviation of each of m independent errors.
    """
    off = np.linalg.pinv(H) @ moved
    return np.asarray(off @ off.T)
