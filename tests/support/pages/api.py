"""The page of the Python API, docs/api.md, made of signatures and docstrings."""

import inspect
from collections.abc import Iterator
from typing import Any

from docstring_parser import Docstring, DocstringStyle, parse

import dtwin
from dtwin import errors
from dtwin.api.run import RunError
from dtwin.monitoring.trend import Forecast
from dtwin.monitoring.verdict import Finding
from dtwin.parameters import ROOT
from dtwin.run.cell import RunSummary
from dtwin.signals import BoxCounts, Event, Sensors
from dtwin.simulation.figures import Figures
from dtwin.simulation.objective import CandidateScore
from dtwin.simulation.optimise import Optimum
from dtwin.simulation.whatif import Outcome

PAGE = ROOT / "docs" / "api.md"
RESULTS = (Event, RunSummary, BoxCounts, Finding, Forecast, Outcome, Figures, Optimum, CandidateScore, Sensors)
"""What the public functions return beside what is public."""
_INTRODUCTION = """# Python API

`import dtwin` has these names; each is loaded when it is first used. `scripts/api-page` writes this page.

- Arguments have the names, units and defaults of the options of the commands; units are SI units or as a text says.
- Numbers may be numpy's, sequences may be lists or arrays, and a path may be a text.
- What is wrong is a `DtwinError`, whose message names the argument, the value and what was expected.
- Equal arguments give equal results; `Run.save` writes the bytes of `dtwin run --log`.
- Results are frozen: nothing that is done with one changes it.

[examples/](../examples/README.md) has three scripts that open as notebooks, too.
The messages of a live cell are in [zenoh.md](zenoh.md).
"""


def page() -> str:
    """The page as it should be."""
    parts = [_INTRODUCTION]
    for name in dtwin.__all__:
        parts += _named(name, getattr(dtwin, name))
    parts.append("## Results\n\nWhat these names return, beside messages of a live cell.\n")
    for kind in RESULTS:
        parts += [f"### {kind.__name__}\n", *_described(_documentation(kind))]
    return "\n".join(parts)


def arguments(function: Any) -> list[inspect.Parameter]:
    """The parameters that a caller gives."""
    return [each for name, each in inspect.signature(function).parameters.items() if name not in ("self", "cls")]


def documented(function: Any) -> dict[str, str]:
    """The arguments that the docstring of a function, or of a class for its `__init__`, explains, with the texts."""
    explained = [each for each in _documentation(function).params if each.args[0] == "param"]
    return {each.arg_name: _line(each.description).replace("|", "&#124;") for each in explained}


def members(kind: type) -> Iterator[tuple[str, Any]]:
    """The public methods and properties that a class defines itself."""
    for name, member in vars(kind).items():
        member = member.__func__ if isinstance(member, classmethod) else member
        if not name.startswith("_") and (inspect.isfunction(member) or isinstance(member, property)):
            yield name, member


def _named(name: str, value: Any) -> list[str]:
    if value is errors.DtwinError:
        return [*_errors()]
    parts = [f"## dtwin.{name}\n"]
    if not inspect.isclass(value):
        return [*parts, *_callable(f"dtwin.{name}", value)]
    if value is dtwin.Cell:
        parts += _callable(f"dtwin.{name}", value)
    else:
        parts += _described(_documentation(value))
    if not value.__module__.startswith("dtwin.api."):
        return parts
    for word, member in members(value):
        parts.append(f"### {name}.{word}\n")
        if isinstance(member, property):
            parts += _described(_documentation(member))
        else:
            parts += _callable(f"{name}.{word}", member)
    return parts


def _callable(name: str, function: Any) -> list[str]:
    """The words, arguments and errors of a function."""
    given = arguments(function)
    texts = documented(function)
    parts = [f"```python\n{name}({', '.join(_short(given))})\n```\n", *_described(_documentation(function))]
    if given:
        parts.append("| argument | default | meaning |\n| --- | --- | --- |")
        parts += [f"| `{each.name}` | {_default(each)} | {texts[each.name]} |" for each in given]
        parts[-1] += "\n"
    return parts


def _described(text: Docstring) -> list[str]:
    """What a docstring says, without its arguments."""
    said = [each.strip() for each in (text.short_description, text.long_description) if each]
    parts = [" ".join(each.split()) + "\n" for block in said for each in block.split("\n\n")]
    attributes = [each for each in text.params if each.args[0] == "attribute"]
    if attributes:
        parts.append("\n".join(f"- `{each.arg_name}`: {_line(each.description)}" for each in attributes) + "\n")
    if text.returns is not None:
        parts.append(f"Returns: {_line(text.returns.description)}\n")
    if text.raises:
        parts.append(
            "\n".join(f"- raises `{each.type_name}`: {_line(each.description)}" for each in text.raises) + "\n"
        )
    return parts


def _errors() -> Iterator[str]:
    yield "## dtwin.DtwinError\n"
    yield from _described(_documentation(errors.DtwinError))
    classes = [each for _, each in inspect.getmembers(errors, inspect.isclass) if each is not errors.DtwinError]
    kinds = [each for each in classes if issubclass(each, errors.DtwinError)]
    lines = [f"- `{kind.__name__}`: {_line(_documentation(kind).short_description)}" for kind in [*kinds, RunError]]
    yield "These are its kinds; all but the last, `dtwin.RunError`, are in `dtwin.errors`.\n"
    yield "\n".join(lines) + "\n"


def _short(given: list[inspect.Parameter]) -> Iterator[str]:
    """The names of arguments as one gives them."""
    keyword = False
    for each in given:
        if each.kind is each.KEYWORD_ONLY and not keyword:
            keyword = True
            yield "*"
        yield each.name


def _default(argument: inspect.Parameter) -> str:
    value = argument.default
    if value is argument.empty:
        return ""
    if callable(value):
        return "does nothing"
    if hasattr(value, "is_relative_to"):  # a path, of which that of this machine says nothing
        return f"`{value.relative_to(ROOT) if value.is_absolute() else value}`"
    return f"`{value!r}`"


def _documentation(value: Any) -> Docstring:
    text = inspect.getdoc(value)
    assert text, f"{value} has no docstring"
    return parse(text, DocstringStyle.GOOGLE)


def _line(text: str | None) -> str:
    return " ".join((text or "").split())


if __name__ == "__main__":
    PAGE.write_text(page())
