"""What the site is made of beside its pages: the reference of the commands, and equations as MathML.

MkDocs calls the functions whose names begin with `on_`; `mkdocs.yml` names this file.
"""

from __future__ import annotations

import html
import importlib
import re
from argparse import Action
from collections.abc import Iterator
from typing import Any, Final

import latex2mathml.converter
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from dtwin.commands.table import GROUPS, Subcommand
from dtwin.options import parser_of
from dtwin.parameters import ROOT

COMMANDS_PAGE: Final = "commands.md"
_EQUATION: Final = re.compile(r'<(div|span) class="arithmatex">\s*\\[\[(](.*?)\\[\])]\s*</\1>', re.DOTALL)
_HEAD: Final = """# Commands

`scripts/dtwin NAME` in a checkout, `dtwin NAME` where the package is installed. Every command has `--help`. The exit
status is 0 when all was done, 1 when a check failed, 2 for bad input and 130 after Ctrl-C. This page is made from the
parsers of the commands.
"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the reference of the commands."""
    files.append(File.generated(config, COMMANDS_PAGE, content=commands_page()))
    return files


def on_page_content(text: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Writes the equations of a page as MathML, which browsers draw by themselves."""
    return _EQUATION.sub(lambda found: mathml(html.unescape(found[2]), found[1] == "div"), text)


def mathml(equation: str, block: bool) -> str:
    """An equation in LaTeX as MathML, in a line of its own or inside a text."""
    made: str = latex2mathml.converter.convert(equation.strip(), display="block" if block else "inline")
    return f'<div class="equation">{made}</div>' if block else made


def commands_page() -> str:
    """The reference of all commands as Markdown."""
    parts = [_HEAD]
    for title, group in GROUPS.items():
        parts.append(f"## {title.capitalize()}\n")
        for name, entry in group.items():
            parts += _command(name, entry)
    return "\n".join(parts)


def _command(name: str, entry: Subcommand) -> Iterator[str]:
    options = getattr(importlib.import_module(f"dtwin.commands.{entry.module}"), entry.options)
    parser = parser_of(options, f"dtwin {name}")
    actions = [action for group in parser._action_groups for action in group._group_actions if action.dest != "help"]
    words = [_metavar(action) for action in actions if not action.option_strings]
    yield f"### dtwin {name}\n"
    yield f"{_text(parser.description)}\n"
    yield f"```text\ndtwin {' '.join([name, *words])}{' [OPTIONS]' if len(words) < len(actions) else ''}\n```\n"
    if actions:
        yield "| option | meaning |\n| --- | --- |"
        yield "\n".join(f"| {_named(action)} | {_text(action.help).replace('|', '&#124;')} |" for action in actions)
        yield ""


def _named(action: Action) -> str:
    metavar = _metavar(action) if action.nargs != 0 else ""
    return f"`{' '.join([*action.option_strings[-1:], *filter(None, [metavar])])}`".replace("|", "&#124;")


def _metavar(action: Action) -> str:
    return str(action.metavar or action.dest)


def _text(said: Any) -> str:
    """A text of the parser as Markdown: no path of this machine, nothing beside `code` taken for markup."""
    words = str(said or "").replace(f"{ROOT}/", "").split("`")
    words[::2] = [re.sub(r"([*<_\\[])", r"\\\1", word) for word in words[::2]]
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in "`".join(words).split("\n\n"))
