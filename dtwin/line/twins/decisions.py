"""What is decided at a line, and by whom."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Final, Literal

import msgspec

Mode = Literal["act", "propose", "off"]
"""What the twins do with what they have decided: they carry it out, only write it down, or there are none."""
OPERATOR: Final = "operator"
REPAIRED: Final = "the arm is repaired and released"
"""What is said of an arm whose fault has ended."""


class Decision(msgspec.Struct, frozen=True):
    """Something that was decided.

    Attributes:
        time: plant time, s.
        who: twin, monitor or operator.
        what: "finding", "no finding", "stop", "settings", "set-up", "proposal", "none possible", "repair",
            "no answer", "answers again".
        why: in words.
        station: station that it is about, "" for the line.
        assignment: which station does what from then on, empty if that does not change.
        rate: boxes an hour that are expected then, 0 if nothing is.
    """

    time: float
    who: str
    what: str
    why: str
    station: str = ""
    assignment: dict[str, str] = {}
    rate: float = 0.0


Note = Callable[[Decision], None]
"""Keeps a decision."""


class Absence:
    """Notes which blocks no longer answer, and when all do again.

    Args:
        note: keeps what is noted.
    """

    def __init__(self, note: Note) -> None:
        self._note = note
        self._absent: frozenset[str] = frozenset()

    def look(self, names: Collection[str], time: float) -> None:
        """Looks at the names of those that do not answer at a plant time, s."""
        absent = frozenset(names)
        if new := absent - self._absent:
            why = f"no answer from {', '.join(sorted(new))}: the rest goes on"
            self._note(Decision(time, "control", "no answer", why))
        elif self._absent and not absent:
            why = "all answer again, and the stations are set up anew"
            self._note(Decision(time, "control", "answers again", why))
        self._absent = absent
