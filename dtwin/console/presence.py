"""Which services are there, how they do, and what has happened, as tokens, statuses and events tell it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

from dtwin.bus.messages import EVENTS, STATUS, Status, Summary
from dtwin.bus.session import Bus
from dtwin.console.motion import SILENT
from dtwin.console.telling import Health
from dtwin.signals import Event

FRESH: Final = 1000
"""Number of events that wait to be taken."""
EVENTS_KEPT: Final = 60
"""Number of the last events that pages are told."""


class Presence:
    """The services of a cell or a line.

    Args:
        steady: gives a time that only grows, s.
        changed: called when a service comes or goes.
    """

    def __init__(self, steady: Callable[[], float], changed: Callable[[], None]) -> None:
        self._steady = steady
        self._changed = changed
        self._statuses: dict[str, tuple[float, Status]] = {}
        self._here: dict[str, bool] = {}

    def listen(self, bus: Bus) -> None:
        """Follows statuses and tokens."""
        bus.subscribe(STATUS, Status, self._take_status)
        bus.watch_alive(self._take_token)

    def is_here(self, service: str) -> bool:
        """Whether the token of a service is there."""
        return self._here.get(service, False)

    def services(self, summary: Summary | None) -> dict[str, Health]:
        """Health of the services by name.

        Args:
            summary: what the supervisor says of those that it has started; None if it has said nothing.
        """
        now = self._steady()
        found = {}
        for name, service in ({} if summary is None else summary.services).items():
            found[name] = Health(
                service.state,
                service.doing or service.last_error,
                round(service.rate_hz, 1),
                service.restarts,
                self.is_here(name),
            )
        for name, (heard, status) in list(self._statuses.items()):
            if name not in found:
                state = status.state if self.is_here(name) and now - heard < SILENT else "gone"
                found[name] = Health(state, status.last_error, round(status.rate_hz, 1), 0, self.is_here(name))
        return dict(sorted(found.items()))

    def _take_status(self, status: Status) -> None:
        self._statuses[status.service] = (self._steady(), status)

    def _take_token(self, service: str, alive: bool) -> None:
        self._here[service] = alive
        self._changed()


class EventQueue:
    """The last events, and those that nobody has taken yet.

    Args:
        happened: called with every event, after it can be read here.
    """

    def __init__(self, happened: Callable[[Event], None]) -> None:
        self._happened = happened
        self._last: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self._fresh: deque[Event] = deque(maxlen=FRESH)

    def listen(self, bus: Bus) -> None:
        """Follows events."""
        bus.subscribe(EVENTS, Event, self._take)

    def last(self) -> tuple[Event, ...]:
        """The last events, oldest first."""
        return tuple(self._last)

    def fresh(self) -> list[Event]:
        """The events since the last call, oldest first."""
        found = []
        while self._fresh:
            found.append(self._fresh.popleft())
        return found

    def _take(self, event: Event) -> None:
        self._last.append(event)
        self._fresh.append(event)
        self._happened(event)
