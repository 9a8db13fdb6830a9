"""What the page says and asks: two answers to a finding, what is in force, units, empty tables; all is made up."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, expect

from dtwin.bus.twin_messages import MonitoringVerdict, WatchState
from dtwin.console.console import words
from tests.support.pages.made_up import MadeUp, settings, state, verdict


@pytest.fixture
def made_up(browser: Browser) -> Iterator[MadeUp]:
    with browser.new_context(viewport={"width": 1280, "height": 720}) as context:
        yield MadeUp(context.new_page(), state(settings=settings(payload=0.15, target_time=2.5)))


@pytest.fixture(scope="module")
def nobody(browser: Browser) -> Iterator[MadeUp]:
    """A cell of which nobody tells anything."""
    empty = state(services={}, events=(), identification=None, verdict=None, settings=None, boxes=None)
    with browser.new_context() as context:
        yield MadeUp(context.new_page(), empty, entries=[])


def test_to_acknowledge_and_to_learn_are_two_things(made_up: MadeUp) -> None:
    page = made_up.open("monitoring")
    page.get_by_role("button", name="Acknowledge the findings").click()
    expect(page.locator(".answer", has_text="✓ acknowledged: joint 2: K2, joint 3: bias3")).to_be_visible()
    assert made_up.asked == [
        ("/api/alarm/acknowledge", {"name": "finding/joint 2/K2"}),
        ("/api/alarm/acknowledge", {"name": "finding/joint 3/bias3"}),
    ]
    made_up.asked.clear()
    page.get_by_role("button", name="Take as the new normal").click()
    question = page.locator("dialog")
    for told in ("reports this no more", "-90.0 %", "12.3 +- 0.4 mrad", "Nothing is repaired"):
        expect(question).to_contain_text(told)
    assert made_up.asked == []
    page.locator("[data-confirm=yes]").click()
    expect(question).to_have_count(0)
    expect(page.locator(".answer", has_text="✓ done")).to_be_visible()  # the page closes the question before it asks
    assert made_up.asked == [("/api/command/learn", {})]


def test_a_finding_stands_once_with_one_unit(made_up: MadeUp) -> None:
    page = made_up.open("monitoring")
    text = page.locator("main").inner_text()
    assert text.count("-90.0 %") == 1
    assert "-0.9" not in text
    assert "0.0123" not in text


def test_forms_and_searches_begin_with_what_is_in_force(made_up: MadeUp) -> None:
    page = made_up.open("simulation")
    expect(page.get_by_label("Payload, kg")).to_have_value("0.15")
    page.get_by_label("Target time, s").fill("1.1")
    page.get_by_role("button", name="Simulate", exact=True).click()
    expect(page.get_by_role("columnheader", name="in force")).to_be_visible()
    page.get_by_role("button", name="Optimise", exact=True).click()
    expect(page.locator("main")).to_contain_text("there is no search")
    expect(page.locator("main")).to_contain_text("Version 3 is in force. Uploaded at 12.3 s")
    [(_, simulated), (_, searched)] = made_up.asked
    assert [each["target_time"] for each in simulated["candidates"]] == [2.5, 1.1]
    assert searched["target_time"] == 2.5


def test_answers_say_what_is_so_now() -> None:
    assert words(settings()) == "version 3 in force since 12.3 s, on trial"
    assert words(settings(on_trial=False, action="roll back")) == "version 3 in force since 12.3 s"
    assert words(WatchState(False, "the data sheet's arm")) == "the monitor is stopped"
    assert words(WatchState(True, "arm@1")) == "the monitor watches with arm@1"
    healthy = MonitoringVerdict(1.0, {}, (), (), 0, 0)
    assert words(healthy) == "the arm as it is now counts as normal"
    assert words(verdict()).endswith("still told: joint 2 failed, joint 3 may be degrading")


@pytest.mark.parametrize(
    ("display", "why"),
    [
        ("overview", "No service has told how it does."),
        ("overview", "Nothing has happened since the console listens."),
        ("identification", "Nothing has been estimated"),
        ("simulation", "Nobody notes the settings"),
        ("monitoring", "Nobody watches the arm."),
    ],
)
def test_what_is_empty_says_why(nobody: MadeUp, display: str, why: str) -> None:
    expect(nobody.open(display).locator("main")).to_contain_text(why)
