"""A log on disk while it grows: whole Parquet files side by side, put together at the end.

A process that is killed loses what came after its last part; one that starts again finds the parts and goes on. Small
parts are merged into larger ones as they come, so that their number stays low in runs of days. A part is named by its
first row and its number of rows: one that lies within another is what a kill left of a merge, and superfluous.

What a full disk does not take waits in memory, which is bounded: after that the oldest rows are lost.
"""

from __future__ import annotations

import contextlib
import logging
import re
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from dtwin.errors import NoSpaceError, RecordingError
from dtwin.files import NO_SPACE, ensure_writable
from dtwin.logs.files import count_rows, is_log, join_logs
from dtwin.logs.log import Log, concatenate
from dtwin.logs.reading import read_log
from dtwin.services.parts.part_files import WHOLE, discard_parts, folder_of
from dtwin.signals import Event

log = logging.getLogger(__name__)

MERGED: Final = 64
"""Number of small parts that are merged into one."""
LARGE: Final = 1 << 15
"""Number of rows from which a part is merged no more."""
WAITING_LIMIT: Final = 1 << 17
"""Largest number of rows that wait in memory for room on the disk: 22 minutes of a cell in real time."""
_CHUNK: Final = 1 << 12
"""Number of rows of one part of those that wait."""
_NAME: Final = re.compile(r"(\d+)-(\d+)\.parquet")


@dataclass(frozen=True, slots=True, order=True)
class Span:
    """The rows of one part: the number of the first, and how many there are."""

    first: int
    rows: int

    @property
    def end(self) -> int:
        """Number of the row after the last."""
        return self.first + self.rows

    @property
    def name(self) -> str:
        """Name of the part's file."""
        return f"{self.first:09d}-{self.rows}.parquet"


