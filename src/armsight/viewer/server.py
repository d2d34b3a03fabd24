"""Starts viser behind access control, on exactly the port that was asked for, without chatter."""

from __future__ import annotations

import contextlib
import errno
import secrets
import socket
import threading
from collections.abc import Iterator
from typing import Any

import rich
import viser
import websockets.asyncio.server

from armsight.errors import UsageError, ViewerError
from armsight.viewer.access import LEAST_TOKEN, AccessControl, is_loopback

_opening = threading.Lock()


def new_token() -> str:
    """A token that cannot be guessed."""
    return secrets.token_urlsafe(18)


LARGEST_PORT = 65535


def open_server(host: str, port: int, token: str | None, label: str) -> viser.ViserServer:
    """A viser server that listens on ``host:port`` only, with every request checked.

    Args:
        host: ``127.0.0.1`` unless the user named another.
        port: 0 takes a free one.
        token: needed beyond loopback; refused there when absent or short.
        label: title of the page.

    Raises:
        UsageError: no token beyond loopback, or one that is too short; no such port.
        ViewerError: the port is in use, or the host is none of this machine's.
    """
    if token is None and not is_loopback(host):
        raise UsageError(
            f"the page may listen on {host} only with a token, as others can reach it there; "
            "give one (--token), or keep to 127.0.0.1"
        )
    if token is not None and len(token) < LEAST_TOKEN:
        raise UsageError(f"the page's token must have at least {LEAST_TOKEN} characters")
    if not 0 <= port <= LARGEST_PORT:  # the system would take its remainder, without a word
        raise UsageError(f"--port is {port}; expected 0 to {LARGEST_PORT} (0 takes a free one)")
    listener = _listen(host, port)
    access = AccessControl(host, listener.getsockname()[1], token)
    try:
        with _opening, _checked(access, listener) as passed, quiet():
            server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    except BaseException:
        listener.close()
        raise
    if not (passed and _takes_values_only(server)):
        server.stop()
        listener.close()
        raise ViewerError(
            f"viser {viser.__version__} starts its server in another way than armsight knows, so "
            "its page cannot be protected; install the locked version (./run does)"
        )
    # viser can publish a page through a public tunnel; whoever may look must not be able to.
    server.request_share_url = _no_tunnel  # type: ignore[method-assign]
    return server


def _takes_values_only(server: viser.ViserServer) -> bool:
    """Let browsers give a field its value, or press it, and no more; whether that could be done.

    viser lets them set whatever a field has, for all pages: its label, whether it is grey, the
    functions that it calls. Files, which no field here asks for, it keeps in memory.
    """
    handlers = getattr(server.gui._websock_interface, "_incoming_handlers", {})
    update, *files = (
        getattr(viser._messages, name, None)
        for name in ("GuiUpdateMessage", "FileTransferStartUpload", "FileTransferPart")
    )
    known = handlers.pop(update, [])

    async def take(client: Any, message: Any) -> None:
        if set(message.updates) == {"value"}:
            for handler in known:
                await handler(client, message)

    handlers[update] = [take]
    return len(known) == 1 and all(handlers.pop(kind, None) is not None for kind in files)


def stop_server(server: viser.ViserServer) -> None:
    """End a server without a word."""
    with quiet():
        server.stop()
        thread = getattr(getattr(server, "_websock_server", None), "_server_thread", None)
        if thread is not None:
            thread.join(timeout=3.0)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep viser from printing: armsight says itself where the page is."""
    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


def _no_tunnel(verbose: bool = True) -> None:
    return None


def _listen(host: str, port: int) -> socket.socket:
    try:
        family, _, _, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listener = socket.socket(family, socket.SOCK_STREAM)
    except (OSError, OverflowError) as error:
        raise ViewerError(f"the page cannot listen on {host}:{port}: {error}") from error
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(64)
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise ViewerError(
                f"port {port} is in use on {host}, perhaps by another armsight; "
                f"end that, or choose another with --port {port + 1} (--port 0 takes a free one)"
            ) from error
        raise ViewerError(
            f"the page cannot listen on {host}:{port}: {error.strerror}; "
            "choose an address of this machine, and a port above 1023"
        ) from error
    return listener


@contextlib.contextmanager
def _checked(access: AccessControl, listener: socket.socket) -> Iterator[list[bool]]:
    """While open, the next websocket server listens on our socket and asks ``access`` first.

    viser offers no hook for either. The list that is given tells whether it came to that.
    """
    serve = websockets.asyncio.server.serve
    passed: list[bool] = []

    def checked(handler: Any, host: Any = None, port: Any = None, **options: Any) -> Any:
        inner = options.pop("process_request")

        def process_request(connection: Any, request: Any) -> Any:
            refusal = access.check(request.path, request.headers)
            return inner(connection, request) if refusal is None else refusal

        passed.append(True)
        return serve(handler, sock=listener, process_request=process_request, **options)

    websockets.asyncio.server.serve = checked  # type: ignore[assignment,misc]
    try:
        yield passed
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
