"""The thesis's tasks through the page alone, and how many clicks each takes, as docs/console.md lists them."""

import re

import pytest
from playwright.sync_api import Page, expect

from dtwin.bus.messages import LOOK, PROPOSE
from dtwin.bus.proposals.messages import Look, Proposal, ProposalRequest
from dtwin.services.runfile import join
from tests.support.desk import Desk
from tests.support.pages.colours import in_colour, told_in_words
from tests.support.pages.hand import LEARNT, SLOW, Hand, answered, listed
from tests.support.waiting import until


@pytest.fixture(scope="module")
def pace() -> str:
    return "realtime"


def test_the_arm_is_stopped_and_released(hand: Hand) -> None:
    page = hand.page
    hand.stop()
    answered(page, "stop:")
    expect(page.locator("#doing")).to_contain_text("held", timeout=SLOW)
    expect(page.locator("#alarm-line")).to_contain_text("stopped", timeout=SLOW)
    expect(page.locator("[data-command=release]")).to_have_attribute("aria-disabled", "false", timeout=SLOW)
    hand.press("Release the arm")
    hand.confirm()
    answered(page, "the arm moves")
    expect(page.locator("#doing")).not_to_contain_text("held", timeout=SLOW)
    assert hand.clicks == listed("Stop and release the arm")


def test_the_arm_is_stopped_from_every_display_without_the_desk(console_page: Page, cell: Desk) -> None:
    page = console_page
    expect(page.get_by_role("button", name="Occupy the desk")).to_be_visible()
    for display in ("Overview", "Identification", "Monitoring", "Simulation", "Alarms", "Replay"):
        page.get_by_role("link", name=display, exact=True).click()
        stop = page.locator("header [data-command=stop]")
        expect(stop).to_be_visible()
        expect(stop).to_have_attribute("aria-disabled", "false")
        if display not in ("Simulation", "Replay"):
            continue
        stop.click()
        expect(stop).to_have_text("Stop: click again")
        stop.click()
        expect(page.locator("#stop-answer")).to_contain_text("✓ stop:", timeout=SLOW)
        expect(page.locator("#doing")).to_contain_text("stopped", timeout=SLOW)
        cell.run("release", "--why", "seen")
        expect(page.locator("#doing")).not_to_contain_text("stopped", timeout=SLOW)


def test_a_confirmation_can_be_declined_with_the_keyboard(hand: Hand) -> None:
    page = hand.page
    stop = page.locator("[data-command=stop]")
    stop.focus()
    page.keyboard.press("Enter")
    expect(stop).to_have_text("Stop: click again")
    page.keyboard.press("Escape")
    expect(stop).to_have_text("Stop the arm")
    hand.open("Monitoring")
    page.get_by_role("button", name="Stop the monitor").click(timeout=SLOW)
    expect(page.locator("dialog")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("dialog")).to_have_count(0)
    expect(page.locator("#doing")).not_to_contain_text("stopped")


def test_an_alarm_is_acknowledged_shelved_and_in_the_history(hand: Hand) -> None:
    page = hand.page
    hand.stop()
    hand.open("Alarms")
    row = page.get_by_role("row").filter(has_text="the arm is stopped").first
    # Exactly: a stop that is over may stand as "returned to normal unacknowledged" before this one comes.
    expect(row.get_by_role("cell").first).to_have_text("unacknowledged", timeout=SLOW)
    page.get_by_role("button", name="Acknowledge stop").click(timeout=SLOW)
    expect(row).not_to_contain_text("unacknowledged", timeout=SLOW)
    page.get_by_role("button", name="Shelve stop").click()
    hand.confirm()
    answered_no = page.locator(".answer.refused")
    expect(answered_no).to_contain_text("expected a reason", timeout=SLOW)
    page.get_by_label("Reason for the shelf").fill("is looked after")
    page.get_by_role("button", name="Shelve stop").click()
    hand.confirm()
    expect(row).to_contain_text("shelved", timeout=SLOW)
    page.get_by_label("Words to look for").fill("shelved looked")
    expect(page.get_by_role("region", name="History of the alarms")).to_contain_text("is looked after", timeout=SLOW)
    hand.open("Overview")
    expect(page.locator("[data-command=release]")).to_have_attribute("aria-disabled", "false", timeout=SLOW)
    hand.press("Release the arm")
    hand.confirm()
    answered(page, "the arm moves")


