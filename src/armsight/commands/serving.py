"""Arguments of every command that shows the live page."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Page:
    """Where the live page is served.

    Attributes:
        host: address to listen on; anything but loopback needs a token.
        port: TCP port; the next free one is taken if it is in use.
        token: secret that the page's address must carry; made up if the host is not loopback.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    token: str | None = None
