"""The displays of a line in browsers: zones, a zone by selection, the arm of a station, several desks at once."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect

from dtwin.line.file import line_of
from dtwin.parameters import ROOT
from evidence.line.otherwise import Otherwise
from tests.console.test_accessibility import violations
from tests.support.made_up_line import FakeLine, ServedLine, serve_line
from tests.support.pages.hand import SLOW

OTHER = {"a2": "planar-2r", "b1": "six-axis"}
FOREIGN = "<img src=x onerror=alert(1)> & <b>bold</b>"
TALLER = (
    "() => document.documentElement.scrollHeight > innerHeight || document.documentElement.scrollWidth > innerWidth"
)


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedLine]:
    with serve_line(tmp_path) as found:
        yield found


@pytest.fixture
def page(served: ServedLine, open_page: Callable[..., Page]) -> Page:
    """Somebody who looks at the line."""
    found = open_page(served.web.address, "line")
    expect(found.locator("#live")).to_have_text("● live", timeout=SLOW)
    return found


def press(page: Page, name: str, confirmed: bool = False) -> None:
    page.get_by_role("button", name=name, exact=True).click(timeout=SLOW)
    if confirmed:
        page.locator("[data-confirm=yes]").click()


def test_the_line_is_shown_and_a_zone_and_a_station_are_selected(page: Page, served: ServedLine) -> None:
    links = page.locator("nav a")
    expect(links).to_have_text(["Line", "Zone a", "Zone b", "Alarms"])
    block = page.locator("section.block", has_text="Zone a")
    expect(block).to_contain_text("150 boxes/h, could let 200 through; 3 boxes, 1 of 2 vehicles loaded")
    expect(page.get_by_text("Set-up 0 in force")).to_contain_text(
        "deburr at a1 → mark at a2 → test at b1 → pack at b2"
    )
    expect(page.locator("#alarm-line")).to_have_text("nothing abnormal")
    expect(page.locator(".tag.severe, .tag.warn")).to_have_count(0)  # no colour while all is normal
    assert not page.evaluate(TALLER)
    block.get_by_role("link", name="Zone a").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="Zone a")).to_be_visible()
    expect(page.get_by_role("cell", name="n3 › a2_dock")).to_be_visible()
    assert not page.evaluate(TALLER)
    page.get_by_role("link", name="a2", exact=True).click()
    expect(page.get_by_role("heading", name="Station a2")).to_be_visible()
    expect(links).to_have_text(["Line", "Zone a", "Zone b", "Station a2", "Alarms"])
    expect(page.get_by_text("No readings of this arm arrive.")).to_be_visible()
    assert not page.evaluate(TALLER)
    for number in range(1, 500):
        served.line.sample("a2", number)
        if page.get_by_text("● live, ").count():
            break
    expect(page.locator(".readings dd").first).to_have_text("0.10", timeout=SLOW)
    served.clock.ahead += 1.5  # and no reading comes
    expect(page.get_by_text("▲ stale: last sample")).to_be_visible()


ARMS = Otherwise(cells=tuple((at, str(ROOT / f"lines/cells/{arm}.toml")) for at, arm in OTHER.items()))


def test_an_arm_of_another_kind_is_drawn_with_the_joints_that_it_has(
    tmp_path: Path, open_page: Callable[..., Page]
) -> None:
    made = FakeLine(line=ARMS.applied(line_of("default")))
    with serve_line(tmp_path, line=made) as served:
        for station, joints in (("a2", 2), ("b1", 6)):
            page = open_page(served.web.address, f"station/{station}")
            expect(page.get_by_role("heading", name=f"Station {station}")).to_be_visible(timeout=SLOW)
            expect(page.locator(".joints .readings")).to_have_count(joints, timeout=SLOW)
            for number in range(1, 500):
                made.sample_joints(station, number, (0.4, -0.5, 0.6, 0.2, 0.3, -0.1)[:joints])
                if page.get_by_text("● live, ").count():
                    break
            first = page.locator(".readings").first.locator("dd")
            expect(first).to_have_text(["0.40", "10.0", "0.50" if joints == 2 else "0.5"], timeout=SLOW)
            assert not page.evaluate(TALLER)
    made.bus.close()


def test_two_people_have_a_desk_each_and_command_their_own_zone(
    page: Page, served: ServedLine, open_page: Callable[..., Page]
) -> None:
    other = open_page(served.web.address, "zone/b")
    press(page, "Take desk a")
    press(other, "Take desk b")
    expect(page.locator("#desk")).to_contain_text("a yours, b somebody", timeout=SLOW)
    served.line.fail("a2", FOREIGN)
    served.line.fail("b1", "K2 is weak")
    expect(page.locator("#alarm-line")).to_contain_text("a2: the arm is stopped", timeout=SLOW)
    expect(page.get_by_text(FOREIGN)).to_be_visible()  # a text, and nothing else
    page.goto(f"{served.web.address}#zone/b")
    release = page.get_by_role("button", name="Release b1")
    expect(release).to_have_attribute("aria-disabled", "true", timeout=SLOW)
    expect(page.get_by_text("somebody has the desk of zone b")).to_be_visible()
    press(other, "Release b1", confirmed=True)
    expect(other.get_by_role("button", name="Stop b1")).to_be_visible(timeout=SLOW)
    page.goto(f"{served.web.address}#zone/a")
    press(page, "Release a2", confirmed=True)
    expect(page.locator("#alarm-line")).not_to_contain_text("stopped", timeout=SLOW)
    press(page, "Stop a1", confirmed=True)
    expect(page.get_by_role("button", name="Release a1")).to_be_visible(timeout=SLOW)
    assert [each.station for each in served.line.asked] == ["b1", "a2", "a1"]


def test_a_set_up_follows_a_what_if_and_a_proposal_is_approved(page: Page, served: ServedLine) -> None:
    press(page, "Take desk a")
    page.goto(f"{served.web.address}#zone/a")
    set_up = page.get_by_role("button", name="Set up", exact=True)
    page.get_by_label("mark", exact=True).select_option("a1")
    expect(page.get_by_text("ask what it would bring first")).to_be_visible(timeout=SLOW)
    press(page, "What if")
    expect(page.get_by_text("100.0 boxes/h expected, 150.0 with the set-up in force")).to_be_visible(timeout=SLOW)
    set_up.click(timeout=SLOW)
    page.locator("[data-confirm=yes]").click()
    expect(page.get_by_text("set-up 1 in force since")).to_be_visible(timeout=SLOW)
    served.line.propose({"mark": "b1"}, "zone a has little to do")
    page.goto(f"{served.web.address}#line")
    approve = page.get_by_role("button", name="Approve 1")
    expect(approve).to_have_attribute("aria-disabled", "true", timeout=SLOW)
    expect(page.get_by_text("take the desk of zone b first").first).to_be_visible()
    press(page, "Take desk b")
    expect(approve).to_have_attribute("aria-disabled", "false", timeout=SLOW)
    press(page, "Approve 1", confirmed=True)
    expect(page.get_by_text("1. approved, somebody")).to_be_visible(timeout=SLOW)
    assert served.line.state.set_up == {"deburr": "a1", "mark": "b1", "test": "b1", "pack": "b2"}


def test_a_lost_line_is_shown_as_lost(page: Page, served: ServedLine) -> None:
    served.line.bus.close()
    expect(page.locator("#live")).to_have_text(re.compile("▲ stale: last word [0-9]+ s ago"), timeout=SLOW)
    expect(page.locator("#alarm-line")).to_contain_text("the line has ended, or cannot be reached")
    expect(page.locator("body")).to_have_class("stale")
    page.evaluate(Axe().axe_script)
    assert violations(page) == [], "values that are old can still be read"
    page.goto(f"{served.web.address}#zone/c")
    expect(page.get_by_text("There is no zone c.")).to_be_visible()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_violation(served: ServedLine, open_page: Callable[..., Page], scheme: str) -> None:
    served.line.fail("a2", "K2 is weak")
    served.line.state = msgspec.structs.replace(served.line.state, outside=4)
    served.line.propose({"mark": "a1"}, "a2 can do nothing")
    page = open_page(served.web.address, "line", color_scheme=scheme)
    expect(page.get_by_role("button", name="Approve 1")).to_be_visible(timeout=SLOW)
    page.evaluate(Axe().axe_script)
    for display in ("line", "zone/a", "station/a2", "alarms"):
        page.evaluate("(name) => { location.hash = name; }", display)
        expect(page.locator("main")).to_have_attribute("data-display", display.partition("/")[0])
        assert violations(page) == [], display
