"""Takes the pictures of docs/console.md: every display of a cell and of a line at work, in a browser."""

import os
import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Page, sync_playwright

from dtwin.parameters import ROOT
from dtwin.services import runfile
from dtwin.services.console import ConsoleOptions
from tests.support.desk import Desk, new_desk
from tests.support.pages.browsers import ARGUMENTS, find_chromium
from tests.support.waiting import until

CELL = ("--pace", "lockstep", "--console", "--monitoring", "--simulation", "--identification", "--noise", "0.002")
LINE_FAULT = "a2:K2*=0.1@144.5-900"
"""Station a2 loses its shoulder with a box held, when a few boxes have left the line."""
SLOW = 120_000
"""ms"""


def main() -> int:
    """Takes all pictures into a folder, docs/ if none is given."""
    folder = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else ROOT / "docs"
    chromium = find_chromium()
    if chromium is None:
        print("needs a browser: apt install chromium, or set CHROMIUM to the path of one", file=sys.stderr)
        return 2
    with new_desk() as desk, TemporaryDirectory() as work, sync_playwright() as play:
        os.chdir(work)
        desk.detach(*CELL)
        until(lambda: desk.tick() > 4000, "the monitor knows the arm", 120.0)
        browser = play.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        page = browser.new_page(viewport={"width": 1280, "height": 720}, color_scheme="light")
        page.goto(runfile.require("cell").console)
        page.get_by_role("button", name="Occupy the desk").click(timeout=SLOW)
        _take_all(page, desk, folder)
        desk.run("down")
        _take_line(browser.new_page(viewport={"width": 1280, "height": 720}, color_scheme="light"), desk, folder)
        browser.close()
    return 0


def _take_line(page: Page, desk: Desk, folder: Path) -> None:
    """Pictures of a line whose twins propose what to do about an arm that has failed."""
    desk.run("line", "up", "--detach", "--fault", LINE_FAULT)
    console = ConsoleOptions()
    with (
        console.bound() as bound,
        runfile.join_line("line") as bus,
        console.serving(bound, bus, "line", runfile.LINE) as web,
    ):
        page.goto(web.address)
        page.get_by_role("button", name="Take desk a").click(timeout=SLOW)
        page.get_by_role("button", name=re.compile("^Approve")).wait_for(timeout=3 * SLOW)
        _take(page, folder, "line")
        _open(page, "Zone a")
        page.get_by_label("mark", exact=True).select_option("a1")
        _press(page, "What if")
        page.get_by_text("boxes/h expected").wait_for(timeout=SLOW)
        _take(page, folder, "zone")
    desk.run("down", "--cell", "line")


def _take_all(page: Page, desk: Desk, folder: Path) -> None:
    tick = desk.tick()
    until(lambda: desk.tick() > tick + 3000, "the trends are full", 120.0)
    _take(page, folder, "overview")
    page.locator("#theme").click()
    _take(page, folder, "overview-dark")
    page.locator("#theme").click()
    _open(page, "Identification")
    _press(page, "Excite and identify", True)
    page.get_by_text("proposed:").wait_for(timeout=SLOW)
    _press(page, "Show the models against the motion")
    page.get_by_text("of the proposed one").wait_for(timeout=SLOW)
    _take(page, folder, "identification")
    _open(page, "Simulation")
    page.get_by_label("Target time, s").fill("1.5")
    _press(page, "Simulate")
    page.get_by_role("columnheader", name="the form").wait_for(timeout=SLOW)
    _press(page, "Optimise")
    page.get_by_role("button", name="Take the best into the form").click(timeout=SLOW)
    _press(page, "Upload gains and target time", True)
    page.locator("#alarm-line").get_by_text("on trial").wait_for(timeout=SLOW)
    _take(page, folder, "simulation")
    _open(page, "Monitoring")
    _press(page, "Inject the fault", True)
    page.locator("#alarm-line").get_by_text("failed").wait_for(timeout=SLOW)
    _take(page, folder, "monitoring")
    _open(page, "Alarms")
    _take(page, folder, "alarms")
    _open(page, "Replay")
    _press(page, "Look at the last hour")
    page.get_by_text("Not live:").last.wait_for(timeout=SLOW)
    _take(page, folder, "replay")


def _open(page: Page, display: str) -> None:
    page.locator("nav").get_by_role("link", name=display, exact=True).click()


def _press(page: Page, name: str, confirmed: bool = False) -> None:
    page.get_by_role("button", name=name, exact=True).click(timeout=SLOW)
    if confirmed:
        page.locator("[data-confirm=yes]").click()


def _take(page: Page, folder: Path, name: str) -> None:
    page.wait_for_function("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    page.screenshot(path=folder / f"console-{name}.png", full_page=True)
    print(f"console-{name}.png", flush=True)


if __name__ == "__main__":
    sys.exit(main())
