"""Somebody who does a task through the page alone, and counts the clicks."""

import re
from typing import Final

from playwright.sync_api import Locator, Page, expect

from dtwin.parameters import ROOT

LEARNT: Final = 4000
"""Number of ticks after which the monitor knows the arm."""
SLOW: Final = 60_000
"""Deadline of what the cell has to do first, ms."""


def listed(task: str) -> int:
    """Number of clicks that the page of the console lists for a task."""
    page = (ROOT / "docs" / "console.md").read_text()
    found = re.search(rf"^\| {task} \|.*\| (\d+) \|$", page, re.M)
    assert found, f"no row {task}"
    return int(found[1])


class Hand:
    """Clicks, and counts it."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.clicks = 0

    def click(self, target: Locator) -> None:
        target.click(timeout=SLOW)
        self.clicks += 1

    def press(self, name: str) -> None:
        self.click(self.page.get_by_role("button", name=name, exact=True).first)

    def confirm(self) -> None:
        self.click(self.page.locator("[data-confirm=yes]"))

    def stop(self) -> None:
        """Stops the arm from the head of the page, by two clicks."""
        for _ in range(2):
            self.click(self.page.locator("header [data-command=stop]"))

    def open(self, display: str) -> None:
        self.click(self.page.get_by_role("link", name=display, exact=True))

    def occupy(self) -> None:
        self.press("Occupy the desk")
        expect(self.page.get_by_role("button", name="Leave the desk")).to_be_visible(timeout=SLOW)


def answered(page: Page, words: str) -> None:
    expect(page.locator(".answer:not(.refused)", has_text=words).first).to_be_visible(timeout=SLOW)
