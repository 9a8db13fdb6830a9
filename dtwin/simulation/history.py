"""The history of a controller's settings: a file to which every change appends one JSON line.

The last line holds the settings in force, so there is no second file that could disagree. A line is on disk before
the next step.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

import msgspec

from dtwin.controller.settings import ControlSettings
from dtwin.line_file import LineFile
from dtwin.parameters import CellJoints
from dtwin.signals import Count, Line, Seconds, Word

HISTORY: Final = Path("uploads.jsonl")
"""Default file, in the working directory."""

SELF: Final = "dtwin"
"""Name under which dtwin itself confirms and rolls back."""
Action = Literal["start", "upload", "refuse", "confirm", "roll back"]
"""Kinds of entries; "start" means found in force, "confirm" that the trial went as predicted."""


class Entry(msgspec.Struct, frozen=True, tag_field="schema", tag=1):
    """An entry of the history: one action on the settings.

    Attributes:
        version: version of the settings in force afterwards, which counts up with every change.
        time: plant time, s.
        action: what was done.
        who: who wanted it.
        why: reason in the words of that person.
        kind: what was to change: gains, target, model, payload or offset.
        settings: settings in force afterwards.
        text: result in words, such as the reason of a refusal or the outcome of the trial.
        predicted: largest distance of each joint from its path that the twin predicted, rad.
        measured: largest distance of each joint from its path in the trial, rad.
    """

    version: Count
    time: Seconds
    action: Action
    who: Word
    why: Line
    kind: Word
    settings: ControlSettings
    text: Line = ""
    predicted: CellJoints | None = None
    measured: CellJoints | None = None


class History(LineFile[Entry]):
    """The entries of a history file; several processes may append to it.

    Args:
        path: path of the file, which is made with the first entry.
    """

    make = Entry

    def __init__(self, path: Path) -> None:
        super().__init__(path, Entry, "an entry of the history")
