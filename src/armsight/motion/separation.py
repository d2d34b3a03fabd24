"""Speed and separation: how fast the arm may close in on whoever might be nearest.

The protective distance of ISO/TS 15066 (ISO 10218-2:2025), docs/guard.md::

    S_p = S_h + S_r + S_s + C + Z_d + Z_r

    S_h = v_h (T_r + T_s)    the person comes nearer while we notice and stop
    S_r = v_r T_a            the arm goes on before it starts to brake
    S_s = v_r^2 / (2 a)      the arm goes on while braking
    C                        how far a limb can be inside before it is seen
    Z_d, Z_r                 errors of the person's and of the arm's position
    T_s = v_r / a

``v_r`` is the speed of a part of the arm towards the person. T_r runs from the exposure of the
oldest picture to the instant at which a braking arm begins to slow. The standard lets the arm move
through all of it; here the arm's own way is known, for it was commanded: the distance is taken from
where the arm *will be* when the command acts, and T_a is only the time from there to the braking.
Solved for v_r, K = C + Z_d + Z_r::

    v_max = -(v_h + a T_a) + sqrt((v_h + a T_a)^2 + 2 a (D - K - v_h T_r))

and 0 if D <= K + v_h T_r. The compiled form that looks at every hazard is in ``guard_kernels``.

ISO 13855 counts 1.6 m/s for a walk and 2.0 m/s for a hand, and lets the walk count where 2.0 m/s
would ask for more than half a metre. That supposes that a hand is done after half a metre. Somebody
who walks and reaches is not, and while a fast arm stops, a hand comes nearer by more than that:
v_h is a hand's speed here at every distance.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

HAND = 2.0
"""A hand's speed [m/s] (ISO 13855)."""


@dataclass(frozen=True)
class Separation:
    """The constants of the protective distance in one cell.

    Attributes:
        person_speed: v_h [m/s]: nothing of a person comes nearer faster than this.
        intrusion: C [m]: how far a limb can be inside before it is seen.
        person_error: Z_d [m]: depth noise and calibration, beyond the voxel itself.
        arm_error: Z_r [m]: joints, stamps times speed, sphere model.
    """

    person_speed: float = HAND
    intrusion: float = 0.02
    person_error: float = 0.02
    arm_error: float = 0.01

    @property
    def K(self) -> float:
        """C + Z_d + Z_r [m]."""
        return self.intrusion + self.person_error + self.arm_error

    def protective_distance(
        self, v_r: float, T_r: float, a: float, T_s: float | None = None, T_a: float | None = None
    ) -> float:
        """S_p [m] for a part that closes in at v_r [m/s] (0 when it does not).

        Args:
            v_r: closing speed [m/s].
            T_r: reaction time [s].
            a: deceleration of the part [m/s^2].
            T_s: stopping time [s]; v_r / a if left out.
            T_a: time for which the arm goes on [s]; T_r, as in the standard, if left out.
        """
        stopping = v_r / a if T_s is None else T_s
        going_on = T_r if T_a is None else T_a
        return (
            self.person_speed * (T_r + stopping) + v_r * going_on + v_r * v_r / (2.0 * a) + self.K
        )

    def allowed_speed(
        self, distance: float, T_r: float, a: float, T_a: float | None = None
    ) -> float:
        """v_max [m/s]: the closing speed at which the protective distance is just kept."""
        spare = distance - self.K - self.person_speed * T_r
        if not spare > 0.0:  # NaN is no room either
            return 0.0
        b = self.person_speed + a * (T_r if T_a is None else T_a)
        return 2.0 * a * spare / (b + math.sqrt(b * b + 2.0 * a * spare))


class ReactionTime:
    """T_r as measured: the greatest of the last seconds, never below what is declared.

    Args:
        declared: least value [s].
        window: how long a measurement counts [s].
    """

    def __init__(self, declared: float, window: float = 10.0) -> None:
        self.declared = declared
        self._window = window
        self._falling: deque[tuple[float, float]] = deque()

    def add(self, now: float, seconds: float) -> None:
        """A reaction that began at ``now`` [s] would take this long [s]."""
        if not math.isfinite(seconds):
            return
        while self._falling and self._falling[-1][1] <= seconds:
            self._falling.pop()
        self._falling.append((now, seconds))
        while self._falling[0][0] < now - self._window:
            self._falling.popleft()

    def clear(self) -> None:
        """Forget all measurements (the clock jumped)."""
        self._falling.clear()

    @property
    def value(self) -> float:
        """Reaction time to count with [s]."""
        return max(self.declared, self._falling[0][1] if self._falling else 0.0)
