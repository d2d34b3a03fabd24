"""The live page: read-only views of a session in the browser, and a few wishes passed on."""

from __future__ import annotations

from armsight.viewer.page import LivePage
from armsight.viewer.server import new_token

__all__ = ["LivePage", "new_token"]
