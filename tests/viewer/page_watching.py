"""Counts as one who watches a page, without a browser."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import Any

import msgspec
import viser
from websockets.sync.client import connect

from armsight.viewer import LivePage


@contextlib.contextmanager
def watching(page: LivePage, **options: Any) -> Iterator[Any]:
    """A websocket client that said where its camera is: only then does viser count it."""
    hello = {
        "type": "ViewerCameraMessage",
        "wxyz": (1.0, 0.0, 0.0, 0.0),
        "position": (3.0, 0.0, 1.0),
        "image_height": 600,
        "image_width": 800,
        "fov": 0.8,
        "near": 0.01,
        "far": 1000.0,
        "look_at": (0.0, 0.0, 0.0),
        "up_direction": (0.0, 0.0, 1.0),
    }
    with connect(
        f"ws://127.0.0.1:{page.port}/",
        subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
        max_size=None,
        **options,
    ) as client:
        client.send(msgspec.msgpack.encode(hello))
        wait_for(lambda: page._server.get_clients())
        yield client


def wait_for(what: Any, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.02)
