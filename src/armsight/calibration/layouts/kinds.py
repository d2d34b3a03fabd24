"""Kinds of files by their endings, and files that hold nothing for us."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

STRUCTURED = (".yaml", ".yml", ".json", ".xml")
TEXT = (
    *(".txt", ".csv", ".tsv", ".dat", ".src", ".mod", ".modx", ".prg", ".script", ".urscript"),
    *(".log", ".m", ".pose", ".tfm", ".asc", ".tum", ".pos", ".tf", ""),
)
BAGS = (".bag", ".mcap", ".db3")


@dataclass(frozen=True)
class Unread:
    """A file that holds no poses for us, and why."""

    file: Path
    reason: str
