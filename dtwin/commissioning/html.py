"""Parts of a page in HTML; all text is escaped, whoever it comes from."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import Final

from dtwin.terminal import printable

_STYLE: Final = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 62rem; margin: 2rem auto;
  padding: 0 1.5rem; }
h1 { font-size: 1.7rem; margin-bottom: 0.3rem; }
h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid #ccc; padding-bottom: 0.2rem; }
table { border-collapse: collapse; margin: 0.8rem 0; font-variant-numeric: tabular-nums; display: block;
  overflow-x: auto; }
th, td { padding: 0.2rem 0.9rem 0.2rem 0; text-align: right; border-bottom: 1px solid #e4e4e4; }
th { font-weight: 600; border-bottom: 1px solid #888; }
th:first-child, td:first-child, .words th, .words td { text-align: left; vertical-align: top; }
.grade { padding: 0.6rem 1rem; border-left: 0.4rem solid; margin: 1rem 0; font-size: 1.05rem; }
.good { border-color: #55a868; background: #f0f8f2; }
.fair { border-color: #ccb974; background: #fbf8ee; }
.poor { border-color: #c44e52; background: #fbf0f0; }
svg { max-width: 100%; height: auto; }
code { font-size: 0.85rem; overflow-wrap: anywhere; }
"""


def escaped(text: str) -> str:
    """A text as HTML shows it, character by character."""
    return html.escape(printable(text))


def heading(text: str) -> str:
    """The heading of a section."""
    return f"<h2>{escaped(text)}</h2>"


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph; its kind is a class of the style sheet, or none."""
    return f'<p class="{kind}">{escaped(text)}</p>' if kind else f"<p>{escaped(text)}</p>"


def bullets(items: Iterable[str]) -> str:
    """A list of texts; nothing for none."""
    items = list(items)
    if not items:
        return ""
    return f"<ul>{''.join(f'<li>{escaped(item)}</li>' for item in items)}</ul>"


def table(header: Sequence[str], rows: Iterable[Sequence[str]], kind: str = "") -> str:
    """A table of texts; its kind is a class of the style sheet, or none, for numbers."""
    head = "".join(f"<th>{escaped(cell)}</th>" for cell in header)
    body = "".join(f"<tr>{''.join(f'<td>{escaped(cell)}</td>' for cell in row)}</tr>\n" for row in rows)
    opening = f'<table class="{kind}">' if kind else "<table>"
    return f"{opening}<thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>"


def picture(svg: str, caption: str) -> str:
    """A picture that was drawn here, with what it shows."""
    return f"<figure>{svg}<figcaption>{escaped(caption)}</figcaption></figure>"


def document(title: str, parts: Iterable[str]) -> str:
    """A page of parts that are HTML already; it needs nothing from anywhere else, and a browser loads nothing."""
    policy = "default-src 'none'; style-src 'unsafe-inline'"
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escaped(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n<h1>{escaped(title)}</h1>\n"
        + "\n".join(parts)
        + "\n</body>\n</html>\n"
    )
