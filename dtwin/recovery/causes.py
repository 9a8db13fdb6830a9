"""Pushes as causes of stops: whether one that the monitor has told led to a stop by the blocks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from dtwin.bus.twin_messages import MonitoredUnit
from dtwin.monitoring.kinds import PUSH
from dtwin.monitoring.verdict import told
from dtwin.signals import MONITOR, Event

CLEAR: Final = "see that nothing is in the way of the arm, then `dtwin release`"
"""What a person has to do about an arm that was stopped as something pushed it: a stop ends by a person alone"""
PUSHED: Final = 5.0
"""s before a stop by the blocks in which a push began that may have led to it: an arm that was pressed against
something is stopped once the integrals have brought the voltage to its limit"""
BELIEVED: Final = 0.95
"""Least confidence of what is told as the cause of a stop, or against it"""
_FAILED: Final = f"{MONITOR}failed"
"""The kind of events that tell a finding which stands"""


class StopCause:
    """Which push explains the last stop by the blocks, as far as the monitor knows by now.

    A push is over when it is told, so that it is no finding that stands, and it may be told after the stop.

    Attributes:
        name: the push that a person has been told as the cause of the stop, by joint, such as push of joint 2; "" for
            none.
    """

    def __init__(self) -> None:
        self.name = ""
        self._push: Event | None = None
        self._asked: Event | None = None

    def note(self, event: Event) -> None:
        """Takes in an event of the monitor."""
        if event.kind == MONITOR + PUSH:
            self._push = event

    def explain(self, stop: Event, found: Iterable[MonitoredUnit]) -> str:
        """What a person is told of a stop that no finding explains, "" if no push does either.

        Args:
            stop: event of the stop.
            found: settled findings that stand; one that was noticed after the push names another cause.
        """
        self._asked, self.name = stop, ""
        push = self._push
        if push is None or any(unit.detected > push.time for unit in found):
            return ""
        confidence, since = told(push.text)
        if not stop.time - PUSHED <= since <= stop.time:
            return ""
        name = push.text.partition(",")[0]
        if confidence < BELIEVED:
            return f"{name} may explain it, with a confidence of {100 * confidence:.0f} %"
        self.name = name
        return f"{name} explains it: {CLEAR}"

    def amend(self, event: Event) -> str:
        """What a person is told of that stop once more, as an event of the monitor has changed it; "" for nothing."""
        if self._asked is None:
            return ""
        if event.kind == _FAILED and self.name and told(event.text)[0] >= BELIEVED:
            before, self.name = self.name, ""
            return f"{event.text.partition(',')[0]} was found since, and {before} may not explain the stop"
        if event.kind == MONITOR + PUSH and not self.name and (text := self.explain(self._asked, ())):
            return f"the stop: {text}"
        return ""
