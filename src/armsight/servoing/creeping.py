"""A tip that stands where the target's surface should be and feels nothing goes on, slowly.

An estimate may be wrong by more than the tip is from the surface, and where nothing moves no new
look makes it better: the tip would stand before the target for good. What is felt decides then.
"""

from __future__ import annotations

import math

STANDS = 0.4
"""It has stood there, and felt nothing, for so long [s], before it goes on ..."""
CREEPS = 0.008
"""... so fast [m/s]: until the arm has stopped for what is felt it goes on by 1.5 mm."""
STILL = 0.03
"""A target that moves faster [m/s] is not stood before."""


class Creeping:
    """How far behind the believed surface the tip shall be.

    Args:
        most: by so much at most [m]; 0 for a tip that does not go on.

    Attributes:
        by: how far it has gone on [m].
        felt: something was felt there since it began to stand.
    """

    def __init__(self, most: float) -> None:
        self.most = most
        self.reset()

    def reset(self) -> None:
        """It stands nowhere."""
        self.by, self.felt = 0.0, False
        self._since, self._told = math.inf, -math.inf

    def update(self, now: float, stands: bool, pressed: float, least: float) -> float:
        """How far it shall have gone on now [m].

        Args:
            now: time [s].
            stands: it is at the believed surface of what is seen, at rest and may be touched.
            pressed: what is felt [N]; NaN where nobody says: then it does not go on.
            least: from here on something is felt [N].
        """
        passed, self._told = now - self._told, now
        if not stands:
            self.reset()
            self._told = now
            return 0.0
        self._since = min(self._since, now)
        self.felt = self.felt or pressed > least
        if not self.felt and pressed <= least and now > self._since + STANDS:
            self.by = min(self.by + CREEPS * passed, self.most)
        return self.by

    @property
    def missed(self) -> bool:
        """Whether it has gone on as far as it may and felt nothing."""
        return self.most > 0.0 and self.by >= self.most and not self.felt
