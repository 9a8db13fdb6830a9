"""What is in a log and what is odd in it, as a page of text and of HTML."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from dtwin.measurements.measurement import Array, Measurement, seconds_of
from dtwin.names import counted

_EFFORTS = {"torque": "N m", "current": "A", "voltage": "V", None: "?"}


def rows_of(measurement: Measurement) -> list[tuple[str, ...]]:
    """One row for each joint: name, range of positions, usual speed, range of efforts, lag of the command."""
    found: list[tuple[str, ...]] = []
    for joint, name in enumerate(measurement.joints):
        q = measurement.q[:, joint]
        speed = np.concatenate([np.gradient(measurement.q[s, joint], measurement.t[s]) for s in _long(measurement)])
        effort = "" if measurement.effort is None else _range(measurement.effort[:, joint])
        command = ""
        if measurement.command is not None:
            command = f"{np.sqrt(np.mean((measurement.command[:, joint] - q) ** 2)):.3g}"
        found.append((name, _range(q), f"{np.sqrt(np.mean(speed**2)):.3g}", effort, command))
    return found


def _long(measurement: Measurement) -> list[slice]:
    return [rows for rows in measurement.stretches() if rows.stop - rows.start > 2]


def _range(values: Array) -> str:
    return f"{values.min():.4g} to {values.max():.4g}"


def summary(measurement: Measurement) -> list[str]:
    """Sentences about the log as a whole."""
    episodes = 1 if measurement.episodes is None else len(np.unique(measurement.episodes))
    rate = 1.0 / measurement.step if measurement.step else 0.0
    lines = [
        f"{len(measurement)} rows, {seconds_of([measurement]):.1f} s at {rate:.4g} rows a second, "
        f"{counted(len(measurement.starts), 'stretch', 'stretches')} without a gap, "
        f"{counted(episodes, 'episode', 'episodes')}",
    ]
    if measurement.effort is None:
        lines.append("no torque, current or voltage: masses, friction and loads cannot be told")
    elif measurement.kind is None:
        lines.append("the unit of the effort is not known: give it in a map of columns")
    elif measurement.kind != "torque":
        lines.append(f"{measurement.kind}, not torque: a scale needs drive constants, or a log with a known load")
    return lines


def oddities(measurement: Measurement) -> list[str]:
    """What is odd, sentence by sentence."""
    found = []
    for odd in measurement.oddities:
        where = [f"column {odd.column}"] if odd.column else []
        where += [f"from row {odd.row}"] if odd.row >= 0 else []
        where += [counted(odd.count, "row")] if odd.count else []
        place = f" ({', '.join(where)})" if where else ""
        found.append(f"{'repaired' if odd.repaired else 'left as it is'}: {odd.what}{place}")
    return found


HEAD = ("joint", "position", "speed, rms", "effort", "command - position, rms")


def page(measurement: Measurement, columns: str) -> str:
    """The page as HTML, with the map of columns that it was read by."""
    unit = _EFFORTS[measurement.kind]
    head = [f"{name} [{unit}]" if name == "effort" else name for name in HEAD]
    return "\n".join(
        [
            '<!doctype html><meta charset="utf-8">',
            f"<title>{html.escape(measurement.source)}</title>",
            "<style>body{font:15px sans-serif;max-width:60em;margin:2em auto;padding:0 1em}",
            "table{border-collapse:collapse}",
            "td,th{border:1px solid #999;padding:.2em .6em;text-align:left}pre{background:#eee;padding:1em}</style>",
            f"<h1>{html.escape(measurement.source)}</h1>",
            *(f"<p>{html.escape(line)}</p>" for line in summary(measurement)),
            _table([tuple(head), *rows_of(measurement)]),
            "<h2>What is odd</h2>",
            "<ul>"
            + "".join(f"<li>{html.escape(line)}</li>" for line in oddities(measurement) or ["nothing"])
            + "</ul>",
            "<h2>What the columns were taken for</h2>",
            f"<pre>{html.escape(columns)}</pre>",
        ]
    )


def _table(rows: Sequence[Sequence[str]]) -> str:
    head, *body = rows
    cells = ["<tr>" + "".join(f"<th>{html.escape(cell)}</th>" for cell in head) + "</tr>"]
    cells += ["<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in body]
    return "<table>" + "".join(cells) + "</table>"
