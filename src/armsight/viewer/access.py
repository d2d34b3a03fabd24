"""Who may see the page: this machine's own browser, or whoever brings the token.

The page can pause, drag and reset, so a stranger's web page must not reach it through the user's
browser either. Every request, the websocket's included, is asked three things: was it sent to this
server by a name that is ours (DNS rebinding), does it come from our own page (cross-site
websockets), and, where the page listens beyond loopback, does it carry the token.
"""

from __future__ import annotations

import hmac
import http
import ipaddress
from collections.abc import Mapping
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Response

COOKIE = "armsight_token"
LEAST_TOKEN = 12
"""A token shorter than this can be guessed [characters]."""


def is_loopback(host: str) -> bool:
    """Whether a host name or address is this machine itself and nobody else."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host.lower() == "localhost"


class AccessControl:
    """Decides on each request before viser sees it.

    Args:
        host: that the server listens on.
        port: likewise.
        token: needed by everyone, or None for loopback.
    """

    def __init__(self, host: str, port: int, token: str | None) -> None:
        self._loopback = is_loopback(host)
        self._port = port
        self._token = token
        self._cookie = f"{COOKIE}_{port}"

    def check(self, path: str, headers: Mapping[str, str]) -> Response | None:
        """None to let a request in, else the answer that it gets."""
        host = headers.get("Host", "")
        if self._loopback and not is_loopback(urlsplit(f"//{host}").hostname or ""):
            return _refuse("this page answers to localhost only")
        origin = headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return _refuse("requests from other sites are refused")
        if self._token is None:
            return None
        given = parse_qs(urlsplit(path).query).get("token", [""])[0]
        if given and self._same(given):
            # The token moves from the address bar, which people share, into a cookie.
            return self._welcome()
        if self._same(self._from_cookie(headers.get("Cookie", ""))):
            return None
        return _refuse(
            "a token is needed: open the address that armsight printed, with ?token=...",
            http.HTTPStatus.UNAUTHORIZED,
        )

    def _same(self, given: str) -> bool:
        return self._token is not None and hmac.compare_digest(given.encode(), self._token.encode())

    def _from_cookie(self, header: str) -> str:
        try:
            morsel = SimpleCookie(header).get(self._cookie)
        except CookieError:
            return ""
        return "" if morsel is None else morsel.value

    def _welcome(self) -> Response:
        cookie: SimpleCookie = SimpleCookie()
        cookie[self._cookie] = self._token or ""
        cookie[self._cookie]["httponly"] = True
        cookie[self._cookie]["samesite"] = "Strict"
        cookie[self._cookie]["path"] = "/"
        headers = Headers()
        headers["Location"] = "/"
        headers["Set-Cookie"] = cookie[self._cookie].OutputString()
        headers["Cache-Control"] = "no-store"
        headers["Content-Length"] = "0"
        return Response(http.HTTPStatus.SEE_OTHER, "See Other", headers, b"")


def _refuse(why: str, status: http.HTTPStatus = http.HTTPStatus.FORBIDDEN) -> Response:
    body = f"armsight: {why}\n".encode()
    headers = Headers()
    headers["Content-Type"] = "text/plain; charset=utf-8"
    headers["Content-Length"] = str(len(body))
    return Response(status, status.phrase, headers, body)
