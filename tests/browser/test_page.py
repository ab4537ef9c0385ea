"""The page in Debian's Chromium, against the service and its simulated PX4.

What is waited for is always something that the page shows: nothing sleeps, and nothing is a
matter of how fast this computer is.
"""

import re
import threading
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, Route, ViewportSize, expect

from tests.support.browsing import Service, chromium
from tests.support.recorded import fly

pytestmark = pytest.mark.browser
PATIENCE_MS = 180_000
WIDE: ViewportSize = {"width": 1280, "height": 800}
NARROW: ViewportSize = {"width": 360, "height": 740}
LOW = "mission: {altitude_m: 0.6}\n"
"""Quickly up and down."""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("service"), config=LOW)
    service.logs.mkdir()
    fly(service.logs, scenario="default")
    service.start()
    yield service
    service.end()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture
def page(browser: Browser, service: Service) -> Iterator[Page]:
    complaints: list[str] = []
    page = browser.new_page(viewport=WIDE)
    page.set_default_timeout(PATIENCE_MS)
    expect.set_options(timeout=PATIENCE_MS)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    page.goto(service.url)
    expect(page.locator("#phase")).to_have_text("ready")
    yield page
    page.close()
    lost = re.compile("WebSocket connection|ERR_CONNECTION|status of 42[29]")
    assert [text for text in complaints if not lost.search(text)] == []


def click_goal(page: Page) -> None:
    """A click a little north-east of the middle of the map."""
    box = page.locator("#map").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] * 0.55, box["y"] + box["height"] * 0.4)


def pixels(page: Page) -> str:
    """What the map shows, as data."""
    drawn = page.evaluate("() => document.getElementById('map').toDataURL()")
    return str(drawn)


def test_the_page_shows_what_the_service_knows(page: Page) -> None:
    expect(page.locator("#why")).to_contain_text("is ready for a mission")
    expect(page.locator("#beams li")).to_have_count(6)
    expect(page.locator("#beams .ok")).to_have_count(6)
    expect(page.locator("#n-link")).to_have_text("ok")
    expect(page.locator("#link-lost")).to_be_hidden()
    expect(page.locator("#faults-box")).to_be_hidden()
    expect(page.locator("#scenario")).to_have_text("simulated: empty")


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
    expect(page.locator("#phase")).to_have_text("flying")
    click_goal(page)
    expect(page.locator("#said")).to_contain_text("a mission is being flown")
    expect(page.locator("#n-state")).to_have_text("takeoff")

    page.click("#stop")
    expect(page.locator("#why")).to_contain_text("stopped by the operator")
    expect(page.locator("#phase")).to_have_text("ready")
    expect(page.locator("#flights")).to_contain_text("aborted")


def test_a_flight_is_flown_with_the_keyboard_alone_and_watched_to_its_goal(page: Page) -> None:
    page.locator("#map").focus()
    for _ in range(6):
        page.keyboard.press("ArrowUp")
    page.keyboard.press("Enter")
    expect(page.locator("#ask")).to_be_visible()
    expect(page.locator("#ask-cancel")).to_be_focused()
    page.keyboard.press("Escape")
    expect(page.locator("#ask")).to_be_hidden()
    expect(page.locator("#map")).to_be_focused()
    page.keyboard.press("Enter")
    page.keyboard.press("Tab")
    expect(page.locator("#ask-fly")).to_be_focused()
    before = pixels(page)
    page.keyboard.press("Enter")
    expect(page.locator("#ask")).to_be_hidden()
    expect(page.locator("#n-state")).to_have_text("cruise")
    expect(page.locator("#events")).to_contain_text("looking around first")
    expect(page.locator("#n-togo")).to_contain_text("m")
    expect(page.locator("#n-guard")).not_to_be_empty()
    assert pixels(page) != before
    expect(page.locator("#phase")).to_have_text("ready")
    expect(page.locator("#events")).to_contain_text("goal")
    expect(page.locator("#flights li").first).to_contain_text("goal reached")
    expect(page.locator("#n-mode")).to_have_text("disarmed")


