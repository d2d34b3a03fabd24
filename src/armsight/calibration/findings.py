"""What is wrong with a calibration's data, in words a user can act on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]
_ORDER = {"error": 0, "warning": 1, "note": 2}


@dataclass(frozen=True)
class Finding:
    """One thing found.

    Attributes:
        code: short name of the mistake, stable, for programs.
        severity: ``error``: the answer is wrong as it stands; ``warning``: worse than it could be.
        message: what is wrong, with figures.
        cure: what to do.
    """

    code: str
    severity: Severity
    message: str
    cure: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.message}; {self.cure}"


def by_severity(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Mistakes first, each message once."""
    once = {f.message: f for f in findings}
    return tuple(sorted(once.values(), key=lambda f: _ORDER[f.severity]))


def names_of(names: Sequence[str], most: int = 4) -> str:
    """Some names for a message."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
