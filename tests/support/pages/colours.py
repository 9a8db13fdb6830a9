"""What a page tells in a colour, and whether it tells it without one, too."""

import re
from typing import Final

from playwright.sync_api import Page

_SHAPE_AND_WORD: Final = re.compile(r"[▲△▿✕◷]\s*\w+")
_COLOURED: Final = """() => {
    const probe = document.createElement("i");
    document.body.append(probe);
    const abnormal = new Set(["severe", "warn", "warn-ground"].map((name) => {
        probe.style.color = `var(--${name})`;
        return getComputedStyle(probe).color;
    }));
    probe.remove();
    const coloured = (node) => {
        const style = getComputedStyle(node);
        return [style.color, style.backgroundColor, style.borderLeftColor].some((colour) => abnormal.has(colour));
    };
    return [...document.querySelectorAll("body *")].filter((node) => node.checkVisibility() && coloured(node))
        .map((node) => node.textContent);
}"""


def in_colour(page: Page) -> list[str]:
    """Texts of all that is seen in a colour that stands for something abnormal."""
    found: list[str] = page.evaluate(_COLOURED)
    return found


def told_in_words(text: str) -> bool:
    """Whether a text begins with a shape and a word."""
    return _SHAPE_AND_WORD.match(text) is not None