class Parts:
    """The parts of the log `path`.

    Args:
        path: path of the whole log, which is written at the end.

    Attributes:
        last: plant time of the last row on disk, s; minus infinity when there is none.
        news: what happened to the files, in words; whoever reads it clears it.

    Raises:
        RecordingError: the folder cannot be made or the log not be written, for another reason than a full disk.
    """

    def __init__(self, path: Path) -> None:
        # Arrow's own pool keeps what a merge has taken; the system's gives it back.
        pa.set_memory_pool(pa.system_memory_pool())
        self._path = path
        self._folder = folder_of(path)
        self._waiting: deque[Log] = deque()
        self._lost: list[float] = []
        self._lost_rows = 0
        self._failing = False
        self.news: list[str] = []
        self.last = -float("inf")
        try:
            ensure_writable(path)
            self._make_folder()
        except NoSpaceError as error:
            self._fail(error)
        self._take_back()
        self._spans = self._find()
        while self._spans and self.last == -float("inf"):
            if self._sound(self._spans[-1:]):
                self.last = float(read_log(self._folder / self._spans[-1].name).columns["t"][-1])

    @property
    def rows(self) -> int:
        """Number of rows on disk."""
        return self._spans[-1].end if self._spans else 0

    @property
    def waiting(self) -> int:
        """Number of rows that wait in memory for room on the disk."""
        return sum(map(len, self._waiting))

    def add(self, log: Log) -> None:
        """Keeps one more part, and those that wait, as far as there is room."""
        if self._waiting and len(self._waiting[-1]) < _CHUNK:
            log = concatenate([self._waiting.pop(), log], {})
        self._waiting.append(log)
        self._write()
        while self.waiting > WAITING_LIMIT:
            self._lose(self._waiting.popleft())

    def read(self, row: int) -> tuple[Log, int] | None:
        """The rows from a row on of the first part that reaches so far, and the row after them; None at the end."""
        for span in [span for span in self._spans if span.end > row]:
            if self._sound([span]):
                whole = read_log(self._folder / span.name)
                rest = whole.part(max(row - span.first, 0), span.rows)
                begin = rest.columns["t"][0] if row > span.first else -float("inf")
                return Log(rest.columns, tuple(event for event in rest.events if event.time >= begin)), span.end
        return None

    def clear(self) -> None:
        """Forgets all parts: they belong to another run."""
        discard_parts(self._path)
        self._spans = []
        self.last = -float("inf")

    def finish(self, metadata: dict[str, Any], late: Sequence[Event] = ()) -> bool:
        """Writes the whole log in the place of its parts; False when there is nothing to write.

        Args:
            metadata: what the log says about how the run was made.
            late: events that came after the last row.

        Raises:
            RecordingError: the log cannot be written; its parts stay where they are.
        """
        self._write()
        if self._waiting:
            raise RecordingError(f"{self._path}: {self.waiting} rows are lost; the others stay in {self._folder}")
        whole = len(self._spans)
        spans = self._sound(self._spans)
        if spans:
            join_logs([self._folder / span.name for span in spans], self._path, metadata, late)
        if len(spans) == whole:
            self._remove(spans)
            with contextlib.suppress(OSError):
                self._folder.rmdir()  # What else is kept there keeps the folder.
        return bool(spans)

    def mark_whole(self) -> None:
        """Lets the next Parts take the finished log back as their first part; without room they begin another."""
        with contextlib.suppress(OSError):
            self._folder.mkdir(exist_ok=True)
            (self._folder / WHOLE).touch()

    def _take_back(self) -> None:
        """Makes a finished log that is marked as one of this run the first part again."""
        marker = self._folder / WHOLE
        if marker.exists() and is_log(self._path):
            self._path.replace(self._folder / Span(0, count_rows(self._path)).name)
        marker.unlink(missing_ok=True)

    def _write(self) -> None:
        """Writes what waits, oldest first, as far as there is room, and merges small parts."""
        while self._waiting:
            part = self._waiting[0]
            span = Span(self.rows, len(part))
            try:
                self._make_folder()
                part.write_parquet(self._folder / span.name)
            except RecordingError as error:
                self._fail(error)
                return
            self._waiting.popleft()
            self._spans.append(span)
            self.last = float(part.columns["t"][-1])
            self._merge()
        if self._failing:
            self._failing = False
            self.news.append(f"the log is written again{self._gap()}")

    def _merge(self) -> None:
        """Merges the small parts at the end when there are many; where there is no room they stay as they are."""
        small = next((k for k, span in enumerate(reversed(self._spans)) if span.rows >= LARGE), len(self._spans))
        if not small or small % MERGED:
            return
        spans = self._spans[-small:]
        if self._sound(spans) != spans:
            return
        merged = Span(spans[0].first, spans[-1].end - spans[0].first)
        try:
            join_logs([self._folder / span.name for span in spans], self._folder / merged.name, {})
        except RecordingError as error:
            log.info("parts are not merged: %s", error)
            return
        self._spans[-small:] = [merged]
        self._remove(spans)

    def _find(self) -> list[Span]:
        """The parts that are there, oldest first, without what kills left."""
        for unfinished in self._folder.glob(".*.part"):
            unfinished.unlink(missing_ok=True)
        matches = (_NAME.fullmatch(file.name) for file in self._folder.glob("*.parquet"))
        found = sorted((Span(int(m[1]), int(m[2])) for m in matches if m), key=lambda span: (span.first, -span.rows))
        spans: list[Span] = []
        within = []
        for span in found:
            if spans and span.end <= spans[-1].end:
                within.append(span)
            else:
                spans.append(span)
        self._remove(within)
        return spans

    def _sound(self, spans: list[Span]) -> list[Span]:
        """Those of the parts that are Parquet files; others are put aside, for a person to look at."""
        sound = []
        for span in spans:
            file = self._folder / span.name
            if is_log(file):
                sound.append(span)
                continue
            log.warning("%s: expected a Parquet file, left out", file)
            if file.exists():
                file.rename(file.with_suffix(".unreadable"))
            self._spans = [other for other in self._spans if other != span]
        return sound

    def _remove(self, spans: Iterable[Span]) -> None:
        for span in spans:
            (self._folder / span.name).unlink(missing_ok=True)

    def _make_folder(self) -> None:
        try:
            self._folder.mkdir(exist_ok=True)
        except OSError as error:
            failure = NoSpaceError if error.errno in NO_SPACE else RecordingError
            raise failure(f"{self._folder}: cannot be made: {error.strerror}") from None

    def _fail(self, error: RecordingError) -> None:
        if not self._failing:
            self._failing = True
            self.news.append(f"{error}; rows wait in memory")

    def _lose(self, rows: Log) -> None:
        """Notes that rows are lost, and says so the first time."""
        times = rows.columns["t"]
        if not self._lost:
            self._lost = [float(times[0]), 0.0]
            self.news.append(f"{self._path}: no room for {WAITING_LIMIT} rows: the oldest are lost from now on")
        self._lost[1] = float(times[-1])
        self._lost_rows += len(rows)

    def _gap(self) -> str:
        if not self._lost:
            return ""
        first, last = self._lost
        said = f"; {self._lost_rows} rows from {first:.2f} s to {last:.2f} s are missing"
        self._lost, self._lost_rows = [], 0
        return said
