"""docs/api.md is what signatures and docstrings say, and these say everything."""

import inspect
from typing import Any

import pytest

import dtwin
from tests.support.pages.api import PAGE, arguments, documented, members, page


def callables() -> dict[str, Any]:
    """Every public function, class and method that takes arguments."""
    found: dict[str, Any] = {"Cell": dtwin.Cell}
    for name in dtwin.__all__:
        value = getattr(dtwin, name)
        if inspect.isfunction(value):
            found[name] = value
        elif value.__module__.startswith("dtwin.api."):
            found |= {f"{name}.{word}": each for word, each in members(value) if inspect.isfunction(each)}
    return found


def test_the_page_is_up_to_date() -> None:
    assert PAGE.read_text() == page(), "scripts/api-page writes it anew"


@pytest.mark.parametrize("name", callables())
def test_every_argument_is_explained(name: str) -> None:
    function = callables()[name]
    assert list(documented(function)) == [each.name for each in arguments(function)]
