"""Keeps the runs of a long experiment, so that an interrupted one goes on where it stopped.

One JSON line a finished run, in ``results/cache/NAME.jsonl`` of the working folder (or where
``ARMSIGHT_CACHE`` says). A run is known by the experiment's name and part, the seed, the run's
number, and the code that made it: what other code has measured is measured anew.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from armsight.errors import ArmsightError
from armsight.experiments.code_digest import code_digest

JsonValue = Any


def cache_folder() -> Path:
    """Where partial results lie."""
    return Path(os.environ.get("ARMSIGHT_CACHE", "results/cache"))


class RunCache:
    """Finished runs of one part of an experiment, made by the code that asks.

    Args:
        name: of the experiment.
        seed: of the experiment.
        part: what tells these runs from others of this name and seed, as JSON values, and what
            changes them and is no part of the package, such as recordings that may be there.
        folder: None for :func:`cache_folder`.
    """

    def __init__(
        self, name: str, seed: int, part: JsonValue = None, folder: Path | None = None
    ) -> None:
        self._file = (folder or cache_folder()) / f"{name}.jsonl"
        text = json.dumps([name, seed, part, code_digest()], sort_keys=True)
        self._key = hashlib.sha256(text.encode()).hexdigest()[:16]
        self._runs = self._read()

    def __len__(self) -> int:
        return len(self._runs)

    def get(self, run: int, compute: Callable[[], JsonValue]) -> JsonValue:
        """The result of a run: remembered, or computed now and remembered.

        Raises:
            ArmsightError: the cache cannot be written.
        """
        if run not in self._runs:
            result = compute()
            self._append(run, result)
            self._runs[run] = result
        return self._runs[run]

    def _read(self) -> dict[int, JsonValue]:
        runs: dict[int, JsonValue] = {}
        try:
            lines = self._file.read_text(encoding="utf-8").splitlines()
        except FileNotFoundError:
            return runs
        for line in lines:
            try:
                entry = json.loads(line)
                if entry["key"] == self._key:
                    runs[int(entry["run"])] = entry["result"]
            except (ValueError, KeyError, TypeError):
                continue  # a line cut short by an interruption
        return runs

    def _append(self, run: int, result: JsonValue) -> None:
        line = json.dumps({"key": self._key, "run": run, "result": result}, allow_nan=True)
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            # A leading newline closes a line that an interruption may have cut short.
            with self._file.open("a", encoding="utf-8") as stream:
                stream.write(f"\n{line}\n" if stream.tell() else f"{line}\n")
        except OSError as error:
            raise ArmsightError(f"{self._file}: cannot be written: {error.strerror}") from None
