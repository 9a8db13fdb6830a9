"""What docs/api.md shows is complete: every public name is on the page, and every argument is explained."""

import inspect
import re
from collections.abc import Iterator
from typing import Any

import pytest
from docstring_parser import DocstringStyle, parse

import dtwin
from dtwin.parameters import ROOT


def members(kind: type) -> Iterator[tuple[str, Any]]:
    """The public methods and properties that a class defines itself."""
    for name, member in vars(kind).items():
        member = member.__func__ if isinstance(member, classmethod) else member
        if not name.startswith("_") and (inspect.isfunction(member) or isinstance(member, property)):
            yield name, member


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


def test_the_page_has_every_public_name() -> None:
    named = re.findall(r"^::: dtwin\.(\w+)$", (ROOT / "docs" / "api.md").read_text(), re.MULTILINE)
    assert sorted(named) == sorted(dtwin.__all__)


@pytest.mark.parametrize("name", callables())
def test_every_argument_is_explained(name: str) -> None:
    function = callables()[name]
    text = inspect.getdoc(function)
    assert text, f"{name} has no docstring"
    explained = [each.arg_name for each in parse(text, DocstringStyle.GOOGLE).params if each.args[0] == "param"]
    given = [each for each in inspect.signature(function).parameters if each not in ("self", "cls")]
    assert explained == given
