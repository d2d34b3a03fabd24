"""Speed and separation: how fast the arm may close in on whoever might be nearest.

The protective distance of ISO/TS 15066 (ISO 10218-2:2025), design page "guard" 5.8::

    S_p = S_h + S_r + S_s + C + Z_d + Z_r

    S_h = v_h (T_r + T_s)    the person comes nearer while we notice and stop
    S_r = v_r T_r            the arm goes on before it starts to brake
    S_s = v_r^2 / (2 a)      the arm goes on while braking
    C                        how far a limb can be inside before it is seen
    Z_d, Z_r                 errors of the person's and of the arm's position
    T_s = v_r / a

``v_r`` is the speed of a part of the arm towards the person. Solved for it, K = C + Z_d + Z_r::

    v_max = -(v_h + a T_r) + sqrt((v_h + a T_r)^2 + 2 a (D - K - v_h T_r))

and 0 if D <= K + v_h T_r. The compiled form that looks at every hazard is in ``guard_kernels``.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

WALKING = 1.6
"""A person's speed [m/s] (ISO 13855)."""
REACHING = 2.0
"""A hand's speed [m/s], assumed when nearer than :data:`CLOSE`."""
CLOSE = 0.5
"""Distance below which a hand, not a walk, is assumed [m]."""


@dataclass(frozen=True)
class Separation:
    """The constants of the protective distance in one cell.

    Attributes:
        walking: speed of a person farther than ``close`` [m/s].
        reaching: speed of a person nearer than ``close`` [m/s].
        close: where ``reaching`` begins [m].
        intrusion: C [m]: how far a limb can be inside before it is seen.
        person_error: Z_d [m]: depth noise and calibration, beyond the voxel itself.
        arm_error: Z_r [m]: joints, stamps times speed, sphere model.
    """

    walking: float = WALKING
    reaching: float = REACHING
    close: float = CLOSE
    intrusion: float = 0.02
    person_error: float = 0.02
    arm_error: float = 0.01

    @property
    def K(self) -> float:
        """C + Z_d + Z_r [m]."""
        return self.intrusion + self.person_error + self.arm_error

    def person_speed(self, distance: float) -> float:
        """v_h [m/s] for a person at a distance [m]."""
        return self.reaching if distance < self.close else self.walking

    def protective_distance(
        self, v_r: float, v_h: float, T_r: float, a: float, T_s: float | None = None
    ) -> float:
        """S_p [m] for a part that closes in at v_r [m/s] (0 when it does not).

        Args:
            v_r: closing speed [m/s].
            v_h: the person's speed [m/s].
            T_r: reaction time [s].
            a: deceleration of the part [m/s^2].
            T_s: stopping time [s]; v_r / a if left out.
        """
        stopping = v_r / a if T_s is None else T_s
        return v_h * (T_r + stopping) + v_r * T_r + v_r * v_r / (2.0 * a) + self.K

    def allowed_speed(self, distance: float, T_r: float, a: float) -> float:
        """v_max [m/s]: the closing speed at which the protective distance is just kept."""
        v_h = self.person_speed(distance)
        spare = distance - self.K - v_h * T_r
        if not spare > 0.0:  # NaN is no room either
            return 0.0
        b = v_h + a * T_r
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
