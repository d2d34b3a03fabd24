"""Who gets in: this machine's own browser on our own page, or whoever brings the token."""

from __future__ import annotations

import http.client
import socket

import pytest
import viser
import websockets.exceptions
from hypothesis import given
from hypothesis import strategies as st
from page_fakes import FakeSession
from page_watching import watching

from armsight.errors import UsageError, ViewerError
from armsight.viewer import LivePage, new_token, server
from armsight.viewer.access import COOKIE, AccessControl, is_loopback

TOKEN = "correct-horse-battery"


def status(access: AccessControl, path: str = "/", **headers: str) -> int:
    answer = access.check(path, {"Host": "127.0.0.1:8080"} | headers)
    return 200 if answer is None else answer.status_code


@pytest.mark.parametrize(
    ("host", "own"),
    [("127.0.0.1", True), ("127.8.0.1", True), ("::1", True), ("[::1]", True), ("localhost", True),
     ("0.0.0.0", False), ("192.168.1.7", False), ("::", False), ("localhost.evil.com", False)],
)  # fmt: skip
def test_what_is_loopback(host: str, own: bool) -> None:
    assert is_loopback(host) is own


@pytest.mark.parametrize(
    ("host", "code"),
    [("127.0.0.1:8080", 200), ("localhost:8080", 200), ("[::1]:8080", 200), ("evil.com", 403),
     ("evil.com:8080", 403), ("", 403), ("127.0.0.1.evil.com:8080", 403)],
)  # fmt: skip
def test_loopback_answers_to_its_own_names_only(host: str, code: int) -> None:
    """DNS rebinding: a stranger's name that resolves to this machine."""
    assert status(AccessControl("127.0.0.1", 8080, None), Host=host) == code


@pytest.mark.parametrize(
    ("origin", "code"),
    [("http://127.0.0.1:8080", 200), ("http://evil.com", 403), ("null", 403),
     ("http://127.0.0.1:9999", 403)],
)  # fmt: skip
def test_other_sites_are_refused(origin: str, code: int) -> None:
    """Cross-site websockets: a stranger's page in the user's own browser."""
    assert status(AccessControl("127.0.0.1", 8080, None), Origin=origin) == code
    assert (
        status(
            AccessControl("0.0.0.0", 8080, TOKEN), Origin=origin, Cookie=f"{COOKIE}_8080={TOKEN}"
        )
        == code
    )


def test_the_token_moves_into_a_cookie() -> None:
    access = AccessControl("0.0.0.0", 8080, TOKEN)
    assert status(access) == 401
    assert status(access, f"/?token={TOKEN}x") == 401
    answer = access.check(f"/?token={TOKEN}", {"Host": "cell.lan:8080"})
    assert answer is not None
    assert (answer.status_code, answer.headers["Location"]) == (303, "/")
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert status(access, Cookie=cookie.split(";")[0]) == 200
    assert status(access, Cookie=f"{COOKIE}_8081={TOKEN}") == 401


@given(st.text(max_size=40).filter(lambda text: text != TOKEN))
def test_no_other_token_opens(given_token: str) -> None:
    access = AccessControl("0.0.0.0", 8080, TOKEN)
    assert status(access, f"/?token={given_token}") == 401
    assert status(access, Cookie=f"{COOKIE}_8080={given_token}") == 401


def get(page: LivePage, path: str = "/", **headers: str) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=20)
    connection.request("GET", path, headers=headers)
    response = connection.getresponse()
    return response.status, response.read()


def test_the_page_is_served(page: LivePage) -> None:
    code, body = get(page)
    assert code == 200
    assert b"<html" in body.lower()
    assert page.url == f"http://127.0.0.1:{page.port}/"
    assert get(page, Host="evil.com")[0] == 403
    assert get(page, "/../../etc/passwd")[0] == 404


def test_a_page_for_others_needs_its_token(session: FakeSession) -> None:
    page = LivePage(session, "0.0.0.0", 0, TOKEN)
    try:
        assert page.url == f"http://localhost:{page.port}/?token={TOKEN}"
        code, body = get(page)
        assert code == 401
        assert b"a token is needed" in body
        assert get(page, f"/?token={TOKEN}")[0] == 303
        cookie = f"{COOKIE}_{page.port}={TOKEN}"
        assert get(page, Cookie=cookie)[0] == 200
        with pytest.raises(websockets.exceptions.InvalidStatus) as refused, watching(page):
            pass
        assert refused.value.response.status_code == 401
        with watching(page, additional_headers={"Cookie": cookie}) as client:
            assert client.recv()
    finally:
        page.close()


def test_a_strangers_websocket_is_refused(page: LivePage) -> None:
    with (
        pytest.raises(websockets.exceptions.InvalidStatus) as refused,
        watching(page, origin="http://evil.com"),
    ):
        pass
    assert refused.value.response.status_code == 403
    with watching(page, origin=f"http://127.0.0.1:{page.port}") as client:
        assert client.recv()


def test_beyond_loopback_a_token_is_a_must(session: FakeSession) -> None:
    with pytest.raises(UsageError, match=r"only with a token.*--token"):
        LivePage(session, "0.0.0.0", 0)
    with pytest.raises(UsageError, match="at least 12 characters"):
        LivePage(session, "0.0.0.0", 0, "1234")
    assert len(new_token()) >= 24
    assert new_token() != new_token()


def test_a_port_in_use_is_named(page: LivePage, session: FakeSession) -> None:
    with pytest.raises(ViewerError, match=rf"port {page.port} is in use.*--port {page.port + 1}"):
        LivePage(session, port=page.port)
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(ViewerError, match=f"port {port} is in use"):
            LivePage(session, port=port)


@pytest.mark.parametrize("port", [-1, 65536, 80000])
def test_a_port_that_there_is_not_is_told(session: FakeSession, port: int) -> None:
    """80000 was served at 14464, its remainder."""
    with pytest.raises(UsageError, match=f"--port is {port}; expected 0 to 65535"):
        LivePage(session, port=port)


def test_addresses_of_others_are_refused(session: FakeSession) -> None:
    with pytest.raises(ViewerError, match="choose an address of this machine"):
        LivePage(session, "192.0.2.1", 0, TOKEN)
    with pytest.raises(ViewerError, match="cannot listen on no"):
        LivePage(session, "no.such.host.invalid", 0, TOKEN)


def test_a_page_frees_its_port(session: FakeSession) -> None:
    page = LivePage(session, port=0)
    port = page.port
    page.close()
    page.close()
    again = LivePage(session, port=port)
    assert again.port == port
    again.close()


def test_nobody_can_open_a_tunnel(page: LivePage) -> None:
    assert page._server.request_share_url() is None


def test_an_unknown_viser_is_not_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Should viser stop asking our access control, the page must not open unprotected."""

    class Other:
        def __init__(self, **_: object) -> None:
            self.stopped = False

        def stop(self) -> None:
            self.stopped = True

    monkeypatch.setattr(viser, "ViserServer", Other)
    with pytest.raises(ViewerError, match="cannot be protected"):
        server.open_server("127.0.0.1", 0, None, "x")
