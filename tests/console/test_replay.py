"""A recording is looked at on the displays, step by step, and is never taken for what is live."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.support.desk import Desk
from tests.support.pages.hand import SLOW

LENGTH = 130
"""Length of the recording, s: longer than what the console reads of it at once."""


@pytest.fixture(scope="module")
def pace() -> str:
    return "realtime"


@pytest.fixture(scope="module")
def services() -> tuple[str, ...]:
    return ()


@pytest.fixture(scope="module")
def log(cell: Desk, recordings: Path) -> str:
    """Name of a recording in the console's folder."""
    cell.run("run", "--duration", str(LENGTH), "--log", str(recordings / "work.parquet"))
    return "work.parquet"


def moment(page: Page) -> Locator:
    """What the display says of the moment that is shown."""
    return page.get_by_text(re.compile("^Not live:"))


def shown_at(page: Page) -> float:
    """Plant time that the page names, s."""
    words = moment(page).inner_text()
    return float(re.findall(r"plant time ([\d.]+) s", words)[0])


def test_a_recording_is_stepped_through_and_marked_as_not_live(console_page: Page, log: str) -> None:
    page = console_page
    page.get_by_role("link", name="Replay").click()
    expect(page.get_by_label("Recording", exact=True).locator("option", has_text=log)).to_have_count(1)
    page.get_by_label("Recording", exact=True).select_option(log)
    page.get_by_role("button", name="Look at the recording").click()
    expect(moment(page)).to_contain_text(log, timeout=SLOW)
    assert shown_at(page) == pytest.approx(LENGTH, abs=0.1)
    for steps, wanted in ((3, LENGTH - 3), (-1, LENGTH - 2)):
        for _ in range(abs(steps)):
            page.get_by_role("button", name="◀ 1 s" if steps > 0 else "1 s ▶").click()
        expect(moment(page)).to_contain_text(f"plant time {wanted - 1}.9", timeout=SLOW)
    page.get_by_label("Moment").fill("5")
    expect(moment(page)).to_contain_text("plant time 5.0", timeout=SLOW)
    expect(page.locator("#live")).to_have_text("◷ not live: the past")


def test_a_recording_stays_on_every_display_until_the_present_is_asked_for(console_page: Page, log: str) -> None:
    page = console_page
    page.get_by_role("link", name="Replay").click()
    page.get_by_label("Recording", exact=True).select_option(log)
    page.get_by_role("button", name="Look at the recording").click()
    expect(moment(page)).to_contain_text(log, timeout=SLOW)
    page.get_by_role("link", name="Overview").click()
    expect(page.locator("#live")).to_have_text("◷ not live: the past")
    expect(page.locator("h1")).to_contain_text(log)
    expect(page.locator("#doing")).to_contain_text(f"Recording {log}")
    expect(page.locator("#why-release-release-the-arm")).to_contain_text("not live")
    value = page.locator(".joints .value").first.inner_text()
    page.get_by_role("link", name="Replay").click()
    before = shown_at(page)
    page.get_by_role("button", name="◀ 1 s").click()
    expect(moment(page)).not_to_contain_text(f"{before:.2f} s", timeout=SLOW)
    assert shown_at(page) == pytest.approx(before - 1.0, abs=0.11)
    page.get_by_role("link", name="Overview").click()
    expect(page.locator(".joints .value").first).not_to_have_text(value)
    page.get_by_role("link", name="Replay").click()
    page.get_by_role("button", name="Back to the present").click()
    expect(page.locator("#live")).to_have_text("● live", timeout=SLOW)
