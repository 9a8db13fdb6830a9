"""What the site is made of beside its pages: the reference of the commands, and drawn equations.

MkDocs calls the functions whose names begin with `on_`; `mkdocs.yml` names this file.
"""

from __future__ import annotations

import html
import re
from argparse import Action
from collections.abc import Iterator
from typing import Any, Final
from xml.etree import ElementTree

import ziamath
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from dtwin.commands.table import GROUPS, Subcommand
from dtwin.options import parser_of
from dtwin.parameters import ROOT

COMMANDS_PAGE: Final = "commands.md"
_SIZE: Final = 18
"""of the letters of equations, px"""
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
    """Draws the equations of a page, so that no browser needs a font or a program for them."""
    return _EQUATION.sub(lambda found: drawn(html.unescape(found[2]).strip(), found[1] == "div"), text)


def drawn(equation: str, block: bool) -> str:
    """An equation in LaTeX as SVG, in a line of its own or on the base line of a text; its label is the LaTeX."""
    ziamath.config.svg2 = False  # Every drawing has its own outlines: names of shared ones would clash in a page.
    made = ziamath.Latex(equation, size=_SIZE, inline=not block, color="currentColor")
    svg = made.svgxml()
    svg.set("role", "img")
    svg.set("aria-label", equation)
    if block:
        return f'<div class="equation">{ElementTree.tostring(svg, encoding="unicode")}</div>'
    svg.set("style", f"vertical-align: {made.getyofst():.2f}px")
    return ElementTree.tostring(svg, encoding="unicode")


def commands_page() -> str:
    """The reference of all commands as Markdown."""
    parts = [_HEAD]
    for title, group in GROUPS.items():
        parts.append(f"## {title.capitalize()}\n")
        for name, entry in group.items():
            parts += _command(name, entry)
    return "\n".join(parts)


def _command(name: str, entry: Subcommand) -> Iterator[str]:
    parser = parser_of(entry.kind, f"dtwin {name}")
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
    return str(action.metavar or action.dest).replace(",", ", ")  # so that a narrow column can break it


def _text(said: Any) -> str:
    """A text of the parser as Markdown: no path of this machine, nothing beside `code` taken for markup."""
    words = str(said or "").replace(f"{ROOT}/", "").split("`")
    words[::2] = [re.sub(r"([*<_\\[])", r"\\\1", word) for word in words[::2]]
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in "`".join(words).split("\n\n"))
