"""What the tests have executed of block types, as lines and as a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path
from typing import Final

from iec61499.output import write_whole
from iec61499.testing.coverage import Measured

KINDS: Final = {"state": "states", "transition": "transitions", "line": "lines"}
_STYLE: Final = (
    "body{font:14px sans-serif;max-width:60em;margin:2em auto}table{border-collapse:collapse}"
    "td,th{padding:.2em .8em;text-align:right;border-bottom:1px solid #ccc}td:first-child{text-align:left}"
    "pre{background:#f6f6f6;padding:.5em}.no{background:#f9caca}.yes{background:#d5f0d5}"
)


def summary(measured: Mapping[str, Measured]) -> Iterator[str]:
    """A line for each type with its states, transitions and lines, what is missing below it, and the sum."""
    width = max([len(Path(file).name) for file in measured] + [5])
    totals = dict.fromkeys(KINDS, (0, 0))
    for file, one in measured.items():
        yield f"{Path(file).name:<{width}}  " + "  ".join(_share(name, one.of(kind)) for kind, name in KINDS.items())
        for kind in KINDS:
            found = one.of(kind)
            totals[kind] = totals[kind][0] + sum(found.values()), totals[kind][1] + len(found)
            for name in (name for name, hit in found.items() if not hit):
                yield f"    {file}:{name.partition(':')[0]}: {kind}{name.partition(':')[2]} not executed"
    yield f"{'all':<{width}}  " + "  ".join(_of(name, *totals[kind]) for kind, name in KINDS.items())


def _share(name: str, found: Mapping[str, bool]) -> str:
    return _of(name, sum(found.values()), len(found))


def _of(name: str, hit: int, count: int) -> str:
    return f"{name} {hit}/{count}"


def write_page(measured: Mapping[str, Measured], file: Path) -> None:
    """Writes the page: a table of all types, then each with its text, what was executed green and the rest red.

    Raises:
        ToolError: the file cannot be written.
    """
    rows = [
        f"<tr><td><a href='#{escape(one.block.header.name)}'>{escape(one.block.header.name)}</a></td>"
        + "".join(f"<td>{sum(one.of(kind).values())}/{len(one.of(kind))}</td>" for kind in KINDS)
        + "</tr>"
        for one in measured.values()
    ]
    head = "".join(f"<th>{name}</th>" for name in KINDS.values())
    text = (
        f"<!doctype html><html lang='en'><meta charset='utf-8'><title>Coverage of function blocks</title>"
        f"<style>{_STYLE}</style><h1>Coverage of function blocks</h1>"
        f"<table><tr><th>type</th>{head}</tr>{''.join(rows)}</table>"
        f"{''.join(map(_section, measured.values()))}</html>"
    )
    write_whole(file, text.encode())


def _section(one: Measured) -> str:
    name = escape(one.block.header.name)
    parts = [f"<h2 id='{name}'>{name}</h2>"]
    for kind in ("state", "transition"):
        items = "".join(
            f"<li><span class='{'yes' if hit else 'no'}'>{escape(what.partition(': ')[2])}</span>"
            for what, hit in one.of(kind).items()
        )
        if items:
            parts.append(f"<h3>{KINDS[kind]}</h3><ul>{items}</ul>")
    hits = one.of("line")
    for algorithm in one.block.algorithms:
        first = algorithm.source.line if algorithm.source.exact else 1
        shown = []
        for number, line in enumerate(algorithm.source.text.split("\n"), first):
            hit = hits.get(f"{number}: {algorithm.name}")
            mark = "" if hit is None else f" class='{'yes' if hit else 'no'}'"
            shown.append(f"<span{mark}>{number:5} {escape(line)}</span>")
        parts.append(f"<h3>{escape(algorithm.name)}</h3><pre>" + "\n".join(shown) + "</pre>")
    return "".join(parts)
