"""A browser for the tests of the pages, and a cell that they look at."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Error, Page, expect, sync_playwright

from dtwin.services import runfile
from tests.support.desk import Desk, new_desk
from tests.support.pages.again import Pages
from tests.support.pages.browsers import ARGUMENTS, find_chromium
from tests.support.pages.hand import SLOW, Hand

AWAY = ("Failed to load resource", "WebSocket connection")
"""What a browser says of refusals, while a console is away, and after it has come back without the old sessions."""
SERVICES = ("--monitoring", "--simulation", "--identification")
"""Services that a cell may have beside the console's own; each takes a second to start and a share of every tick."""


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    chromium = find_chromium()
    if chromium is None:
        pytest.skip("needs a browser: apt install chromium, or set CHROMIUM to the path of one")
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the logs that the console can replay."""
    return tmp_path_factory.mktemp("recordings")


@pytest.fixture(scope="module")
def pace() -> str:
    """Pace of the cell; modules whose tests wait for nothing that the arm does take realtime, which costs little."""
    return "lockstep"


@pytest.fixture(scope="module")
def services() -> tuple[str, ...]:
    """Options of the services that the cell has beside the console; modules that need fewer of them say so."""
    return SERVICES


@pytest.fixture(scope="module")
def cell(
    tmp_path_factory: pytest.TempPathFactory, recordings: Path, pace: str, services: tuple[str, ...]
) -> Iterator[Desk]:
    """A cell with a console."""
    folder = tmp_path_factory.mktemp("cell")
    with new_desk() as desk, pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        desk.detach("--console", *services, "--noise", "0.002", "--pace", pace, "--recordings", str(recordings))
        yield desk
        desk.run("down")


@pytest.fixture(scope="session")
def pages(browser: Browser) -> Pages:
    return Pages(browser)


@pytest.fixture
def open_page(pages: Pages) -> Iterator[Callable[..., Page]]:
    """open_page(address, display): a page in a browser of its own, which must not complain of anything."""
    opened: list[tuple[Page, dict[str, Any]]] = []
    complaints: list[str] = []

    def note(message: ConsoleMessage) -> None:
        if message.type in ("error", "warning") and not any(word in message.text for word in AWAY):
            complaints.append(message.text)

    def fail(error: Error) -> None:
        complaints.append(str(error))

    def open_it(address: str, display: str = "overview", **options: Any) -> Page:
        page = pages.take(options)
        opened.append((page, options))
        page.on("pageerror", fail)
        page.on("console", note)
        page.goto(f"{address}#{display}")
        return page

    yield open_it
    for page, options in opened:
        page.remove_listener("pageerror", fail)
        page.remove_listener("console", note)
        pages.give_back(page, options)
    assert complaints == []


@pytest.fixture
def console_page(cell: Desk, open_page: Callable[..., Page]) -> Page:
    """The page of the cell, live."""
    page = open_page(runfile.require("cell").console)
    expect(page.locator("#live")).to_have_text("● live", timeout=20_000)
    return page


@pytest.fixture
def hand(console_page: Page) -> Iterator[Hand]:
    """Somebody at the desk."""
    hand = Hand(console_page)
    hand.occupy()
    yield hand
    console_page.get_by_role("button", name="Leave the desk").click(timeout=SLOW)
    expect(console_page.get_by_role("button", name="Occupy the desk")).to_be_visible()
