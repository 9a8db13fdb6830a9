"""A fault that is put right through the page alone, and the next one, told without colours: by a shape and by words.

Both are tests of one cell, whose monitor knows its arm only after a while. They are thorough: test_tasks.py does each
step of the first through the page and asks for shapes and words beside the colours of a fault, the tutorial takes all
steps on the command line.
"""

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

from dtwin.parameters import ArmParameters
from tests.support.desk import Desk
from tests.support.pages.browsers import DISPLAYS
from tests.support.pages.colours import in_colour, told_in_words
from tests.support.pages.hand import LEARNT, SLOW, Hand, answered, listed
from tests.support.waiting import until

pytestmark = pytest.mark.thorough
WEAKER = 0.8
"""Share of the voltage constant that is left, with which the arm can still carry its boxes."""


def test_a_fault_is_found_identified_uploaded_and_confirmed(hand: Hand, cell: Desk) -> None:
    page = hand.page
    hand.open("Monitoring")
    until(lambda: cell.tick() > LEARNT, "the monitor knows the arm", 120.0)
    page.get_by_label("Fault", exact=True).fill(f"K1*={WEAKER}@0")
    hand.press("Inject the fault")
    hand.confirm()
    answered(page, "K1")
    row = page.get_by_role("row").filter(has=page.get_by_role("cell", name="joint 1", exact=True))
    expect(row).to_contain_text("K1", timeout=SLOW)

    hand.open("Identification")
    expect(page.get_by_label("Of these not known any more")).to_have_value("K1", timeout=SLOW)
    hand.press("Identify at work")
    expect(page.locator("main")).to_contain_text("proposed:", timeout=SLOW)
    estimate = page.get_by_role("row").filter(has=page.get_by_role("cell", name="K1", exact=True))
    found, interval = (float(text) for text in estimate.get_by_role("cell").all_inner_texts()[1:3])
    assert abs(found - WEAKER * ArmParameters().get("K1")) < 2.0 * interval
    hand.click(page.get_by_label("upload it to the controller, on trial"))
    hand.press("Accept the model")
    hand.confirm()
    answered(page, "on trial in the controller")

    hand.open("Simulation")
    expect(page.get_by_role("cell", name=re.compile("^confirm")).first).to_be_visible(timeout=SLOW)
    expect(page.locator("#alarm-line")).not_to_contain_text("on trial", timeout=SLOW)
    hand.open("Monitoring")
    hand.press("Take as the new normal")
    hand.confirm()
    expect(row).to_contain_text("nominal", timeout=SLOW)
    expect(page.locator("#alarm-line")).to_contain_text("nothing abnormal", timeout=SLOW)
    assert hand.clicks == listed("The whole recovery from a weak motor")


def test_what_is_abnormal_is_told_by_shape_and_words(hand: Hand, cell: Desk, tmp_path: Path) -> None:
    """A motor is weak and the arm is stopped; the pictures of all displays in grey are kept beside the test."""
    page = hand.page
    hand.open("Monitoring")
    until(lambda: cell.tick() > LEARNT, "the monitor knows the arm", 120.0)
    # An arm with a weaker motor goes on: one that fell would be stopped before the button is pressed.
    page.get_by_label("Fault", exact=True).fill(f"K3*={WEAKER}@0")
    hand.press("Inject the fault")
    hand.confirm()
    expect(page.locator("#alarm-line")).to_contain_text("joint 3", timeout=SLOW)
    hand.open("Overview")
    hand.press("Stop the arm")
    hand.confirm()
    expect(page.locator("#alarm-line")).to_contain_text("stopped", timeout=SLOW)
    page.evaluate("document.documentElement.style.filter = 'grayscale(1)'")
    for display in DISPLAYS:
        page.evaluate("(name) => { location.hash = name; }", display)
        expect(page.locator("main")).to_have_attribute("data-display", display)
        page.screenshot(path=tmp_path / f"{display}.png", full_page=True)
        told = in_colour(page)
        assert len(told) >= 2, display
        assert [text for text in told if not told_in_words(text)] == [], display
    hand.open("Overview")
    hand.press("Release the arm")
    hand.confirm()
