"""The page in a real browser: `make test-browser`. Not collected by name, so that the suite needs
neither Chromium nor Playwright. CHROMIUM names the browser's program (else /usr/bin/chromium).
"""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, ViewportSize, expect, sync_playwright

from autonomy.service.server import listening_socket

pytestmark = pytest.mark.integration
PATIENCE_MS = 60_000
WIDE: ViewportSize = {"width": 1280, "height": 800}
NARROW: ViewportSize = {"width": 360, "height": 740}


class Service:
    """`autonomy serve` on one port, started as often as needed."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        with listening_socket("127.0.0.1", 0) as free:
            self.port = int(free.getsockname()[1])
        self.url = f"http://127.0.0.1:{self.port}/"
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        command = [sys.executable, "-m", "autonomy.cli", "serve", "--sim", "empty"]
        command += ["--port", str(self.port), "--log-dir", str(self._folder / "logs")]
        said = self._folder / "said.txt"
        with said.open("ab") as file:
            self._process = subprocess.Popen(command, stderr=file)
        ends_s = time.monotonic() + 60.0
        while "ready:" not in said.read_text():
            assert time.monotonic() < ends_s, said.read_text()
            time.sleep(0.1)
        said.rename(said.with_suffix(".old"))

    def end(self) -> None:
        if self._process is not None:
            self._process.send_signal(signal.SIGTERM)
            self._process.wait(90.0)
            self._process = None


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("service"))
    service.start()
    yield service
    service.end()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        program = os.environ.get("CHROMIUM", "/usr/bin/chromium")
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def page(browser: Browser, service: Service) -> Iterator[Page]:
    complaints: list[str] = []
    page = browser.new_page(viewport=WIDE)
    page.set_default_timeout(PATIENCE_MS)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    page.goto(service.url)
    expect(page.locator("#phase")).to_have_text("ready", timeout=PATIENCE_MS)
    yield page
    page.close()
    lost = re.compile("WebSocket connection|ERR_CONNECTION|status of 422")
    assert [text for text in complaints if not lost.search(text)] == []


def click_goal(page: Page) -> None:
    """A click a little north-east of the middle of the map."""
    box = page.locator("#map").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] * 0.55, box["y"] + box["height"] * 0.4)


def test_the_page_shows_what_the_service_knows(page: Page) -> None:
    expect(page.locator("#why")).to_contain_text("is ready for a mission")
    expect(page.locator("#beams li")).to_have_count(6)
    expect(page.locator("#beams .ok")).to_have_count(6)
    expect(page.locator("#n-link")).to_have_text("ok")
    expect(page.locator("#link-lost")).to_be_hidden()


def test_a_click_asks_before_it_flies_and_stop_ends_it(page: Page) -> None:
    click_goal(page)
    expect(page.locator("#ask")).to_be_visible()
    page.click("#ask-cancel")
    expect(page.locator("#ask")).to_be_hidden()
    expect(page.locator("#phase")).to_have_text("ready")

    click_goal(page)
    page.fill("#ask-north", "500")
    page.click("#ask-fly")
    expect(page.locator("#ask-error")).to_contain_text("outside the geofence")
    page.fill("#ask-north", "1.5")
    page.fill("#ask-east", "0.5")
    page.click("#ask-fly")
    expect(page.locator("#phase")).to_have_text("flying", timeout=PATIENCE_MS)
    expect(page.locator("#n-state")).to_have_text("cruise", timeout=PATIENCE_MS)
    expect(page.locator("#events")).to_contain_text("looking around first")
    click_goal(page)
    expect(page.locator("#said")).to_contain_text("a mission is being flown")

    page.click("#stop")
    expect(page.locator("#why")).to_contain_text("stopped by the operator")
    expect(page.locator("#phase")).to_have_text("ready", timeout=PATIENCE_MS)
    expect(page.locator("#flights")).to_contain_text("aborted")


def test_everything_can_be_done_with_the_keyboard(page: Page) -> None:
    page.locator("#map").focus()
    for _ in range(8):
        page.keyboard.press("ArrowUp")
    page.keyboard.press("Enter")
    expect(page.locator("#ask")).to_be_visible()
    expect(page.locator("#ask-cancel")).to_be_focused()
    page.keyboard.press("Escape")
    expect(page.locator("#ask")).to_be_hidden()
    expect(page.locator("#map")).to_be_focused()
    page.keyboard.press("ArrowUp")
    page.keyboard.press("Enter")
    page.keyboard.press("Tab")
    expect(page.locator("#ask-fly")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("#ask-error")).to_be_empty()
    expect(page.locator("#ask")).to_be_hidden()
    expect(page.locator("#n-state")).to_have_text("cruise", timeout=PATIENCE_MS)
    page.keyboard.press("s")
    expect(page.locator("#phase")).to_have_text("ready", timeout=PATIENCE_MS)


def test_on_a_narrow_screen_stop_stays_in_reach_and_nothing_sticks_out(page: Page) -> None:
    page.set_viewport_size(NARROW)
    for where in (0, 400, 5000):
        page.mouse.wheel(0, where)
        expect(page.locator("#stop")).to_be_in_viewport(ratio=1.0)
    width = page.evaluate("document.documentElement.scrollWidth")
    assert width <= NARROW["width"]
    box = page.locator("#stop").bounding_box()
    assert box is not None
    assert box["height"] >= 44


def test_the_page_comes_back_when_the_service_does(page: Page, service: Service) -> None:
    service.end()
    expect(page.locator("#link-lost")).to_be_visible(timeout=PATIENCE_MS)
    page.click("#stop")
    expect(page.locator("#said")).to_contain_text("stop did not reach the service")
    service.start()
    expect(page.locator("#link-lost")).to_be_hidden(timeout=PATIENCE_MS)
    expect(page.locator("#phase")).to_have_text("ready", timeout=PATIENCE_MS)
