"""WCAG 2.1 AA by axe-core on every display in both themes, keyboard alone, and no state by colour alone."""

from collections.abc import Callable
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect

from dtwin.services import runfile
from tests.support.desk import Desk
from tests.support.pages.browsers import DISPLAYS
from tests.support.pages.colours import told_in_words

RULES = {"runOnly": {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]}}
PAINTED = """async (value) => {
    const { drawIndicators } = await import("/static/js/indicator.js");
    const canvas = document.createElement("canvas");
    canvas.className = "indicator";
    document.querySelector("main").append(canvas);
    const context = canvas.getContext("2d");
    const write = context.fillText.bind(context);
    const texts = [];
    context.fillText = (text, ...place) => { texts.push(text); write(text, ...place); };
    drawIndicators(canvas, [{ low: -9, high: 9, value, band: [-4, 4], limits: [-8, 8] }]);
    canvas.remove();
    return texts;
}"""
"""Texts on an indicator with a normal band up to 4 V and a limit of 8 V."""


@pytest.fixture(scope="module")
def pace() -> str:
    return "realtime"


def violations(page: Page) -> list[tuple[str, str]]:
    """What axe-core, which the page has loaded, finds: rule and element; more than ten rules looked at something."""
    found: Any = page.evaluate("(rules) => axe.run(document, rules)", RULES)
    assert len(found["passes"]) > 10
    return [(each["id"], each["nodes"][0]["html"][:200]) for each in found["violations"]]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_violation(cell: Desk, open_page: Callable[..., Page], scheme: str) -> None:
    page = open_page(runfile.require("cell").console, color_scheme=scheme)
    expect(page.locator("#live")).to_have_text("● live", timeout=30_000)
    page.evaluate(Axe().axe_script)
    assert page.evaluate("document.documentElement.dataset.theme") == scheme
    for display in DISPLAYS:
        page.evaluate("(name) => { location.hash = name; }", display)
        expect(page.locator("main")).to_have_attribute("data-display", display)
        expect(page.locator("main section").first).to_be_visible()
        assert violations(page) == [], display


def test_the_keyboard_alone_reaches_every_button(console_page: Page) -> None:
    page = console_page
    wanted = page.evaluate("document.querySelectorAll('button:not([hidden]), a, input, select').length")
    seen: set[str] = set()
    for _ in range(3 * wanted):
        page.keyboard.press("Tab")
        seen.add(page.evaluate("document.activeElement.textContent.slice(0, 30)"))
    assert {"Occupy the desk", "Simulation", "Stop the arm", "Release the arm"} <= seen


def test_nothing_is_wider_than_a_small_screen(console_page: Page) -> None:
    page = console_page
    for width, height in ((1280, 720), (820, 1180)):
        page.set_viewport_size({"width": width, "height": height})
        for display in DISPLAYS:
            page.evaluate("(name) => { location.hash = name; }", display)
            expect(page.locator("main")).to_have_attribute("data-display", display)
            assert page.evaluate("document.documentElement.scrollWidth") <= width, (display, width)


def test_states_carry_a_shape_and_a_word_beside_their_colour(console_page: Page) -> None:
    page = console_page
    page.evaluate("""async () => {
        const { store } = await import("/static/js/store.js");
        const state = structuredClone(store.live.state);
        state.conditions = [{ key: "a", kind: "stop", text: "the arm is stopped", severe: true },
            { key: "b", kind: "trial", text: "on trial", severe: false }];
        store.show({ ...store.live, state });
    }""")
    tags = page.locator("#alarm-line .tag")
    expect(tags.nth(0)).to_have_text("▲ the arm is stopped")
    expect(tags.nth(1)).to_have_text("△ on trial")


def test_what_is_not_possible_is_told_by_words(console_page: Page) -> None:
    page = console_page
    for button in page.locator("button[aria-disabled=true]").all():
        assert page.locator(f"#{button.get_attribute('aria-describedby')}").inner_text()


def test_an_indicator_tells_the_unusual_from_the_limit_by_shape_and_word(console_page: Page) -> None:
    assert not any(told_in_words(text) for text in console_page.evaluate(PAINTED, 3.0))
    assert "△ unusual" in console_page.evaluate(PAINTED, 5.0)
    assert "▲ limit" in console_page.evaluate(PAINTED, 8.5)
