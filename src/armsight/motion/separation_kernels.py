"""The separation law, compiled: how much of a motion is allowed in view of one hazard."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit


class Law(NamedTuple):
    """Numbers of the separation law; see :mod:`armsight.motion.separation`.

    Attributes:
        person: v_h [m/s].
        K: C + Z_d + Z_r [m].
        T_person: T_r: time for which the person comes nearer before the arm brakes [s].
        T_arm: T_a: time for which the arm goes on, as commanded, before it brakes [s].
        hazard_radius: half diagonal of a hazard's cube [m].
        retreat: speed of the fastest point at which the arm may always move away [m/s].
    """

    person: float
    K: float
    T_person: float
    T_arm: float
    hazard_radius: float
    retreat: float


@njit(cache=True, nogil=True)
def allowed_share(
    distance: float, closing: float, fastest: float, stopping: float, law: Law
) -> float:
    """Share of a motion that separation allows to one moving part in view of one hazard.

    The motion at share s closes in at ``s closing`` and needs ``s stopping`` to stop; the share is
    the root of ``D = v_h (T_r + s T_s) + s v_r T_a + s^2 v_r T_s / 2 + K``.

    A part that does not close in is held to the same with v_r = 0, so that it stands before
    anybody reaches it; but it may always leave at the speed at which an arm counts as standing.

    Args:
        distance: D from the part's surface to the hazard's [m].
        closing: speed towards the hazard of the whole motion [m/s]; negative when receding.
        fastest: speed of the arm's fastest point [m/s]; above 0.
        stopping: time to stop from the whole motion [s].
        law: numbers of the law.
    """
    spare = distance - law.K - law.person * law.T_person
    share = 0.0
    towards = max(closing, 0.0)
    if spare > 0.0:
        b = law.person * stopping + towards * law.T_arm
        root = b + np.sqrt(b * b + 2.0 * towards * stopping * spare)
        share = 2.0 * spare / root if root > 0.0 else np.inf
    if closing <= 0.0:
        share = max(share, law.retreat / fastest)
    return share


@njit(cache=True, nogil=True)
def protective(closing: float, stopping: float, law: Law) -> float:
    """S_p [m] of one part in view of one hazard, for the motion as it is."""
    towards = max(closing, 0.0)
    time = law.T_person + stopping
    return law.person * time + towards * (law.T_arm + 0.5 * stopping) + law.K
