"""Reads a stretch of a recorded log as the displays show it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from dtwin.console.calculations.logs import logs_in
from dtwin.console.calculations.tasks import Recall
from dtwin.console.ring import COLUMNS
from dtwin.console.telling import CellState, Condition, spots
from dtwin.errors import ParameterError, choices
from dtwin.logs.reading import read_log
from dtwin.task import task_of

WINDOW: Final = 120.0
"""Length of a stretch, s: the minute of the trends before a moment, and as much behind it."""
EVERY: Final = 5
"""Number of ticks of which one is shown."""
EVENTS: Final = 60
"""Number of events that are shown."""


def recall(folder: Path | None, task: Recall) -> dict[str, Any]:
    """The stretch of a log, in the form in which the last hour is told.

    Raises:
        ParameterError: the folder has no log of that name.
        RecordingError: the file is no log.
    """
    names = logs_in(folder)
    if folder is None or task.log not in names:
        raise ParameterError(f"no log {task.log!r}: expected {choices(names) if names else 'a folder with logs'}")
    log = read_log(folder / task.log)
    times = log.columns["t"]
    at = float(times[-1]) if task.at is None else min(max(task.at, float(times[0])), float(times[-1]))
    first, last = np.searchsorted(times, at - WINDOW), np.searchsorted(times, at, side="right")
    part = log.part(int(first), int(last))
    unknown = np.full(len(part), np.nan)
    task_of_log = task_of(log.metadata)
    colours = ("", *task_of_log.colours)
    code = np.array([colours.index(name) if name in colours else 0 for name in part.columns["box_colour"].tolist()])
    named = {
        "at": part.columns["t"],
        "time": part.columns["t"],
        **{f"theta_{k}": part.columns[f"measured_{k}"] for k in (1, 2, 3)},
        **{f"path_{k}": part.columns[f"target_{k}"] for k in (1, 2, 3)},
        **{f"volts_{k}": part.columns[f"volts_{k}"] for k in (1, 2, 3)},
        "gripper": part.columns["gripper"],
        "gripped": part.columns["box_gripped"].astype(float),
        "box": np.where(part.columns["box_present"], code, 0).astype(float),
    }
    rows = np.column_stack([named.get(name, unknown) for name in COLUMNS])[::EVERY]
    events = tuple(event for event in log.events if event.time <= at)[-EVENTS:]
    text = f"recording {task.log}"
    state = CellState(
        task.log,
        "recording",
        text,
        places=spots(task_of_log),
        events=events,
        conditions=(Condition("past", "stale", text),),
    )
    return {
        "span": (float(times[0]), float(times[-1])),
        "columns": COLUMNS,
        "colours": colours,
        "rows": [[None if np.isnan(value) else value for value in row] for row in rows.round(6).tolist()],
        "state": state,
    }
