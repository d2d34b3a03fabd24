"""Arguments of every command that shows the live page."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Page:
    """Where the live page is served.

    Attributes:
        host: address to listen on; anything but loopback needs a token.
        port: TCP port; 0 takes a free one.
        token: secret of at least 12 characters that the page's address must then carry.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    token: str | None = None
