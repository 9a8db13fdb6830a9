"""What goes out to people: text of others in one line, and files that appear complete or not at all."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import os
from pathlib import Path

from iec61499.errors import ToolError


def printable(text: str) -> str:
    """A text in one line, with every character that cannot be seen in its place written as JSON escapes it.

    A JSON text in one line stays the same JSON. What counts as visible is `str.isprintable`: letters, marks, digits,
    punctuation, symbols and the space, but no control or format characters, separators or lone surrogates.
    """
    return text if text.isprintable() else "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)


def write_whole(file: Path, data: bytes) -> None:
    """Writes a file anew; when that fails it is as it was before. Raises ToolError."""
    target = file.resolve()
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        temporary.write_bytes(data)
        if target.exists():
            temporary.chmod(target.stat().st_mode & 0o7777)
        os.replace(temporary, target)
    except OSError as error:
        raise ToolError(f"{file}: cannot be written: {error.strerror}") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


class LineFormatter(logging.Formatter):
    """Formats a log record as one printable line; a traceback follows in lines of its own."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        return printable(super().formatMessage(record))


class RateLimit(logging.Filter):
    """Lets few records of one kind (level and message before its arguments are put in) through in a time.

    Whoever sends bad input a thousand times would otherwise fill the log. The last record that comes through says
    that others are withheld, and the first one of the next time how many were.

    Args:
        most: records of one kind that come through in a time.
        period: that time, s.
    """

    def __init__(self, most: int = 3, period: float = 60.0) -> None:
        super().__init__()
        self._most = most
        self._period = period
        self._kinds: dict[tuple[int, str], tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        kind = record.levelno, str(record.msg)
        since, count = self._kinds.get(kind, (-math.inf, 0))
        withheld = 0
        if record.created >= since + self._period:
            since, count, withheld = record.created, 0, max(0, count - self._most)
        self._kinds[kind] = since, count + 1
        if count >= self._most:
            return False
        notes = [f"{withheld} more since"] * bool(withheld)
        notes += [f"more of these are only counted for {self._period:g} s"] * (count + 1 == self._most)
        if notes:
            record.msg, record.args = f"{record.getMessage()} ({'; '.join(notes)})", ()
        return True
