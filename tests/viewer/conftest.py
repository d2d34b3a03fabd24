"""A page of a fake session."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from page_fakes import FakeSession

from armsight.viewer import LivePage


@pytest.fixture
def session() -> FakeSession:
    return FakeSession()


@pytest.fixture
def page(session: FakeSession) -> Iterator[LivePage]:
    page = LivePage(session, port=0)
    yield page
    page.close()
