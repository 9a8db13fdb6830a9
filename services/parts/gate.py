"""Which commands the emulated arm obeys, and when it must stop obeying the last one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dtwin.bus.pairs import Numbered
from dtwin.errors import ParameterError

STALE: Final = 0.050
"""s without a valid command after which the arm gets the safe one"""
RIVAL_COMMANDS: Final = 3
"""Samples answered twice, at most RIVAL_GAP samples apart, that prove a second publisher."""
RIVAL_GAP: Final = 100

Refuse = Callable[[str, str], None]
"""Counts a refusal: reason and details."""


class Gate:
    """Takes each command once, in order, and none from the future; knows how old the last valid one is.

    Times are of one clock, in s.

    Args:
        refuse: told of every command that is not taken.
        stale: s, see STALE; as old may the sample be that a late command answers.

    Attributes:
        expected: sequence number of the sample to be answered.
        repeated: number of the last sample that was published again, whose answer may come again; -1 for none.
        rivals: whether a second publisher has been seen since the flag was last cleared.

    Raises:
        ParameterError: stale is not above 0.
    """

    def __init__(self, refuse: Refuse, stale: float = STALE) -> None:
        if not stale > 0:
            raise ParameterError(f"stale: expected a time above 0 s, got {stale}")
        self._refuse = refuse
        self._stale = stale
        self._last = -1
        self._seen: float | None = None
        self._duplicates = 0
        self._duplicate_at = -RIVAL_GAP - 1
        self.expected = 0
        self.repeated = -1
        self.rivals = False

    def restart(self, sequence: int) -> None:
        """The next sample has this number and nothing has been commanded yet."""
        self._last = sequence - 1
        self._seen = None
        self.expected = sequence
        self.repeated = -1

    def admit(self, command: Numbered, now: float, sent: float) -> bool:
        """Whether the arm shall obey a command that comes now and answers a sample sent at a time."""
        sequence = command.sequence
        if sequence > self.expected:
            self._refuse("from the future", f"command {sequence}, expected at most {self.expected}")
        elif sequence < self._last:
            self._refuse("out of sequence", f"command {sequence} after {self._last}")
        elif sequence == self._last == self.repeated:
            return False
        elif sequence == self._last:
            self._refuse("duplicate", f"a second command {sequence}: is there a second publisher?")
            self._note_duplicate(sequence)
        elif sequence < self.expected and now - sent > self._stale:
            self._refuse("late", f"command {sequence}, {now - sent:.3g} s after its sample")
        else:
            self._last = sequence
            self._seen = now
            return True
        return False

    @property
    def answered(self) -> bool:
        """Whether the expected sample has its command."""
        return self._last == self.expected

    @property
    def commanded(self) -> bool:
        """Whether there has been any command."""
        return self._seen is not None

    def is_stale(self, now: float) -> bool:
        """Whether the last valid command is too old to be obeyed any longer."""
        return self._seen is not None and now - self._seen > self._stale

    def _note_duplicate(self, sequence: int) -> None:
        near = sequence - self._duplicate_at <= RIVAL_GAP
        self._duplicates = self._duplicates + 1 if near else 1
        self._duplicate_at = sequence
        if self._duplicates >= RIVAL_COMMANDS:
            self._duplicates = 0
            self.rivals = True
