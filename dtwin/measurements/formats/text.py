"""Text that other programs write as tables: encodings, delimiters, decimal signs, headers, units, times in words."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from datetime import time as clock
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.errors import RecordingError
from dtwin.measurements.measurement import Array

_COMMENTS: Final = ("#", "%", "//")
_DELIMITERS: Final = (";", "\t", "|")
"""What divides fields where a line has it; else commas do, else blanks."""
_LOOKED: Final = 20
"""Lines, spread over a text, by which its delimiter is told."""
_ABSENT: Final = frozenset(("", "-", "--", "na", "n/a", "#n/a", "nan", "null", "none", "missing"))
"""Words for a number that is not there."""
_PLAIN: Final = re.compile(r"[-+\d.,eE]+")
_UNIT: Final = re.compile(r"[A-Za-z%°µ/ ^²\d·*()\[\]-]{1,12}")
_DAY: Final = 86_400.0


@dataclass(frozen=True, slots=True)
class Cells:
    """The fields of a text.

    Attributes:
        names: of the columns.
        fields: of every row, as they are written, with points for decimal commas.
        named: whether the text names its columns.
        units: what a row of units below the header says, by column.
        first: number of the first row; a row of units is row 0.
        above: lines above the header that are no part of the table.
    """

    names: list[str]
    fields: list[list[str]]
    named: bool
    units: dict[str, str]
    first: int
    above: int


def cells(path: Path) -> Cells:
    """Reads a text of columns.

    Raises:
        RecordingError: it is no text, is empty, names a column twice, or has two kinds of decimal signs.
    """
    lines, comment = _lines(path)
    rows, delimiter = _divided(lines)
    usual = Counter(map(len, rows)).most_common(1)[0][0]
    above = next(k for k, row in enumerate(rows) if len(row) == usual)
    if len(rows[above - 1]) == usual - 1 and above and _names(rows[above - 1]):  # rows end with a delimiter more
        above -= 1
        rows = [row[:-1] if len(row) == usual and not row[-1] else row for row in rows]
    if not (above == 0 or _names(rows[above])):
        above = 0  # rows that are too short or too long are damaged, and no title
    rows = rows[above:]
    named = _names(rows[0])
    if named:
        names = rows.pop(0)
    else:
        said = _divided([comment])[0][0] if comment else []
        named = len(said) == len(rows[0]) and _names(said)
        names = said if named else [f"c{k}" for k in range(len(rows[0]))]
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(f"{path}: column {twice!r}: expected it once, got it {names.count(twice)} times")
    units = _units(names, rows) if named else {}
    first = 1 if units else 0
    rows = rows[first:]
    if delimiter != ",":
        _with_points(path, names, rows, first)
    return Cells(names, rows, named, units, first, above)


def _lines(path: Path) -> tuple[list[str], str]:
    """Lines that are no comments, and the last comment above them, which may be the header."""
    raw = path.read_bytes()
    try:
        text = raw.decode("utf-16" if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig")
    except UnicodeDecodeError:
        if b"\0" in raw or raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            raise RecordingError(f"{path}: expected text in UTF-8 or UTF-16") from None
        text = raw.decode("cp1252", errors="replace")  # the text of Windows in the west
    lines: list[str] = []
    comment = ""
    for line in text.splitlines():
        bare = line.strip()
        if bare.startswith(_COMMENTS):
            comment = comment if lines else bare.lstrip("".join(_COMMENTS)).strip()
        elif bare:
            lines.append(line)
    if not lines:
        raise RecordingError(f"{path}: expected rows of numbers, this is empty")
    return lines, comment


def _divided(lines: Sequence[str]) -> tuple[list[list[str]], str]:
    """The fields of lines, by what divides most of them, and what that is; blanks are ""."""
    looked = lines[:: max(1, len(lines) // _LOOKED)]
    delimiter = Counter(map(_divider, looked)).most_common(1)[0][0]
    if not delimiter:
        return [line.split() for line in lines], ""
    reader = csv.reader(io.StringIO("\n".join(lines)), delimiter=delimiter)
    return [[field.strip() for field in row] for row in reader], delimiter


def _divider(line: str) -> str:
    bare = re.sub(r'"[^"]*"', "", line)  # what a quoted name holds divides nothing
    delimiter = max(_DELIMITERS, key=bare.count)
    return delimiter if delimiter in bare else "," if "," in bare else ""


def _names(row: Sequence[str]) -> bool:
    """Whether a row has texts that are neither numbers nor stamps."""
    return any(number(field) is None and stamp(field) is None for field in row)


def _units(names: Sequence[str], rows: Sequence[Sequence[str]]) -> dict[str, str]:
    """What the first row says if it is one of units."""
    row = rows[0] if rows else []
    if len(row) != len(names) or list(row) == list(names) or not _names(row):
        return {}
    if any(field and (number(field) is not None or not _UNIT.fullmatch(field)) for field in row):
        return {}
    return {name: field.strip("[]() ") for name, field in zip(names, row, strict=True) if field}


def _with_points(path: Path, names: Sequence[str], rows: list[list[str]], first: int) -> None:
    """Writes points for decimal commas, if the text has no points that would make commas part thousands."""
    points = any("." in field and _PLAIN.fullmatch(field) for row in rows for field in row)
    for place, row in enumerate(rows):
        for column, field in enumerate(row):
            if "," not in field or not _PLAIN.fullmatch(field):
                continue
            if points:
                name = names[column] if column < len(names) else f"number {column}"
                said = "expected one decimal sign in the whole file, got points and commas"
                raise RecordingError(f"{path}: column {name}, row {first + place}: {said}: {field[:20]!r}")
            row[column] = field.replace(",", ".")


def number(field: str) -> float | None:
    """The number of a field, NaN where a word says that there is none; None where it is another text."""
    try:
        return float(field)
    except ValueError:
        return float("nan") if field.lower() in _ABSENT else None


def stamp(field: str) -> tuple[float, str] | None:
    """Seconds of a time in words (ISO 8601), and its kind: with zone, without, or of the day; None if it is none."""
    if len(field) < 8 or not field[0].isdigit():
        return None
    try:
        found = datetime.fromisoformat(field)
    except ValueError:
        try:
            day = clock.fromisoformat(field)
        except ValueError:
            return None
        seconds = 3600.0 * day.hour + 60.0 * day.minute + day.second + 1e-6 * day.microsecond
        return seconds, "of the day"
    if ":" not in field:  # a date, or a number that reads as one
        return None
    kind = "with zone" if found.tzinfo else "without zone"
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp(), kind


def seconds_of(fields: Sequence[str]) -> Array | None:
    """Stamps in words as seconds since the first one, (N,), NaN where a field is none; None if the first is none.

    Those that have a zone are only compared with those that have one. Times of the day go on after midnight.
    """
    found = [stamp(field) for field in fields]
    if not found or found[0] is None:
        return None
    start, kind = found[0]
    values = np.array([one[0] - start if one and one[1] == kind else np.nan for one in found])
    if kind == "of the day":
        known = np.flatnonzero(np.isfinite(values))
        values[known] += _DAY * np.cumsum(np.diff(values[known], prepend=values[known[:1]]) < -0.5 * _DAY)
    return values