def test_settings_are_simulated_optimised_uploaded_and_rolled_back(hand: Hand) -> None:
    page = hand.page
    hand.open("Simulation")
    expect(page.get_by_label("kp, 1/s², joint 1")).not_to_have_value("", timeout=SLOW)
    page.get_by_label("Target time, s").fill("1.8")
    hand.press("Simulate")
    expect(page.get_by_role("columnheader", name="the form")).to_be_visible(timeout=SLOW)
    expect(page.get_by_role("columnheader", name="in force")).to_be_visible()
    page.get_by_label("Candidates to judge").fill("80")
    hand.press("Optimise")
    hand.press("Take the best into the form")
    page.get_by_label("Target time, s").fill("2.2")
    hand.press("Upload gains and target time")
    hand.confirm()
    answered(page, "in force since")
    expect(page.locator("#alarm-line")).to_contain_text("on trial", timeout=SLOW)
    expect(page.locator("[data-command=rollback]")).to_have_attribute("aria-disabled", "false", timeout=SLOW)
    hand.press("Roll back")
    hand.confirm()
    expect(page.get_by_role("cell", name=re.compile("^roll back")).first).to_be_visible(timeout=SLOW)
    assert hand.clicks == listed("Simulate, optimise, upload on trial, roll back")


def test_the_arm_is_identified_and_the_model_accepted(hand: Hand) -> None:
    page = hand.page
    hand.open("Identification")
    hand.press("Excite and identify")
    hand.confirm()
    expect(page.locator("main")).to_contain_text("proposed:", timeout=SLOW)
    expect(page.get_by_role("cell", name="K2", exact=True)).to_be_visible()
    hand.press("Show the models against the motion")
    expect(page.get_by_text("of the proposed one:")).to_be_visible(timeout=SLOW)
    fits = re.findall(r"of the proposed one: ([\d., ]+)", page.locator("main").inner_text())
    assert min(float(value) for value in fits[0].strip(" ,").split(", ")) > 0.9
    anyway = page.get_by_label("keep it even if it is in doubt")
    if page.get_by_text("in doubt:").count():
        hand.click(anyway)
    hand.press("Accept the model")
    hand.confirm()
    expect(page.locator("main")).to_contain_text("kept as arm@1", timeout=SLOW)
    assert hand.clicks <= listed("Identify the arm, accept the model")


def test_a_weak_motor_is_found_and_acknowledged(hand: Hand, cell: Desk) -> None:
    """The fault comes from the training panel; the page names joint, cause and size, in words beside its colours."""
    page = hand.page
    hand.open("Monitoring")
    until(lambda: cell.tick() > LEARNT, "the monitor knows the arm", 120.0)
    hand.press("Inject the fault")
    hand.confirm()
    answered(page, "K2")
    row = page.get_by_role("row").filter(has=page.get_by_role("cell", name="joint 2", exact=True))
    expect(row).to_contain_text("failed", timeout=SLOW)
    expect(row).to_contain_text("K2", timeout=SLOW)
    expect(page.locator("#alarm-line")).to_contain_text("joint 2 failed")
    told = in_colour(page)
    assert len(told) >= 2
    assert [text for text in told if not told_in_words(text)] == []
    expect(page.locator("[data-command=acknowledge]")).to_have_attribute("aria-disabled", "false", timeout=SLOW)
    hand.press("Acknowledge the findings")
    answered(page, "acknowledged:")
    expect(row).to_contain_text("failed")
    assert hand.clicks == listed("Find the weak motor, acknowledge it")
    hand.press("Take as the new normal")
    expect(page.locator("dialog")).to_contain_text("reports this no more")
    hand.confirm()
    answered(page, "the arm as it is now counts as normal")
    expect(row).to_contain_text("nominal", timeout=SLOW)
    assert hand.clicks - 1 == listed("Find the weak motor, take it as the new normal")


