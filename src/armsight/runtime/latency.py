"""How long a stage takes on the simulated clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Latency:
    """How long a stage takes on the simulated clock.

    Attributes:
        declared: seconds charged when ``charge`` is ``declared`` [s].
        charge: ``declared`` makes runs repeatable bit for bit; ``measured`` charges the compute
            time of this machine; under the wall clock time passes by itself (``real``).
    """

    declared: float
    charge: Literal["declared", "measured", "real"] = "declared"

    def of(self, seconds: float) -> float:
        """Seconds to charge for a round that took ``seconds`` of computing."""
        if self.charge == "real":
            return 0.0
        return self.declared if self.charge == "declared" else seconds
