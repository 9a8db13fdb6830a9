"""The whole recovery through the page alone: a fault injected, found, identified at work, uploaded, confirmed."""

import re

from playwright.sync_api import expect

from dtwin.parameters import ArmParameters
from tests.support.desk import Desk
from tests.support.pages.hand import LEARNT, SLOW, Hand, answered, listed
from tests.support.waiting import until

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
    hand.press("Acknowledge all findings")
    hand.confirm()
    expect(row).to_contain_text("nominal", timeout=SLOW)
    expect(page.locator("#alarm-line")).to_contain_text("nothing abnormal", timeout=SLOW)
    assert hand.clicks == listed("The whole recovery from a weak motor")