def test_the_monitor_is_stopped_and_started(hand: Hand, cell: Desk) -> None:
    page = hand.page
    hand.open("Monitoring")
    expect(page.locator("main")).to_contain_text("Watched with: the data sheet's arm", timeout=SLOW)
    hand.press("Stop the monitor")
    hand.confirm()
    expect(page.locator("main")).to_contain_text("Nobody watches the arm", timeout=SLOW)
    expect(page.locator("#alarm-line")).to_contain_text("the monitor is stopped")
    assert "expected `dtwin monitor start`" in cell.run("monitor", "acknowledge", status=2)
    hand.press("Start the monitor")
    expect(page.get_by_role("cell", name="joint 2", exact=True)).to_be_visible(timeout=SLOW)
    assert "is stopped" in cell.run("monitor", "stop")
    expect(page.locator("main")).to_contain_text("Nobody watches the arm", timeout=SLOW)
    assert "watches" in cell.run("monitor", "start")


def test_the_past_is_marked_and_takes_no_commands(console_page: Page) -> None:
    page = console_page
    page.get_by_role("link", name="Replay").click()
    page.get_by_role("button", name="Look at the last hour").click()
    expect(page.locator("#live")).to_contain_text("not live", timeout=SLOW)
    page.get_by_role("button", name="◀ 1 s").click()
    page.get_by_role("link", name="Overview").click()
    expect(page.locator("#live")).to_contain_text("not live")
    expect(page.locator("#why-release-release-the-arm")).to_contain_text("not live")
    expect(page.locator("[data-command=stop]")).to_have_attribute("aria-disabled", "false")
    page.get_by_role("link", name="Replay").click()
    page.get_by_role("button", name="Back to the present").click()
    expect(page.locator("#live")).to_have_text("● live", timeout=SLOW)


def test_texts_with_markup_are_shown_as_text(console_page: Page, cell: Desk) -> None:
    """Whatever comes from the bus is text on the page, also on its way through the audit and the events."""
    page = console_page
    page.evaluate("""async () => {
        const { store } = await import("/static/js/store.js");
        const text = "<img src=x onerror='document.title=1'><script>document.title=1</scr" + "ipt>";
        const state = structuredClone(store.live.state);
        Object.assign(state, { cell: text, doing: text, events: [{ time: 1, kind: text, text }],
            conditions: [{ key: "x", kind: "finding", text, severe: true }],
            services: { [text]: { state: text, reason: text, rate_hz: 0, restarts: 0, here: true } } });
        store.show({ ...store.live, state });
    }""")
    expect(page.locator("#doing")).to_contain_text("<img src=x")
    expect(page.locator("h1")).to_contain_text("<script>")
    assert page.locator("main img, main script, #alarm-line img, header img").count() == 0
    for display in ("Alarms", "Overview"):
        page.get_by_role("link", name=display).click()
        expect(page.locator("main")).to_contain_text("onerror")
    assert page.title() != "1"


def test_what_an_ai_proposes_is_approved_or_declined_as_it_is_shown(hand: Hand, cell: Desk) -> None:
    page = hand.page
    with join("cell") as bus:
        asked = ProposalRequest("claude", "the shift asks", "diagnosis", text="<b>nothing</b> is wrong")
        first, second = (bus.ask(PROPOSE, asked, Proposal) for _ in range(2))
        hand.open("Simulation")
        for made, action, became in ((first, "Approve", "approved"), (second, "Decline", "declined")):
            button = page.get_by_role("button", name=f"{action} proposal {made.number}")
            expect(button).to_have_attribute("aria-disabled", "false", timeout=SLOW)
            hand.click(button)
            if action == "Approve":
                hand.confirm()
            expect(page.get_by_text(f"{made.number}. diagnosis, by claude")).to_contain_text(became, timeout=SLOW)
        expect(page.get_by_text("“<b>nothing</b> is wrong”").first).to_be_visible()
        assert [each.state for each in bus.ask(LOOK, None, Look).proposals[-2:]] == ["approved", "declined"]
