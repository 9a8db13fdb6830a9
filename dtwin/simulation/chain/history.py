"""The history of the models and tunings of the blocks of an arm, one JSON line for every change."""

from __future__ import annotations

from pathlib import Path

import msgspec

from dtwin.arm.model import ArmModel, ArmSettings, ArmTuning
from dtwin.line_file import LineFile
from dtwin.signals import Count, Line, Seconds, Word
from dtwin.simulation.history import Action


class ArmEntry(msgspec.Struct, frozen=True, tag_field="schema", tag=1):
    """An entry: one action on the settings.

    Attributes:
        version: version of the settings in force afterwards, which counts up with every change.
        time: plant time, s.
        action: what was done.
        who: who wanted it.
        why: reason in the words of who wanted it.
        model: model in force afterwards.
        text: result in words, such as the reason of a refusal or the outcome of the trial.
        predicted: largest distance of each joint from its path that the twin predicted, rad or m.
        measured: largest distance of each joint from its path in the trial, rad or m.
        tuning: tuning in force afterwards.
        kind: what was to change: model or tuning.
    """

    version: Count
    time: Seconds
    action: Action
    who: Word
    why: Line
    model: ArmModel
    text: Line = ""
    predicted: tuple[float, ...] | None = None
    measured: tuple[float, ...] | None = None
    tuning: ArmTuning = ArmTuning()
    kind: Word = ""

    @classmethod
    def of(
        cls,
        version: int,
        time: float,
        action: Action,
        who: str,
        why: str,
        kind: str,
        settings: ArmSettings,
        text: str = "",
        *,
        predicted: tuple[float, ...] | None = None,
        measured: tuple[float, ...] | None = None,
    ) -> ArmEntry:
        """An entry with settings, told like those of `dtwin.simulation.history.Entry`."""
        model, tuning = settings.model, settings.tuning
        return cls(version, time, action, who, why, model, text, predicted, measured, tuning, kind)

    @property
    def settings(self) -> ArmSettings:
        """What is in force afterwards."""
        return ArmSettings(self.model, self.tuning)


class ArmHistory(LineFile[ArmEntry]):
    """The entries of a history file.

    Args:
        path: path of the file, which is made with the first entry.
    """

    make = ArmEntry.of

    def __init__(self, path: Path) -> None:
        super().__init__(path, ArmEntry, "an entry of the history of an arm's settings")
