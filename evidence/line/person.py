"""A person at a line, who approves some time later what its twins propose for an arm that is stopped."""

from __future__ import annotations

from dtwin.line.run import LineRun
from dtwin.line.twins.decisions import OPERATOR


class Person:
    """A person at a line.

    Args:
        run: the line.
        station: the station whose arm fails, "" for none.
        after: time from a proposal to its approval, s; 0 for a person who approves none.

    Attributes:
        released: whether the person has released the arm with the settings that were proposed.
    """

    def __init__(self, run: LineRun, station: str, after: float) -> None:
        self._run, self._station, self._after = run, station, after
        self._since: float | None = None
        self.released = False

    def look(self) -> None:
        """Looks at what is proposed, and approves it once it is due."""
        run, station = self._run, self._station
        if not station or not self._after or not run.capability(station).once_released:
            self._since = None
            return
        self._since = run.time if self._since is None else self._since
        if run.time >= self._since + self._after:
            run.settle(station, OPERATOR, "as proposed")
            self.released, self._since = True, None
