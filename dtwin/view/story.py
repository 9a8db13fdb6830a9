"""What a run tells: the state of the controller, what went wrong and when, the stop in force."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from dtwin.logs.log import Log
from dtwin.signals import MONITOR, RELEASED, Event, EventKind
from dtwin.view import style
from dtwin.view.series import time_column

STATE: Final = "controller/state"
STATUS: Final = "status"
MARKS: Final = "marks"
STATES: Final = ("waiting", "fetching", "carrying", "stopped")
"""waiting: the arm rests without a box; fetching: it goes to the pickup point or closes around a box there; carrying:
it holds a box, or opens the gripper over its place; stopped: a safe stop holds it, or it gets 0 V."""
_WAITING, _FETCHING, _CARRYING = range(3)
_STATE_COLOURS: Final = ((120, 130, 140), (86, 204, 242), (255, 183, 77), (235, 50, 45))
_FINDING: Final = MONITOR + EventKind.FAILED
_FAULTS: Final = frozenset({EventKind.FAULT, EventKind.DIVERGED, EventKind.COLLISION, EventKind.MISPLACED})
_MARKUP: Final = re.compile(r"([!-/:-@\[-`{-~])")
"""What Markdown may take for more than text, and lets be shown after a backslash."""
_MOVES: Final = 1e-7
"""Least change of the path in a tick that counts as a motion, rad."""
_BEYOND: Final = 1e5
"""Where a mark ends, beyond the range of every plot."""
MOST_MARKS: Final = 20
"""Number of moments that are marked in a run: a cell in trouble has many."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A moment of a run that is worth a look.

    Attributes:
        time: plant time, s.
        kind: "finding" of a monitor, "fault", or "stop".
        text: what happened, for people.
    """

    time: float
    kind: str
    text: str


def marks(events: Iterable[Event]) -> list[Mark]:
    """The moments that are worth a look, in order of time: faults, findings and stops, the first ones of many."""
    found = []
    for event in events:
        if event.kind == _FINDING:
            found.append(Mark(event.time, "finding", event.text))
        elif event.kind in _FAULTS:
            found.append(Mark(event.time, "fault", event.text))
        elif _stops(event):
            found.append(Mark(event.time, "stop", event.text))
    return sorted(found, key=lambda mark: mark.time)[:MOST_MARKS]


def moving(target: NDArray[np.float64], before: NDArray[np.float64]) -> NDArray[np.bool_]:
    """At which ticks a path (ticks, 3) is another one, rad, than at the tick before, where it begins after (1, 3)."""
    changed: NDArray[np.bool_] = np.abs(np.diff(target, axis=0, prepend=before)).max(axis=1) > _MOVES
    return changed


def _stops(event: Event) -> bool | None:
    """Whether an event stops the arm (True), lets it move again (False), or neither."""
    if event.kind == EventKind.SAFE:
        return True
    if event.kind == EventKind.RESUMED:
        return False
    if event.kind == EventKind.STOP:
        return not event.text.startswith(RELEASED)
    return None


class Story:
    """Follows a run, part by part, and sends what state its controller is in."""

    def __init__(self) -> None:
        self._code = -1
        self._target: NDArray[np.float64] | None = None
        self._stop = ""
        self._told = ""

    def changes(self, log: Log) -> list[tuple[int, str, str]]:
        """The changes of state in a log of at least one tick that follows those told before.

        Returns:
            The tick of each change, the state from there on, and the text of the stop in force, "" for none.
        """
        codes, t = self._codes(log), log.columns["t"]
        stops = {0: self._stop}
        for event in log.events:
            if (begins := _stops(event)) is not None:
                self._stop = event.text if begins else ""
                stops[min(int(np.searchsorted(t, event.time)), len(t) - 1)] = self._stop
        found = []
        stop = ""
        for tick in sorted({*stops, *(np.flatnonzero(np.diff(codes)) + 1).tolist()}):
            stop = stops.get(tick, stop)
            state = "stopped" if stop else STATES[codes[tick]]
            if state + stop != self._told:
                self._told = state + stop
                found.append((tick, state, stop))
        return found

    def _codes(self, log: Log) -> NDArray[np.int64]:
        """Places in STATES of what the arm is at, (ticks,), whether it is stopped or not."""
        target = log.stack("target")
        before = target[:1] if self._target is None else self._target
        moves = moving(target, before)
        codes = np.full(len(log), -1)
        codes[moves | log.columns["box_present"]] = _FETCHING
        codes[log.held()] = _CARRYING
        # An arm that rests after it let a box go still opens its gripper.
        last = np.maximum.accumulate(np.where(codes >= 0, np.arange(len(log)), -1))
        earlier = np.where(last >= 0, codes[last], self._code)
        codes = np.where((codes < 0) & (earlier != _CARRYING), _WAITING, earlier)
        self._code, self._target = int(codes[-1]), target[-1:]
        return codes

    def send(self, stream: rr.RecordingStream, log: Log) -> None:
        """Sends the changes of state in a log of at least one tick that follows those sent before."""
        changes = self.changes(log)
        if not changes:
            return
        ticks, states, stops = zip(*changes, strict=True)
        times = time_column(log.columns["t"][list(ticks)])
        stream.send_columns(STATE, indexes=[times], columns=rr.StateChange.columns(state=states))
        said = [
            f"# ■ STOPPED: {_as_text(stop)}" if stop else f"Controller: **{state}**"
            for state, stop in zip(states, stops, strict=True)
        ]
        stream.send_columns(STATUS, indexes=[times], columns=rr.TextDocument.columns(text=said))


def _as_text(text: str) -> str:
    """Markdown that shows a text of others as it is, in one line."""
    return _MARKUP.sub(r"\\\1", " ".join(text.split()))


def log_story_styles(stream: rr.RecordingStream) -> None:
    """Sends names and colours of the states."""
    lane = rr.StateConfiguration(
        values=list(STATES), labels=list(STATES), colors=[(*colour, 255) for colour in _STATE_COLOURS]
    )
    stream.log(STATE, lane, static=True)
    stream.log(STATUS, rr.TextDocument.from_fields(media_type=rr.MediaType.MARKDOWN), static=True)


def log_marks(stream: rr.RecordingStream, found: Sequence[Mark], earlier: int = 0) -> None:
    """Sends upright lines for plots of a fixed range, each named by its kind and moment, after some earlier ones."""
    for number, mark in enumerate(found, earlier):
        entity = f"{MARKS}/{number}"
        name = f"{mark.kind} at {mark.time:.2f} s"
        lines = rr.SeriesLines(names=[name], colors=[style.MARKS[mark.kind]], widths=[2.0], aggregation_policy="off")
        stream.log(entity, lines, static=True)
        columns = rr.Scalars.columns(scalars=[-_BEYOND, _BEYOND])
        stream.send_columns(entity, indexes=[time_column([mark.time, mark.time])], columns=columns)
