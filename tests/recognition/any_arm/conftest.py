"""Fixtures of the tests of any arm."""

import pytest

from armsight.recognition.any_arm import recogniser


@pytest.fixture
def without_landmarks(monkeypatch: pytest.MonkeyPatch) -> None:
    """An arm needs no landmarks, seen once or again: of a toy network, which sees none."""
    monkeypatch.setattr(recogniser, "FOUND", (0.0,) * len(recogniser.FOUND))
    monkeypatch.setattr(recogniser, "STAYS", (0.0,) * len(recogniser.STAYS))