def test_a_past_flight_is_looked_back_at_with_the_keyboard(page: Page) -> None:
    flight = page.locator("#flights li").last
    flight.get_by_role("button", name="Look back at").focus()
    page.keyboard.press("Enter")
    expect(page.locator("#back")).to_be_visible()
    expect(page.locator("#back-slider")).to_be_focused()
    expect(page.locator("#back-time")).to_contain_text("0.0 of")
    page.keyboard.press("ArrowRight")
    expect(page.locator("#back-time")).to_contain_text("0.1 of")
    start = pixels(page)
    page.keyboard.press("End")
    expect(page.locator("#n-state")).to_have_text("done")
    assert pixels(page) != start
    page.locator("#back-before").press("Enter")
    expect(page.locator("#events li.later")).to_have_count(1)
    said = page.locator("#why").inner_text()
    page.locator("#events button", has_text="looking around first").first.press("Enter")
    expect(page.locator("#why")).not_to_have_text(said)
    click_goal(page)
    expect(page.locator("#said")).to_contain_text("this is a past flight")
    expect(page.locator("#stop")).to_be_in_viewport(ratio=1.0)
    page.locator("#back-slider").press("Escape")
    expect(page.locator("#back")).to_be_hidden()
    expect(page.locator("#why")).not_to_have_text(said)
    expect(page.locator("#n-state")).to_have_text("ready")


def test_reading_a_past_flight_shows_how_far_it_is_and_can_be_taken_back(page: Page) -> None:
    """The service's own answer is held back, as that of a flight of hours would be."""
    waiting = threading.Event()
    page.route("**/reel", lambda _: waiting.set())
    flight = page.locator("#flights li").last
    button = flight.get_by_role("button", name="Look back at")
    name = (button.get_attribute("aria-label") or "").removeprefix("Look back at ")
    page.route("**/v1/reading", lambda route: route.fulfill(json={"log": name, "share": 0.42}))
    button.click()
    expect(page.locator("#reading-name")).to_have_text(name)
    expect(page.locator("#reading-share")).to_have_js_property("value", 0.42)
    expect(page.locator("#stop")).to_be_in_viewport(ratio=1.0)
    assert waiting.is_set()
    page.click("#reading-cancel")
    expect(page.locator("#reading")).to_be_hidden()
    expect(page.locator("#said")).to_contain_text("is not read any further")
    expect(page.locator("#back")).to_be_hidden()
    page.unroute_all()
    asked: list[Route] = []

    def busy_at_first(route: Route) -> None:
        asked.append(route)
        if len(asked) == 1:
            route.fulfill(status=429, json={"error": "another flight is being read just now"})
        else:
            route.continue_()

    page.route("**/reel", busy_at_first)
    page.evaluate("() => { delete AbortSignal.any; }")  # as in browsers of 2023
    button.click()
    expect(page.locator("#back-time")).to_contain_text("0.0 of")
    assert len(asked) == 2
    page.click("#back-live")


def test_the_legend_names_everything_that_is_drawn(page: Page) -> None:
    page.locator("#legend summary").click()
    legend = page.locator("#legend")
    for word in (
        "discrete",
        "continuous",
        "keep-out",
        "tangent",
        "hyperbola",
        "not chosen",
        "beam that hits",
        "geofence",
        "flown",
        "goal",
        "bars the way",
        "moves",
    ):
        expect(legend).to_contain_text(word)
    page.set_viewport_size(NARROW)
    box, view = legend.bounding_box(), page.locator("#view").bounding_box()
    assert box is not None
    assert view is not None
    assert view["y"] <= box["y"]
    assert box["x"] + box["width"] <= NARROW["width"]


def test_a_past_flight_has_its_report_as_a_page_of_its_own(page: Page) -> None:
    with page.expect_popup() as opened:
        page.locator("#flights li").last.get_by_role("button", name="Report of").click()
    report = opened.value
    expect(report.locator("h1")).to_contain_text("goal reached")
    expect(report.locator("svg").first).to_be_visible()
    report.close()


def test_on_a_narrow_screen_stop_stays_in_reach_and_nothing_sticks_out(page: Page) -> None:
    page.set_viewport_size(NARROW)
    page.locator("#flights li").last.get_by_role("button", name="Look back at").click()
    expect(page.locator("#back-time")).to_contain_text("0.0 of")
    for where in (0, 400, 5000):
        page.mouse.wheel(0, where)
        expect(page.locator("#stop")).to_be_in_viewport(ratio=1.0)
    width = page.evaluate("document.documentElement.scrollWidth")
    assert width <= NARROW["width"]
    for name in ("#stop", "#back-play", "#back-live"):
        box = page.locator(name).bounding_box()
        assert box is not None
        assert box["height"] >= 44
    page.click("#back-live")
    expect(page.locator("#back")).to_be_hidden()


def test_the_page_comes_back_when_the_service_does(page: Page, service: Service) -> None:
    service.end()
    expect(page.locator("#link-lost")).to_be_visible()
    page.click("#stop")
    expect(page.locator("#said")).to_contain_text("stop did not reach the service")
    service.start()
    expect(page.locator("#link-lost")).to_be_hidden()
    expect(page.locator("#phase")).to_have_text("ready")
    expect(page.locator("#why")).to_contain_text("is ready for a mission")
