"""The overview in a browser: it shows what the cell says, notices when nothing comes, and comes back by itself."""

import os
import signal
import time
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from dtwin.services import runfile
from tests.support.desk import Desk
from tests.support.waiting import until


@pytest.fixture(scope="module")
def pace() -> str:
    return "realtime"


@pytest.fixture(scope="module")
def services() -> tuple[str, ...]:
    return ("--monitoring",)


def test_the_overview_shows_what_the_cell_says(console_page: Page) -> None:
    page = console_page
    expect(page.locator("#doing")).to_contain_text("The arm")
    for service in ("emulator", "bridge", "monitoring", "console"):
        expect(page.get_by_role("cell", name=service, exact=True)).to_be_visible()
    expect(page.get_by_text("Real-time factor")).to_be_visible()
    value = page.locator(".joints .value").first
    before = value.inner_text()
    expect(value).not_to_have_text(before, timeout=60_000)


def test_the_arm_is_drawn(console_page: Page) -> None:
    painted = """() => {
        const canvas = document.querySelector("canvas.arm");
        const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
        return data.some((value, index) => index % 4 === 3 && value > 0);
    }"""
    until(lambda: console_page.evaluate(painted), "the arm is drawn")


def test_frames_come_twenty_times_a_second(console_page: Page) -> None:
    counted = console_page.evaluate("""async () => {
        const { store } = await import("/static/js/store.js");
        let count = 0;
        store.addEventListener("frame", () => { count += 1; });
        const begun = performance.now();
        while (count < 60) await new Promise((resolve) => setTimeout(resolve, 20));
        return 60 / ((performance.now() - begun) / 1000);
    }""")
    assert 10 < counted < 25


def watch_connection(page: Page) -> None:
    """Has the page note when it says that the console is gone, ms since 1970."""
    page.evaluate("""() => {
        window.lostAt = null;
        new MutationObserver((_, observer) => {
            if (!document.getElementById("live").textContent.includes("no connection")) return;
            window.lostAt = Date.now();
            observer.disconnect();
        }).observe(document.getElementById("live"), { childList: true, characterData: true, subtree: true });
    }""")


def until_noticed(page: Page, process: int, sign: signal.Signals) -> float:
    """Time from a signal to the console until the page says that it is gone, by the page's own clock, s."""
    watch_connection(page)
    sent = time.time()
    os.kill(process, sign)
    noticed: float = until(lambda: page.evaluate("window.lostAt"), "the page says that the console is gone")
    return noticed / 1000 - sent


def test_a_killed_console_is_noticed_and_comes_back(console_page: Page, cell: Desk) -> None:
    """The page says so within 2 s, the cell goes on meanwhile, and the page comes back without a hand."""
    tick = cell.tick()
    assert until_noticed(console_page, cell.find("dtwin.services.console"), signal.SIGKILL) < 2.0
    expect(console_page.locator("#alarm-line")).to_contain_text("it comes back by itself")
    assert cell.tick() > tick
    expect(console_page.locator("#live")).to_have_text("● live", timeout=30_000)


def test_a_console_that_hangs_is_noticed_and_comes_back(console_page: Page, cell: Desk) -> None:
    """Its connections stay open, so that only the silence tells; the cell goes on."""
    tick = cell.tick()
    number = cell.find("dtwin.services.console")
    try:
        assert until_noticed(console_page, number, signal.SIGSTOP) < 2.0
        assert cell.tick() > tick
    finally:
        os.kill(number, signal.SIGCONT)
    expect(console_page.locator("#live")).to_have_text("● live", timeout=30_000)


def test_stale_values_are_marked_and_lock_what_depends_on_them(console_page: Page, cell: Desk) -> None:
    page = console_page
    page.get_by_role("button", name="Occupy the desk").click()
    expect(page.get_by_role("button", name="Leave the desk")).to_be_visible()
    number = cell.find("dtwin.services.emulator")
    os.kill(number, signal.SIGSTOP)
    try:
        expect(page.locator("#live")).to_contain_text("stale", timeout=10_000)
        expect(page.locator("body")).to_have_class("stale")
        expect(page.get_by_role("button", name="Release the arm")).to_have_attribute("aria-disabled", "true")
        expect(page.locator("#why-release-release-the-arm")).to_contain_text("older than 1 s")
        expect(page.get_by_role("button", name="Stop the arm")).to_have_attribute("aria-disabled", "false")
    finally:
        os.kill(number, signal.SIGCONT)
    expect(page.locator("#live")).to_have_text("● live", timeout=20_000)
    page.get_by_role("button", name="Leave the desk").click()
    expect(page.get_by_role("button", name="Occupy the desk")).to_be_visible()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_both_themes_follow_the_system(cell: Desk, open_page: Callable[..., Page], scheme: str) -> None:
    page = open_page(runfile.require("cell").console, color_scheme=scheme)
    expect(page.locator("html")).to_have_attribute("data-theme", scheme)
    page.locator("#theme").click()
    expect(page.locator("html")).not_to_have_attribute("data-theme", scheme)
