"""The page in a real browser: Chromium draws it, reads it and presses its buttons."""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from page_fakes import FakeSession, make_face
from page_watching import wait_for

from armsight.viewer import LivePage

FLAGS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
SIZE = {"width": 640, "height": 360}
"""Small: without a graphics card every pixel is drawn by the processor, many times a second."""
TOKEN = "correct-horse-battery"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium from $ARMSIGHT_CHROMIUM or the path; skips without."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    found = os.environ.get("ARMSIGHT_CHROMIUM") or next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    if found is None:
        pytest.skip("no Chromium here (Debian: apt-get install chromium)")
    with sync_api.sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=found, args=list(FLAGS))
        except sync_api.Error as error:
            pytest.skip(f"Chromium does not start: {error.message.splitlines()[0]}")
        yield browser
        browser.close()


@pytest.fixture
def running(session: FakeSession, page: LivePage) -> Iterator[LivePage]:
    """The page's loop, ten times a second."""
    end = threading.Event()

    def loop() -> None:
        now, face = 1.0, make_face(1.0)
        while not end.wait(0.1):
            now += 0.1
            session.step(now, face=replace(face, stamp=now))
            page.update(now)

    thread = threading.Thread(target=loop)
    thread.start()
    yield page
    end.set()
    thread.join()


def picture(tab: Any, clip: dict[str, float]) -> np.ndarray:
    raw = tab.screenshot(clip=clip, timeout=90_000)
    return cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_COLOR)


def test_the_page_draws_tells_and_obeys(
    browser: Any, running: LivePage, session: FakeSession
) -> None:
    tab = browser.new_page(viewport=SIZE)
    errors: list[str] = []
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.goto(running.url, timeout=60_000)
    tab.get_by_text("slowed").wait_for(timeout=60_000)
    said = tab.inner_text("body")
    for words in (
        "a hand is <0.4 m from the elbow",
        "to A & B",
        "0.31 m",
        "0.50 m",
        "<left>",
        "no frame for 0.4 s",
        "never calibrated",
        "67.4 mm",
        "no certified safety function",
        "distance and protective distance [m]",
        "Task: keep_above",
        "approach <slow>",
        "target & arm are 12.3 mm apart",
        "12.34 mm",
        "distance, bound [mm]",
        "what it sees",
    ):
        assert words in said, words
    # The scene in the middle is drawn: many colours, not one.
    middle = {"x": 100, "y": 60, "width": 180, "height": 280}

    def drawn() -> bool:
        tab.wait_for_timeout(500)
        pixels = picture(tab, middle)
        return len(np.unique(pixels.reshape(-1, 3) // 16, axis=0)) > 40

    wait_for(drawn, 90.0)
    tab.get_by_role("button", name="Pause").click(timeout=60_000)
    wait_for(lambda: "pause" in session.asked)
    tab.get_by_role("button", name="Reset").click(timeout=60_000)
    wait_for(lambda: "reset" in session.asked)
    tab.get_by_role("button", name="2×").click(timeout=60_000)
    wait_for(lambda: ("speed", 2.0) in session.asked)
    tab.get_by_role("button", name="Go on", exact=True).first.click(timeout=60_000)
    wait_for(lambda: ("press", "go") in session.asked)
    assert tab.get_by_role("button", name="Skip this one").is_disabled()
    assert not errors
    tab.close()


def test_a_browser_that_hears_nothing_more_says_so_by_itself(
    browser: Any, session: FakeSession
) -> None:
    """A connection that hangs is not closed: viser's own page shows what it heard last."""
    page = LivePage(session, port=0)
    tab = browser.new_page(viewport=SIZE)
    try:
        tab.goto(page.url, timeout=60_000)
        tab.get_by_text("slowed").wait_for(timeout=60_000)
        silent = tab.locator(".armsight-silent")

        def seen() -> bool:
            box = silent.bounding_box()
            return box is not None and box["height"] > 10

        wait_for(lambda: not seen(), 20.0)
        page._closed.set()  # nobody updates it any more; the connection stays
        wait_for(seen, 20.0)
        banner = tab.locator(".armsight-live").first

        def grey() -> bool:  # once it has faded
            return "grayscale(1)" in banner.evaluate("e => getComputedStyle(e).filter")

        wait_for(grey, 20.0)
    finally:
        tab.close()
        page._closed.clear()
        page.close()


def test_a_browser_needs_the_token_once(browser: Any, session: FakeSession) -> None:
    page = LivePage(session, "0.0.0.0", 0, TOKEN)
    context = browser.new_context(viewport={"width": 320, "height": 240})
    try:
        tab = context.new_page()
        answer = tab.goto(f"http://localhost:{page.port}/", timeout=60_000)
        assert answer.status == 401
        assert "a token is needed" in tab.inner_text("body")
        tab.goto(page.url, timeout=60_000)
        assert "token" not in tab.url
        tab.get_by_text("slowed").wait_for(timeout=60_000)
        tab.goto(f"http://localhost:{page.port}/", timeout=60_000)
        tab.get_by_text("slowed").wait_for(timeout=60_000)
    finally:
        context.close()
        page.close()


def test_another_sites_page_cannot_reach_ours(browser: Any, page: LivePage) -> None:
    """A stranger's script in the user's browser, opening a websocket to the page."""
    tab = browser.new_page()
    tab.goto("data:text/html,<p>evil</p>")
    came = tab.evaluate(
        """port => new Promise(done => {
            const socket = new WebSocket(`ws://127.0.0.1:${port}/`, "viser-v1.1.1");
            socket.onopen = () => done("open");
            socket.onerror = () => done("refused");
            setTimeout(() => done("silence"), 20000);
        })""",
        page.port,
    )
    assert came == "refused"
    tab.close()
    time.sleep(0.1)
    assert not page._server.get_clients()
